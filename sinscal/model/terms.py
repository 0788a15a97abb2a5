"""Terms of a SINS's six sensors and of the rig's angle, each with what it physically is.

Measured = true + error. Signals: `w_x … w_z` (rate of the body against inertial space, rad/s),
`dw_x … dw_z` (its derivative, rad/s²), `f_x … f_z` (specific force, m/s²), `x_c` (temperature of
the channel's own sensor less the reference temperature, °C); for the angle `angle_rad` and its rate
`turn_rad_s`. The axes of the accelerometers fix the body frame: z's is free, and Γ is lower
triangular, so that x's has no misalignment, y's one (from x) and z's two.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.record import Record
from errormodel.terms import Coefficient, Term, memoryless
from sinscal.recording.run import AXES

Kind = Literal["gyro", "accel", "angle"]
TIME_OFFSET = "rig_time_offset"
# A motion that differs from the others by less than this share of its size tells nothing.
MIN_SHARE = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelId:
    """Which sensor a term belongs to: its kind and its axis 0, 1, 2 (0 for the angle)."""

    kind: Kind
    axis: int

    @property
    def letter(self) -> str:
        """The axis's name."""
        return AXES[self.axis]


Maker = Callable[[ChannelId], Term | None]

CHANNELS = tuple(ChannelId(kind=kind, axis=axis) for kind in ("gyro", "accel") for axis in range(3))
ANGLE = ChannelId(kind="angle", axis=0)


def _term(
    name: str, sentence: str, parts: Sequence[tuple[str, str, str, Callable[[Record], FloatArray]]]
) -> Term:
    """Return a term of input columns; each part is (name, symbol, unit, column)."""
    coefficients = tuple(
        Coefficient(name=n, symbol=s, unit=u, min_share=MIN_SHARE) for n, s, u, _ in parts
    )

    def columns(record: Record) -> FloatArray:
        # each column in one piece of memory: a run has hundreds of thousands of rows
        return np.array([column(record) for *_, column in parts]).T

    return Term(
        name=name,
        sentence=sentence,
        place="input",
        coefficients=coefficients,
        columns=memoryless(columns),
    )


def _signal(name: str) -> Callable[[Record], FloatArray]:
    return lambda r: r[name]


def _ones(record: Record) -> FloatArray:
    return np.ones(len(record))


def _bias(c: ChannelId) -> Term:
    symbol, unit = (f"ν{c.letter}", "rad/s") if c.kind == "gyro" else (f"Δf{c.letter}", "m/s²")
    name = f"{c.kind}_bias_{c.letter}"
    return _term(name, "A constant error.", [(name, symbol, unit, _ones)])


def _scale(c: ChannelId) -> Term:
    symbol = ("Θ" if c.kind == "gyro" else "Γ") + 2 * c.letter
    name = f"{c.kind}_scale_{c.letter}"
    signal = _signal(_own(c))
    return _term(name, "An error proportional to the input.", [(name, symbol, "1", signal)])


def _own(c: ChannelId) -> str:
    return f"{'w' if c.kind == 'gyro' else 'f'}_{c.letter}"


def _misalignment(c: ChannelId) -> Term | None:
    others = range(3) if c.kind == "gyro" else range(c.axis)
    letter = "w" if c.kind == "gyro" else "f"
    parts = [
        (
            f"{c.kind}_misalignment_{c.letter}{AXES[j]}",
            f"{'Θ' if c.kind == 'gyro' else 'Γ'}{c.letter}{AXES[j]}",
            "rad",
            _signal(f"{letter}_{AXES[j]}"),
        )
        for j in others
        if j != c.axis
    ]
    if not parts:
        return None
    return _term(f"{c.kind}_misalignment_{c.letter}", "The sensitive axis is turned.", parts)


def _g_sensitivity(c: ChannelId) -> Term:
    parts = [
        (
            f"gyro_g_sensitivity_{c.letter}{a}",
            f"G{c.letter}{a}",
            "rad/s/(m/s²)",
            _signal(f"f_{a}"),
        )
        for a in AXES
    ]
    sentence = "The drift changes with the specific force (dynamic drift)."
    return _term(f"gyro_g_sensitivity_{c.letter}", sentence, parts)


def _asymmetry(c: ChannelId) -> Term:
    name = f"gyro_scale_asymmetry_{c.letter}"
    sentence = "The scale factor differs between turning one way and the other."
    own = _own(c)
    return _term(name, sentence, [(name, f"Θ±{c.letter}", "1", lambda r: np.abs(r[own]))])


def _second_order(c: ChannelId) -> Term:
    name = f"accel_second_order_{c.letter}"
    own = _own(c)
    sentence = "The output has a part proportional to the input squared."
    return _term(name, sentence, [(name, f"K2{c.letter}", "1/(m/s²)", lambda r: r[own] ** 2)])


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
    sentence = "The sensing mass stands off the centre of rotation and feels its acceleration."
    return _term(f"lever_arm_{c.letter}", sentence, parts)


def _delay(c: ChannelId) -> Term:
    name = f"accel_delay_{c.letter}"

    def late(record: Record) -> FloatArray:
        # gravity stands still: in the body it changes by f × ω
        j, k = AXES[(c.axis + 1) % 3], AXES[(c.axis + 2) % 3]
        return record[f"f_{k}"] * record[f"w_{j}"] - record[f"f_{j}"] * record[f"w_{k}"]

    sentence = "The accelerometer's readings are later than the gyros'."
    return _term(name, sentence, [(name, f"τ{c.letter}", "s", late)])


def _warm(term: Term) -> Term:
    return replace(term, needs=frozenset(["x_c"]))


