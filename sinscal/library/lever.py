"""Lever arms of the accelerometers' sensing masses from the centre of rotation."""

from functools import partial

from errormodel.arrays import FloatArray
from errormodel.record import Record
from errormodel.terms import Term, Told
from sinscal.library.groups import RATE, ChannelId, Group, effect_of, term_of
from sinscal.recording.run import AXES


def lever_column(record: Record, axis: int, component: int) -> FloatArray:
    """Return the specific force along `axis` of a mass one metre off the centre, per metre.

    It is the element (axis, component) of [ω̇ ×] + [ω ×]².
    """
    w = [record[f"w_{a}"] for a in AXES]
    if axis == component:
        j, k = (axis + 1) % 3, (axis + 2) % 3
        return -(w[j] ** 2 + w[k] ** 2)
    third = 3 - axis - component
    sign = 1.0 if (axis, component) in ((0, 2), (1, 0), (2, 1)) else -1.0
    return w[axis] * w[component] + sign * record[f"dw_{AXES[third]}"]


def _lever_arm(c: ChannelId) -> Term:
    parts = [
        (
            f"lever_arm_{c.letter}_{AXES[j]}",
            f"r{c.letter}{AXES[j]}",
            "m",
            partial(lever_column, axis=c.axis, component=j),
        )
        for j in range(3)
    ]
    sentence = "The sensing mass is away from the centre of rotation and senses its acceleration."
    return term_of(f"lever_arm_{c.letter}", sentence, parts)


LEVER_ARM = Group(
    name="lever_arm",
    kinds=("accel",),
    make=_lever_arm,
    prior_sigma=0.1,  # assumed: the size of a SINS
    told=Told(unit="mm", size=1e-3),
    formula="lever(ω, dω/dt)",
    signs="lever_arm_a_b is component b of accelerometer a's sensing mass from the centre of "
    "rotation, it adds ([dω/dt ×] + [ω ×]²)·r",
)
GROUPS = (LEVER_ARM,)
EFFECTS = (
    effect_of(
        LEVER_ARM,
        "The sensing masses are away from the centre of rotation and sense its acceleration.",
        "turn at several rates, among them fast ones: the force grows with the rate squared",
        RATE,
    ),
)
