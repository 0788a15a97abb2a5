"""Which rig runs the benchmark is made of: a fixed list of recipes; seeds are added by the run."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

from benchmarks.blind.rig.sets import MODES, NEED_ANGLE, PARTS, PROTOCOLS, RigRecipe
from benchmarks.blind.rig.strangers import STRANGERS

SIX = (
    "lever_arm",
    "gyro_g_sensitivity",
    "rig_time_offset",
    "gyro_scale_asymmetry",
    "accel_second_order",
    "accel_temperature_bias",
)

OTHERS = tuple(name for name in PARTS if name not in SIX)
NOT_AT_ONE_RATE = ("lever_arm", "gyro_scale_asymmetry", "rig_time_offset")
PAIRS = (
    ("lever_arm", "rig_time_offset"),
    ("gyro_g_sensitivity", "accel_second_order"),
    ("gyro_scale_asymmetry", "accel_temperature_bias"),
    ("lever_arm", "gyro_scale_asymmetry"),
    ("rig_time_offset", "gyro_g_sensitivity"),
    ("accel_second_order", "accel_temperature_bias"),
)
PAIR_D = 30.0  # of each alone; what the other leaves of it is less


def recipe(group: str, protocol: str, mode: str, **strengths: float) -> RigRecipe:
    return RigRecipe(group=group, protocol=protocol, mode=mode, strengths=strengths)


def modes_of(*names: str) -> tuple[str, ...]:
    """Return the modes in which effects can show."""
    return MODES[:1] if set(names) & set(NEED_ANGLE) else MODES


def singles(sizes: tuple[float, ...], protocol: str = "multirate") -> Iterator[RigRecipe]:
    """Yield each of the six effects at some sizes, in each mode."""
    for d, name in product(sizes, SIX):
        if protocol == "article" and name in NOT_AT_ONE_RATE:
            continue
        for mode in modes_of(name):
            yield recipe("single", protocol, mode, **{name: d})


def others(d: float) -> Iterator[RigRecipe]:
    for name in OTHERS:
        for mode in modes_of(name):
            yield recipe("other", "multirate", mode, **{name: d})


def nulls(each: int) -> Iterator[RigRecipe]:
    for protocol, mode, _ in product(PROTOCOLS, MODES, range(each)):
        yield recipe("nothing", protocol, mode)


def pairs() -> Iterator[RigRecipe]:
    for number, (one, other) in enumerate(PAIRS):
        shown = modes_of(one, other)
        yield recipe(
            "pair", "multirate", shown[number % len(shown)], **{one: PAIR_D, other: PAIR_D}
        )


def outside(*sizes: float) -> Iterator[RigRecipe]:
    for name, mode, d in product(STRANGERS, MODES, sizes):
        yield recipe("outside", "multirate", mode, **{name: d})


def full() -> list[RigRecipe]:
    """Return the whole benchmark."""
    return [
        *nulls(8),
        *singles((8.0, 12.0, 25.0)),
        *singles((12.0,), "article"),
        *others(15.0),
        *pairs(),
        *outside(40.0),
    ]


def medium() -> list[RigRecipe]:
    """Return some thirty sets of every kind, for a look while something is changed."""
    return [
        *nulls(1),
        *singles((14.0,)),
        *list(others(15.0))[::3],
        *list(pairs())[::2],
        *list(outside(40.0))[::2],
    ]


def misstated() -> list[RigRecipe]:
    """Return sets whose sidecar states other densities of noise than the true ones."""
    sets = [*nulls(4), *singles((12.0,))]
    wrong = list(product((0.7, 1.4), repeat=3))
    # three is prime to eight: neighbours, which are alike, get them all
    return [replace(r, stated=wrong[3 * k % len(wrong)]) for k, r in enumerate(sets)]


def small() -> list[RigRecipe]:
    """Return what every test run tries."""
    return [
        recipe("nothing", "multirate", "coarse"),
        recipe("single", "multirate", "precise", rig_time_offset=25.0),
        recipe("single", "multirate", "coarse", lever_arm=25.0),
    ]


RIG_PARTS = {"small": small, "medium": medium, "full": full}
