"""Which data sets the benchmark is made of: a fixed list of recipes; seeds are added by the run."""

from collections.abc import Iterator
from itertools import cycle, product

from benchmarks.blind.chamber.effects import LIBRARY
from benchmarks.blind.chamber.truth import Recipe

NOISES = ("white+OU", "white", "white+RW", "white+flicker")
PROTOCOLS = ("P1", "P3", "P2")
ONLY_EIGHT = ("third_order", "indexer_harmonic", "output_nonlinearity")  # need 45° steps
# What a real accelerometer or rig might have: mostly the trial's sizes
NATURAL = {
    "thermal_lag": 300.0,
    "temperature_rate_bias": 20.0,
    "temperature_rate_scale": 20.0,
    "bias_hysteresis": 30.0,
    "scale_hysteresis": 30.0,
    "bias_temperature_order": 30.0,
    "scale_temperature_order": 30.0,
    "second_order": 20.0,
    "third_order": 20.0,
    "cross_axis": 20.0,
    "run_in": 100.0,
    "warm_up": 50.0,
    "turn_on_offset": 25.0,
    "bias_step": 30.0,
    "bias_drift": 5.0,
    "indexer_harmonic": 2.0,
    "output_nonlinearity": 20.0,
}
PAIRS = (
    ("thermal_lag", "second_order"),
    ("bias_hysteresis", "temperature_rate_bias"),
    ("run_in", "bias_temperature_order"),
    ("bias_hysteresis", "thermal_lag"),
    ("bias_step", "temperature_rate_bias"),
    ("cross_axis", "second_order"),
    ("scale_hysteresis", "bias_temperature_order"),
    ("warm_up", "thermal_lag"),
    ("temperature_rate_scale", "second_order"),
    ("turn_on_offset", "cross_axis"),
)
PAIR_D = 30.0  # of each alone; what the other leaves of it is less


def recipe(
    group: str,
    protocol: str,
    noise: str,
    *,
    d: dict[str, float] | None = None,
    size: dict[str, float] | None = None,
    tempco: bool = True,
) -> Recipe:
    return Recipe(
        group=group,
        protocol=protocol,
        noise=noise,
        strengths=d or {},
        sizes=size or {},
        tempco=tempco,
    )


def nulls(stationary: int, wandering: int) -> Iterator[Recipe]:
    """Yield sets with nothing hidden: so many of each noise in each protocol."""
    for noise, protocol in product(NOISES, PROTOCOLS):
        count = stationary if noise in ("white", "white+OU") else wandering
        for _ in range(count):
            yield recipe("nothing", protocol, noise)


def singles() -> Iterator[Recipe]:
    """Yield each effect of the library at six sizes, under changing noise and protocol."""
    conditions = cycle(product(PROTOCOLS, NOISES))
    for name in LIBRARY:
        for d in (8.5, 12.0, 14.0, 25.0, 40.0, None):
            protocol, noise = next(conditions)
            if name in ONLY_EIGHT and protocol == "P1":
                protocol = "P3"
            if d is None:
                yield recipe("single", protocol, noise, size={name: NATURAL[name]})
            else:
                yield recipe("single", protocol, noise, d={name: d})
        next(conditions)  # so that a size does not always meet the same condition


def pairs() -> Iterator[Recipe]:
    conditions = cycle([("P1", "white+OU"), ("P3", "white+OU"), ("P3", "white"), ("P1", "white")])
    for one, other in PAIRS:
        for _ in range(2):
            protocol, noise = next(conditions)
            yield recipe("pair", protocol, noise, d={one: PAIR_D, other: PAIR_D})
        next(conditions)


def outside() -> Iterator[Recipe]:
    for protocol, noise in product(("P1", "P3"), ("white+OU", "white")):
        for d in (25.0, 60.0):
            yield recipe("outside", protocol, noise, d={"periodic_in_temperature": d})
    for name in ("periodic_in_time", "slow_wander", "intermittent_contact"):
        for protocol, d in product(("P1", "P2", "P3"), (30.0, 80.0)):
            yield recipe("outside", protocol, "white+OU", d={name: d})


def invisible() -> Iterator[Recipe]:
    for protocol, noise in product(("P0", "P1"), ("white+OU", "white", "white+flicker")):
        yield recipe("invisible", protocol, noise, size={"third_order": 20.0})


def lags_without_tempco() -> Iterator[Recipe]:
    for tau, protocol in product((60.0, 120.0, 300.0), PROTOCOLS):
        yield recipe("slow lag", protocol, "white+OU", size={"thermal_lag": tau}, tempco=False)
    for tau, noise, protocol in product((15.0, 10.0), ("white", "white+OU"), ("P1", "P3")):
        yield recipe("fast lag", protocol, noise, size={"thermal_lag": tau}, tempco=False)


def full() -> list[Recipe]:
    """Return the whole benchmark."""
    return [
        *nulls(8, 5),
        *singles(),
        *pairs(),
        *outside(),
        *invisible(),
        *lags_without_tempco(),
    ]


def medium() -> list[Recipe]:
    """Return some forty sets of every kind, for a look while something is changed."""
    several = list(singles())
    return [
        *nulls(1, 1),
        *several[2::6],
        *list(pairs())[::4],
        *list(outside())[::5],
        *list(invisible())[::5],
        *list(lags_without_tempco())[1::6],
    ]


def small() -> list[Recipe]:
    """Return what every test run tries: a few kinds, nothing delicate."""
    return [
        recipe("nothing", "P1", "white+OU"),
        recipe("single", "P1", "white+OU", d={"temperature_rate_bias": 40.0}),
        recipe("single", "P2", "white+OU", size={"thermal_lag": 60.0}),
        recipe("pair", "P3", "white", d={"cross_axis": PAIR_D, "second_order": PAIR_D}),
        recipe("outside", "P3", "white+OU", d={"periodic_in_temperature": 60.0}),
        recipe("invisible", "P1", "white+OU", size={"third_order": 20.0}),
    ]


PARTS = {"small": small, "medium": medium, "full": full}
