"""A chamber campaign: what the programme, the head and the room do, on the times of the readings.

The air follows the programme with a regulator's ripple, a fixture follows the air, the case of the
accelerometer follows the fixture. So the rate of the case's temperature is no measure of air minus
case, as it would be with one pole alone.
"""

import itertools
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

STEP_S = 2.0  # of the integration
T_REF_C = 25.0
MOST_READINGS = 24_000  # of one accelerometer in one set
POSITIONS = {2: (90, 270), 4: (0, 90, 180, 270), 6: (0, 60, 120, 180, 240, 300)}
POSITIONS[12] = tuple(range(0, 360, 30))
STYLES = ("ramp", "stairs", "inner")
RANGES = ("full", "narrow", "asymmetric")


@dataclass(frozen=True, slots=True, kw_only=True)
class Protocol:
    """How a campaign is run; drawn by `draw_protocol`."""

    style: str
    span: str
    low_c: float
    high_c: float
    runs: int
    rates_c_per_min: tuple[float, ...]  # of each run, the unseen one last
    starts_h: tuple[float, ...]  # since midnight of the first day, the unseen one last
    positions: int
    random_order: bool
    dwell_s: float
    interval_s: float
    hold_s: float
    air_s: float
    fixture_s: float
    case_s: float
    ripple_c: float
    ripple_s: float

    @property
    def mixed_rates(self) -> bool:
        return len(set(self.rates_c_per_min[:-1])) > 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Campaign:
    """Signals on the readings of all runs, the unseen one last.

    `signals` holds, each of shape (n,): `t_s` since the run began, `elapsed_h` since the first
    began, `temp_c` of the case, `rate` of it in °C/min, `chamber_c`, `theta` in degrees, `moving`,
    `since_move_s`, `move_deg` (signed, of the last move), `before` (position before it),
    `since_ramp_s` (since the programme changed its rate), `heading` (sign of the programme's last
    ramp), `turn_c` (where it last turned), `rest_h`, `hour` of the day, `supply_v`.
    """

    protocol: Protocol
    run: NDArray[np.int64]
    signals: dict[str, Floats] = field(repr=False)

    def __getitem__(self, name: str) -> Floats:
        return self.signals[name]

    @property
    def x(self) -> Floats:
        return self["temp_c"] - T_REF_C

    @property
    def a_i(self) -> Floats:
        return np.sin(np.radians(self["theta"]))

    @property
    def a_p(self) -> Floats:
        return np.cos(np.radians(self["theta"]))

    @property
    def unseen(self) -> NDArray[np.bool_]:
        return self.run == self.protocol.runs


def draw_protocol(rng: np.random.Generator, **fixed: object) -> Protocol:
    """Draw a protocol; `fixed` are values that are not drawn."""
    runs = int(rng.choice([2, 3, 4, 5, 6, 8, 12, 20, 30], p=_RUN_SHARES))
    runs = int(fixed.get("runs", runs))  # type: ignore[call-overload]
    style = str(rng.choice(STYLES, p=[0.5, 0.3, 0.2]))
    span = str(rng.choice(RANGES, p=[0.5, 0.2, 0.3]))
    low, high = {
        "full": (-40.0, 70.0),
        "narrow": (float(m := rng.integers(0, 41)), m + 20.0),
        "asymmetric": ((-10.0, 75.0), (-55.0, 15.0), (20.0, 85.0))[int(rng.integers(3))],
    }[span]
    slowest = 0.3 if span == "narrow" else 0.7 if runs <= 6 else 1.5
    rates = slowest * np.exp(rng.uniform(0, np.log(4), runs + 1))
    if rng.random() < 0.5:
        rates[:] = rates[0]
    rests = rng.choice([1.0, 3.0, 8.0, 14.0, 40.0], runs) * rng.uniform(0.7, 1.4, runs)
    interval = float(rng.choice([5, 10, 20, 30, 60]))
    values: dict[str, object] = {
        "style": style,
        "span": span,
        "low_c": low,
        "high_c": high,
        "runs": runs,
        "rates_c_per_min": tuple(np.round(rates, 2).tolist()),
        "starts_h": tuple(np.round(rests, 2).tolist()),  # rests so far; starts once runs are known
        "positions": int(rng.choice([2, 4, 6, 12], p=[0.2, 0.3, 0.25, 0.25])),
        "random_order": bool(rng.random() < 0.5),
        "dwell_s": 60.0 * int(rng.integers(3, 13)),
        "interval_s": interval,
        "hold_s": 60.0 * int(rng.integers(10, 50)),
        "air_s": float(rng.uniform(30, 120)),
        "fixture_s": float(rng.uniform(120, 900)),
        "case_s": float(rng.uniform(60, 400)),
        "ripple_c": float(rng.choice([0.0, 0.2, 1.0, 2.5])),
        "ripple_s": float(rng.uniform(240, 1200)),
    }
    values.update(fixed)
    return _feasible(values, float(rng.uniform(0, 24)))


