"""Effects that are in no library of today: what each adds, what it follows, what it needs.

`factors` are what the error follows, in plain words of the score's table; where two are given the
effect needs both, and either alone is right to say. `names` are words by which a later library
may call it rightly.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.second.campaign import Campaign

Floats = NDArray[np.float64]
Drawn = tuple[Floats, dict[str, float]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Outside:
    """One kind: `make` returns a column in µg for a size of one, and its parameters."""

    factors: tuple[str, ...]
    make: Callable[[Campaign, np.random.Generator], Drawn]
    names: tuple[str, ...] = ()
    needs: dict[str, tuple[object, ...]] = field(default_factory=dict)  # one value is drawn
    column: str = ""  # that must be recorded


def _range(c: Campaign, rng: np.random.Generator, low: float, high: float) -> float:
    p = c.protocol
    return float(p.low_c + (p.high_c - p.low_c) * rng.uniform(low, high))


def _settling(c: Campaign, rng: np.random.Generator) -> Drawn:
    tau = float(rng.uniform(10, 100))
    return np.exp(-c["since_move_s"] / tau), {"tau_s": tau}


def _friction(c: Campaign, rng: np.random.Generator) -> Drawn:
    power = float(rng.choice([0.0, 0.5]))
    move = c["move_deg"]
    return np.sign(move) * (np.abs(move) / 90) ** power, {"power_of_size": power}


def _heat_flow(c: Campaign, rng: np.random.Generator) -> Drawn:
    return c["chamber_c"] - c["temp_c"], {}


def _kink(c: Campaign, rng: np.random.Generator) -> Drawn:
    at = _range(c, rng, 0.3, 0.7)
    return np.maximum(c["temp_c"] - at, 0.0), {"at_c": at}


def _daily(c: Campaign, rng: np.random.Generator) -> Drawn:
    phase = float(rng.uniform(0, 24))
    return np.sin(2 * np.pi * (c["hour"] - phase) / 24), {"phase_h": phase}


def _working_hours(c: Campaign, rng: np.random.Generator) -> Drawn:
    begin, length = float(rng.uniform(6, 10)), float(rng.uniform(3, 9))
    on = (c["hour"] - begin) % 24 < length
    return on.astype(float), {"from_h": begin, "for_h": length}


def _sine(c: Campaign, rng: np.random.Generator) -> Drawn:
    wide = c.protocol.high_c - c.protocol.low_c
    period = float(min(rng.uniform(8, 25), wide / 2.5))
    phase = rng.uniform(0, 2 * np.pi)
    return np.sin(2 * np.pi * c["temp_c"] / period + phase), {"period_c": period}


def _supply(c: Campaign, rng: np.random.Generator) -> Drawn:
    return (c["supply_v"] - 15.0) / 0.1, {}


def _bump(c: Campaign, rng: np.random.Generator) -> Drawn:
    at, width = _range(c, rng, 0.2, 0.8), float(rng.uniform(1.0, 4.0))
    return np.exp(-0.5 * ((c["temp_c"] - at) / width) ** 2), {"at_c": at, "width_c": width}


def _heating_step(c: Campaign, rng: np.random.Generator) -> Drawn:
    at = _range(c, rng, 0.3, 0.7)
    up = float(rng.choice([-1.0, 1.0]))
    return ((c["heading"] == up) & (c["temp_c"] > at)).astype(float), {"at_c": at, "heading": up}


def _position_before(c: Campaign, rng: np.random.Generator) -> Drawn:
    phase = float(rng.uniform(0, 360))
    return np.sin(np.radians(c["before"] - phase)), {"phase_deg": phase}


def _since_ramp(c: Campaign, rng: np.random.Generator) -> Drawn:
    tau = float(rng.uniform(200, 900))
    return np.exp(-c["since_ramp_s"] / tau), {"tau_s": tau}


def _turning(c: Campaign, rng: np.random.Generator) -> Drawn:
    return (c["turn_c"] - c.protocol.low_c) / (c.protocol.high_c - c.protocol.low_c), {}


def _rest(c: Campaign, rng: np.random.Generator) -> Drawn:
    recover, decay = float(rng.uniform(4, 20)), float(rng.uniform(1200, 5000))
    fresh = 1 - np.exp(-c["rest_h"] / recover)
    return fresh * np.exp(-c["t_s"] / decay), {"recovers_h": recover, "decays_s": decay}


def _rate_times_temperature(c: Campaign, rng: np.random.Generator) -> Drawn:
    at, wide = _range(c, rng, 0.3, 0.7), c.protocol.high_c - c.protocol.low_c
    return c["rate"] * ((c["temp_c"] - at) / wide) ** 2, {"at_c": at}


def _rate_times_position(c: Campaign, rng: np.random.Generator) -> Drawn:
    return c["rate"] * c.a_p, {}


def _saturation(c: Campaign, rng: np.random.Generator) -> Drawn:
    knee, both = float(rng.uniform(0.55, 0.9)), bool(rng.random() < 0.4)
    over = np.maximum(c.a_i - knee, 0) - both * np.maximum(-c.a_i - knee, 0)
    return -over / (1 - knee), {"knee_g": knee, "both_sides": float(both)}


def _rate_dead_zone(c: Campaign, rng: np.random.Generator) -> Drawn:
    return np.abs(c["rate"]), {}


def _misalignment_slope(c: Campaign, rng: np.random.Generator) -> Drawn:
    return c.a_p * c.x / 50, {}


def _k2_slope(c: Campaign, rng: np.random.Generator) -> Drawn:
    return c.a_i**2 * c.x / 50, {}


def _in_run(c: Campaign, rng: np.random.Generator) -> Drawn:
    period = float(rng.uniform(2400, 6000))
    return np.sin(2 * np.pi * c["t_s"] / period), {"period_s": period}


MOVES = {"random_order": (True,), "positions": (4, 6, 12)}
FEW = {"runs": (2, 3, 4), "interval_s": (5.0, 10.0, 20.0)}
KINDS: dict[str, Outside] = {
    "settling_after_move": Outside(
        factors=("since_move",), make=_settling, names=("settl",), needs=FEW
    ),
    "friction_of_last_move": Outside(
        factors=("last_move",), make=_friction, names=("friction", "stiction"), needs=MOVES
    ),
    "heat_flow": Outside(
        factors=("chamber_minus_case", "rate"),
        make=_heat_flow,
        names=("heat", "chamber"),
        needs={"ripple_c": (1.0, 2.5)},
        column="chamber_c",
    ),
    "kink": Outside(factors=("temperature",), make=_kink, names=("kink",)),
    "daily_period": Outside(
        factors=("hour",), make=_daily, names=("daily", "day"), needs={"runs": (4, 6, 8)}
    ),
    "working_hours": Outside(factors=("hour",), make=_working_hours, needs={"runs": (4, 6, 8)}),
    "sine_in_temperature": Outside(factors=("temperature",), make=_sine, names=("period",)),
    "supply": Outside(factors=("supply_v",), make=_supply, names=("supply",), column="supply_v"),
    "bump": Outside(factors=("temperature",), make=_bump, names=("bump",)),
    "step_in_one_direction": Outside(factors=("temperature", "direction"), make=_heating_step),
    "position_before": Outside(factors=("position_before",), make=_position_before, needs=MOVES),
    "since_ramp_change": Outside(factors=("since_ramp_change",), make=_since_ramp),
    "turning_temperature": Outside(
        factors=("turning_temperature",), make=_turning, needs={"style": ("inner",)}
    ),
    "rest_before_run": Outside(
        factors=("rest_before_run", "time_in_run"), make=_rest, needs={"runs": (6, 8, 12)}
    ),
    "rate_times_temperature": Outside(
        factors=("rate", "temperature"), make=_rate_times_temperature
    ),
    "rate_times_position": Outside(
        factors=("rate", "position"), make=_rate_times_position, needs={"positions": (4, 6, 12)}
    ),
    "saturation": Outside(
        factors=("position",), make=_saturation, names=("saturat",), needs={"positions": (12,)}
    ),
    "rate_either_sign": Outside(factors=("rate",), make=_rate_dead_zone),
    "misalignment_over_temperature": Outside(
        factors=("position", "temperature"),
        make=_misalignment_slope,
        names=("misalign", "cross_axis_temp", "delta"),
        needs={"positions": (4, 6, 12)},
    ),
    "k2_over_temperature": Outside(
        factors=("position", "temperature"),
        make=_k2_slope,
        names=("k2", "second_order_temp"),
        needs={"positions": (4, 6, 12)},
    ),
    "oscillation_in_run": Outside(factors=("time_in_run",), make=_in_run, names=("period",)),
}