def _temperature_bias(c: ChannelId) -> Term:
    gyro = c.kind == "gyro"
    name = f"gyro_temperature_drift_{c.letter}" if gyro else f"accel_temperature_bias_{c.letter}"
    unit = "rad/s/°C" if gyro else "m/s²/°C"
    symbol = f"{'ν' if gyro else 'Δf'}T{c.letter}"
    sentence = "The constant error changes with temperature."
    return _warm(_term(name, sentence, [(name, symbol, unit, _signal("x_c"))]))


def _temperature_scale(c: ChannelId) -> Term:
    name = f"accel_temperature_scale_{c.letter}"
    own = _own(c)
    sentence = "The scale factor changes with temperature."

    def warmed(record: Record) -> FloatArray:
        return record["x_c"] * record[own]

    return _warm(_term(name, sentence, [(name, f"ΓT{c.letter}", "1/°C", warmed)]))


def _time_offset(c: ChannelId) -> Term:
    del c
    sentence = "The rig's clock is ahead: its angle belongs to a later time."
    return _term(
        TIME_OFFSET,
        sentence,
        [(TIME_OFFSET, "τ", "s", _signal("turn_rad_s"))],
    )


def _periodic(record: Record, order: int, quarter: float) -> FloatArray:
    return np.sin(order * record["angle_rad"] + quarter)


def harmonic(order: int) -> Callable[[ChannelId], Term]:
    """Return the maker of the angle's error of `order` periods a turn."""

    def make(c: ChannelId) -> Term:
        del c
        parts = [
            (
                f"rig_angle_harmonic_{order}_{part}",
                f"κ{order}{part[0]}",
                "rad",
                partial(_periodic, order=order, quarter=quarter),
            )
            for part, quarter in (("sin", 0.0), ("cos", 0.5 * np.pi))
        ]
        sentence = f"The encoder's error has {order} period(s) a turn."
        return _term(f"rig_angle_harmonic_{order}", sentence, parts)

    return make


# group: the kinds of channel it belongs to, and how its term is made for a channel
GROUPS: dict[str, tuple[tuple[Kind, ...], Maker]] = {
    "gyro_bias": (("gyro",), _bias),
    "gyro_scale": (("gyro",), _scale),
    "gyro_misalignment": (("gyro",), _misalignment),
    "gyro_g_sensitivity": (("gyro",), _g_sensitivity),
    "gyro_scale_asymmetry": (("gyro",), _asymmetry),
    "gyro_temperature_drift": (("gyro",), _temperature_bias),
    "accel_bias": (("accel",), _bias),
    "accel_scale": (("accel",), _scale),
    "accel_misalignment": (("accel",), _misalignment),
    "accel_second_order": (("accel",), _second_order),
    "lever_arm": (("accel",), _lever_arm),
    "accel_delay": (("accel",), _delay),
    "accel_temperature_bias": (("accel",), _temperature_bias),
    "accel_temperature_scale": (("accel",), _temperature_scale),
    TIME_OFFSET: (("angle",), _time_offset),
    "rig_angle_harmonic": (("angle",), harmonic(1)),
    "rig_angle_harmonic_2": (("angle",), harmonic(2)),
}
# What the article estimates; all else is added by name.
BASIC = (
    "gyro_bias",
    "gyro_scale",
    "gyro_misalignment",
    "accel_bias",
    "accel_scale",
    "accel_misalignment",
)


def bias_step(kind: Kind, at_s: float) -> Maker:
    """Return the maker of a step of the constant error at a time since the run began."""

    def after(record: Record) -> FloatArray:
        return (record["elapsed_s"] > at_s).astype(float)

    def make(c: ChannelId) -> Term | None:
        if c.kind != kind:
            return None
        name, unit = f"{kind}_bias_step_{c.letter}", "rad/s" if kind == "gyro" else "m/s²"
        term = _term(name, "The constant error jumped.", [(name, f"Δ{c.letter}", unit, after)])
        return replace(term, needs=frozenset(["elapsed_s"]), predictive=False)

    return make


def fading(since_s: FloatArray, tau_s: float, span_s: float) -> FloatArray:
    """Return a course that rises by one over a run: evenly, or fading with a time constant."""
    inside = np.clip(since_s, 0.0, span_s)
    if not np.isfinite(tau_s):
        return inside / span_s
    return np.expm1(-inside / tau_s) / np.expm1(-span_s / tau_s)


def bias_drift(kind: Kind, tau_s: float, span_s: float) -> Maker:
    """Return the maker of a drift of the constant error over a run, zero in its mean."""
    share = tau_s / span_s
    mean = 0.5 if not np.isfinite(tau_s) else -1.0 / np.expm1(-1.0 / share) - share

    def course(record: Record) -> FloatArray:
        return fading(record["elapsed_s"], tau_s, span_s) - mean

    def make(c: ChannelId) -> Term | None:
        if c.kind != kind:
            return None
        name, unit = f"{kind}_bias_drift_{c.letter}", "rad/s" if kind == "gyro" else "m/s²"
        term = _term(name, "The constant error drifts.", [(name, f"δ{c.letter}", unit, course)])
        return replace(term, needs=frozenset(["elapsed_s"]), predictive=False)

    return make


def terms_of(
    channel: ChannelId, groups: Sequence[str], more: Sequence[Maker] = ()
) -> tuple[Term, ...]:
    """Return a channel's terms out of groups, and those that makers of one's own give it.

    Raises
    ------
    KeyError
        If there is no such group; the message lists the groups.
    """
    made: list[Term] = []
    for group in groups:
        if group not in GROUPS:
            raise KeyError(f"no group {group!r}; known: {', '.join(GROUPS)}")
        kinds, make = GROUPS[group]
        term = make(channel) if channel.kind in kinds else None
        if term is not None:
            made.append(term)
    return (*made, *(t for t in (make(channel) for make in more) if t is not None))