_RUN_SHARES = [0.16, 0.1, 0.26, 0.1, 0.16, 0.08, 0.06, 0.04, 0.04]


def _feasible(values: dict[str, object], first_h: float) -> Protocol:
    """Set the starts, and lengthen interval and dwell so that the readings are not too many."""
    draft = Protocol(**values)  # type: ignore[arg-type]
    lengths = [len(_programme(draft, k)) * STEP_S for k in range(draft.runs + 1)]
    starts = [first_h]
    for length, rest in zip(lengths, draft.starts_h, strict=False):
        starts.append(starts[-1] + length / 3600 + rest)
    fewest = sum(lengths) / MOST_READINGS
    interval = next((s for s in (5.0, 10.0, 20.0, 30.0, 60.0) if s >= draft.interval_s), 60.0)
    while interval < fewest:
        interval *= 2
    changed = {
        "starts_h": tuple(round(s, 4) for s in starts),
        "interval_s": interval,
        "dwell_s": max(draft.dwell_s, 6 * interval),
    }
    return Protocol(**{**values, **changed})  # type: ignore[arg-type]


def _waypoints(p: Protocol) -> list[float]:
    """Temperatures at which the programme holds, in order."""
    if p.style == "stairs":
        steps = max(3, round((p.high_c - p.low_c) / (4.0 if p.span == "narrow" else 15.0)))
        up = np.linspace(p.low_c, p.high_c, steps + 1).tolist()
        return up + up[-2::-1]
    if p.style == "inner":
        width = p.high_c - p.low_c
        return [p.low_c + width * f for f in (0.0, 1.0, 0.4, 0.8, 0.0, 0.6, 0.0)]
    return [p.low_c, p.high_c, p.low_c]


def _programme(p: Protocol, run: int) -> Floats:
    """Set points of a run every STEP_S."""
    points = _waypoints(p)
    if p.style == "ramp" and run % 3 == 2 and p.span != "narrow":
        points = [p.high_c, p.low_c, p.high_c]  # every third run begins hot
    per_step = p.rates_c_per_min[run] * STEP_S / 60
    hold = np.full(max(1, round(p.hold_s / STEP_S)), 1.0)
    parts = [points[0] * hold]
    for start, end in itertools.pairwise(points):
        n = max(1, round(abs(end - start) / per_step))
        parts += [np.linspace(start, end, n + 1)[1:], end * hold]
    return np.concatenate(parts)


def pole(values: Floats, tau_s: float, step_s: float = STEP_S) -> Floats:
    """Follow a series with one time constant, settled on its first value at the start."""
    keep = np.exp(-step_s / tau_s)
    state, out = float(values[0]), []
    for value in values.tolist():
        state = value + (state - value) * keep
        out.append(state)
    return np.array(out)


def _visits(p: Protocol, rng: np.random.Generator, length_s: float) -> tuple[Floats, Floats]:
    """Return when each visit of a position begins, and its angle; the first visit is at 0."""
    angles = np.array(POSITIONS[p.positions], dtype=float)
    n = int(length_s / p.dwell_s) + 2
    if not p.random_order:
        return np.arange(n) * p.dwell_s, angles[np.arange(n) % len(angles)]
    order = [int(rng.integers(len(angles)))]
    while len(order) < n:
        k = int(rng.integers(len(angles)))
        if k != order[-1]:
            order.append(k)
    return np.arange(n) * p.dwell_s, angles[order]


def make_campaign(p: Protocol, rng: np.random.Generator) -> Campaign:
    """Run a protocol."""
    supply = _supply(rng)
    parts = [_one_run(p, k, rng) for k in range(p.runs + 1)]
    signals = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    signals["supply_v"] = supply(signals["elapsed_h"])
    run = np.repeat(np.arange(p.runs + 1), [len(part["t_s"]) for part in parts])
    return Campaign(protocol=p, run=run, signals=signals)


def _one_run(p: Protocol, run: int, rng: np.random.Generator) -> dict[str, Floats]:
    setpoint = _programme(p, run)
    fine = np.arange(len(setpoint)) * STEP_S
    phase = rng.uniform(0, 2 * np.pi)
    ripple = p.ripple_c * np.sin(2 * np.pi * fine / p.ripple_s + phase)
    air = pole(setpoint, p.air_s) + ripple
    case = pole(pole(air, p.fixture_s), p.case_s)
    t = np.arange(0.0, fine[-1], p.interval_s)
    at = np.round(t / STEP_S).astype(int)
    t = fine[at]
    t, first = np.unique(t, return_index=True)
    at = at[first]
    slope = np.diff(setpoint, prepend=setpoint[0])
    turned = np.abs(np.diff(slope, prepend=slope[0])) > 1e-9
    last_change = np.maximum.accumulate(np.where(turned, fine, 0.0))
    sign = np.sign(np.round(slope, 9))
    ramp_index = np.maximum.accumulate(np.where(sign != 0, np.arange(len(sign)), 0))
    heading = sign[ramp_index]
    turns = np.maximum.accumulate(
        np.where(np.diff(heading, prepend=0.0) != 0, np.arange(len(sign)), 0)
    )
    start, angle = _visits(p, rng, fine[-1])
    visit = np.searchsorted(start, t, side="right") - 1
    earlier = np.maximum(visit - 1, 0)
    move = (angle[visit] - angle[earlier] + 180.0) % 360.0 - 180.0
    move = np.where(move == -180.0, 180.0, move)
    in_visit = t - start[visit]
    travel = np.abs(move) / 20.0  # at 20 degrees a second
    begin_h = p.starts_h[run]
    rest = begin_h - p.starts_h[run - 1] - _length_h(p, run - 1) if run else 24.0
    return {
        "t_s": t,
        "elapsed_h": begin_h - p.starts_h[0] + t / 3600,
        "temp_c": case[at],
        "rate": np.gradient(case, STEP_S)[at] * 60,
        "chamber_c": air[at],
        "theta": angle[visit],
        "moving": (in_visit < travel).astype(float),
        "since_move_s": np.where(visit == 0, 1e6, np.maximum(in_visit - travel, 0.0)),
        "move_deg": np.where(visit == 0, 0.0, move),
        "before": angle[earlier],
        "since_ramp_s": (fine - last_change)[at],
        "heading": heading[at],
        "turn_c": setpoint[turns][at],
        "rest_h": np.full(len(t), rest),
        "hour": (begin_h + t / 3600) % 24,
    }


def _length_h(p: Protocol, run: int) -> float:
    return len(_programme(p, run)) * STEP_S / 3600


def _supply(rng: np.random.Generator):
    """Return a supply voltage over hours: a slow wander with a charger that comes and goes."""
    periods, phases = rng.uniform(1.5, 30, 4), rng.uniform(0, 2 * np.pi, 4)
    every, share = rng.uniform(2, 7), rng.uniform(0.3, 0.6)

    def volts(hours: Floats) -> Floats:
        waves = np.sin(2 * np.pi * hours[:, None] / periods + phases).sum(axis=1)
        return 15.0 + 0.05 * waves + 0.1 * ((hours / every) % 1 < share)

    return volts
