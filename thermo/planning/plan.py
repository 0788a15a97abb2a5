"""A sequence and a station made into a plan: every slot with its time, temperature and position."""

from collections import Counter
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drivers.station import StationConfig
from errormodel.errors import InputError
from thermo.planning.bounds import PLAUSIBLE_C, SEQUENCE, STATION, beyond, unguarded, unprotecting
from thermo.planning.legs import FloatArray, Leg, commanded_c, expand, lagged_c, leg_at
from thermo.planning.sequence import Positions, Sequence

CASE_LAG_S = 300.0  # assumed: how slowly an accelerometer's case follows the programme
HEAD_START_S = 0.5  # assumed: what a head needs to begin and end a move beyond angle/speed
MAX_SLOTS = 2_000_000  # all runs; a period of 0.1 s for more than two days


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RunPlan:
    """One run expanded; arrays of one element per slot.

    `temp_c` is predicted: the commanded temperature behind one lag. Together with `time_s` and
    `position_deg` it is what a model needs to foresee how well it can be fitted.
    """

    number: int
    time_s: FloatArray
    segment: NDArray[np.intp]
    position_deg: FloatArray
    commanded_c: FloatArray
    temp_c: FloatArray


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Plan:
    """The whole test; durations in s.

    `approach_s` is the expected way from the safe temperature to the first reading, `total_s`
    includes it before every run, and the rests.
    """

    sequence: Sequence
    station: StationConfig
    legs: tuple[Leg, ...]
    slots: int
    scan_s: float
    approach_s: float
    rest_temp_c: float
    chamber_limits_c: tuple[float, float]
    accelerometer_limits_c: tuple[float, float]

    @property
    def runs(self) -> int:
        """Number of runs; of a run-in the most there can be."""
        return runs_of(self.sequence)

    @property
    def run_s(self) -> float:
        """Duration of one run's programme, s."""
        return self.legs[-1].end_s

    @property
    def rest_s(self) -> float:
        """Rest between runs, s."""
        return 3600 * self.sequence.temperature.rest_h

    @property
    def total_s(self) -> float:
        """Expected duration of the test, s."""
        return self.runs * (self.approach_s + self.run_s) + (self.runs - 1) * self.rest_s

    @property
    def readings(self) -> int:
        """Readings of all accelerometers in all runs, if no slot is missed."""
        return self.runs * self.slots * len(self.sequence.accelerometers)

    def run(self, number: int, lag_s: float = CASE_LAG_S) -> RunPlan:
        """Spell out one run.

        Parameters
        ----------
        number : int
            1 for the first; a random order of positions differs from run to run.
        lag_s : float
            Time constant of the predicted temperature, s.

        Returns
        -------
        RunPlan
        """
        time_s = np.arange(self.slots, dtype=np.float64) * self.sequence.sampling.period_s
        segment = leg_at(self.legs, time_s)
        return RunPlan(
            number=number,
            time_s=time_s,
            segment=segment,
            position_deg=_positions(self.sequence, self.legs, segment, number),
            commanded_c=commanded_c(self.legs, time_s),
            temp_c=lagged_c(self.legs, time_s, lag_s),
        )


def runs_of(sequence: Sequence) -> int:
    """Return how many runs a sequence asks for; of a run-in the most there can be."""
    rule = sequence.run_in
    return sequence.temperature.repeats if rule is None else rule.max_cycles


def make_plan(sequence: Sequence, station: StationConfig, source: str = "sequence") -> Plan:
    """Check a sequence against a station and make the plan.

    Parameters
    ----------
    sequence : Sequence
    station : StationConfig
    source : str
        The sequence's file, for messages.

    Returns
    -------
    Plan

    Raises
    ------
    InputError
        When the station cannot do what the sequence asks, with the numbers.
    """
    _check_bounds(sequence, station, source)
    legs = expand(sequence.temperature)
    period_s = sequence.sampling.period_s
    periods = legs[-1].end_s / period_s  # inf where a rate or a period is next to nothing
    runs = runs_of(sequence)
    if periods * runs > MAX_SLOTS:
        problem = f"{runs} × {periods:.0f} slots of {period_s:g} s, at most {MAX_SLOTS} expected"
        raise InputError(source, "sampling.period_s", problem)
    slots = int(np.ceil(periods - 1e-9))
    limits = sequence.limits
    chamber_c = limits.chamber_c or station.chamber.limits_c
    own_c = limits.accelerometer_c or (chamber_c[0] - 10, chamber_c[1] + 10)
    programme = sequence.temperature
    rest_c = programme.rest.temp_c
    way_s = 60 * abs(programme.start_c - station.chamber.safe_temp_c) / programme.approach_c_per_min
    plan = Plan(
        sequence=sequence,
        station=station,
        legs=legs,
        slots=slots,
        scan_s=_scan_s(sequence, station),
        approach_s=way_s + 60 * programme.start_soak_min,
        rest_temp_c=station.chamber.safe_temp_c if rest_c is None else rest_c,
        chamber_limits_c=chamber_c,
        # beyond what a thermistor can show nothing would be limited
        accelerometer_limits_c=(max(own_c[0], PLAUSIBLE_C[0]), min(own_c[1], PLAUSIBLE_C[1])),
    )
    _check_wiring(plan, source)
    _check_temperatures(plan, source)
    _check_start(plan, way_s, source)
    _check_head(plan, source)
    return plan


def _check_bounds(sequence: Sequence, station: StationConfig, source: str) -> None:
    problem = beyond(sequence, SEQUENCE) or unprotecting(sequence)
    if problem is not None:
        raise InputError(source, *problem)
    problem = beyond(station, STATION) or unguarded(station)
    if problem is not None:
        raise InputError(f"station {station.name!r}", *problem)


def _scan_s(sequence: Sequence, station: StationConfig) -> float:
    """Return the duration of one scan, s: an output and a thermistor of each accelerometer."""
    channel_s = station.digitiser.nplc / 50 + sequence.sampling.switch_s
    return 2 * len(sequence.accelerometers) * channel_s


def _check_wiring(plan: Plan, source: str) -> None:
    wired = {entry.serial for entry in plan.station.inputs}
    for index, accelerometer in enumerate(plan.sequence.accelerometers):
        if accelerometer.serial not in wired:
            known = ", ".join(sorted(wired))
            problem = f"{accelerometer.serial!r} is not wired in the station, which has {known}"
            raise InputError(source, f"accelerometers.{index}.serial", problem)


def _check_temperatures(plan: Plan, source: str) -> None:
    station = plan.station.chamber
    asked = plan.chamber_limits_c
    if asked[0] < station.limits_c[0] or asked[1] > station.limits_c[1]:
        raise InputError(
            source,
            "limits.chamber_c",
            f"{asked[0]:g}…{asked[1]:g} °C is wider than the station's "
            f"{station.limits_c[0]:g}…{station.limits_c[1]:g} °C",
        )
    named = [("temperature.start_c", plan.sequence.temperature.start_c)]
    named += [(f"temperature, segment {leg.index} expanded", leg.end_c) for leg in plan.legs]
    named += [("temperature.rest.temp_c", plan.rest_temp_c)]
    pairs = (("limits.chamber_c", asked), ("limits.accelerometer_c", plan.accelerometer_limits_c))
    for key, (low, high) in pairs:
        for place, value in named:
            if not low <= value <= high:
                problem = f"{value:g} °C is outside {key} {low:g}…{high:g} °C"
                raise InputError(source, place, problem)
    slow, fast = station.rate_limits_c_per_min
    for leg in plan.legs:
        rate = abs(leg.rate_c_per_min)
        if leg.is_ramp and not slow * (1 - 1e-9) <= rate <= fast * (1 + 1e-9):
            place = f"temperature, segment {leg.index} expanded"
            problem = f"{rate:g} °C/min is outside the station's {slow:g}…{fast:g} °C/min"
            raise InputError(source, place, problem)


def _check_start(plan: Plan, way_s: float, source: str) -> None:
    programme = plan.sequence.temperature
    if way_s > 60 * programme.start_timeout_min:
        raise InputError(
            source,
            "temperature.start_timeout_min",
            f"{programme.start_timeout_min:g} min is too short: from the safe "
            f"{plan.station.chamber.safe_temp_c:g} °C to start_c {programme.start_c:g} °C at "
            f"approach_c_per_min {programme.approach_c_per_min:g} takes {way_s / 60:g} min",
        )


def _check_head(plan: Plan, source: str) -> None:
    low, high = plan.station.head.limits_deg
    sequence = plan.sequence
    chosen = [sequence.positions, *(leg.positions for leg in plan.legs if leg.positions)]
    for angle in (angle for positions in chosen for angle in positions.angles_deg):
        if not low <= angle <= high:
            problem = f"{angle:g}° is outside the station's {low:g}…{high:g}°"
            raise InputError(source, "positions.angles_deg", problem)
    # a random order brings every pair sooner or later: the widest counts, not the luck of a seed
    angles = [angle for positions in chosen for angle in positions.angles_deg]
    fixed = len(chosen) == 1 and sequence.positions.order == "fixed"
    pairs = pairwise([*angles, angles[0]]) if fixed else [(min(angles), max(angles))]
    turn_deg = max(abs(b - a) for a, b in pairs)
    speed = plan.station.head.speed_deg_per_s
    move_s = turn_deg / speed + HEAD_START_S if turn_deg else 0.0
    settle_s = sequence.sampling.settle_s if turn_deg else 0.0
    needed_s = move_s + settle_s + plan.scan_s
    if sequence.sampling.period_s < needed_s:
        raise InputError(
            source,
            "sampling.period_s",
            f"{sequence.sampling.period_s:g} s is too short: the widest move of {turn_deg:g}° at "
            f"{speed:g} °/s takes {move_s:.3g} s, settling {settle_s:g} s, a scan "
            f"{plan.scan_s:.3g} s, together {needed_s:.3g} s",
        )


def visit_order(positions: Positions, run: int, count: int, stream: int = 0) -> FloatArray:
    """Return the angles in the order they are visited.

    Parameters
    ----------
    positions : Positions
    run, stream : int
        A random order depends on both and on the seed, and on nothing else.
    count : int
        How many visits; a longer order begins with a shorter one.

    Returns
    -------
    ndarray, shape (count,)
        °; each angle `readings_per_position` times in a row.
    """
    angles = np.array(positions.angles_deg, dtype=np.float64)
    rounds = -(-count // (angles.size * positions.readings_per_position))
    visits = np.tile(angles, (rounds, 1))
    if positions.order == "random":
        rng = np.random.default_rng([positions.seed, run, stream])
        visits = rng.permuted(visits, axis=1)
    return np.repeat(visits.ravel(), positions.readings_per_position)[:count]


def _positions(
    sequence: Sequence, legs: tuple[Leg, ...], segment: NDArray[np.intp], run: int
) -> FloatArray:
    """Give every slot its position; segments without positions of their own share one order."""
    own = {leg.index: leg.positions for leg in legs if leg.positions}
    shared = ~np.isin(segment, list(own))
    position_deg = np.empty(segment.size)
    position_deg[shared] = visit_order(sequence.positions, run, int(shared.sum()))
    for index, positions in own.items():
        mine = segment == index
        position_deg[mine] = visit_order(positions, run, int(mine.sum()), index + 1)
    return position_deg


def coverage(plan: Plan, bin_c: float = 10.0) -> dict[tuple[float, float], int]:
    """Count the slots of all runs by temperature and position.

    Parameters
    ----------
    plan : Plan
    bin_c : float
        Width of a temperature bin, °C.

    Returns
    -------
    dict
        (lower edge of the bin in °C, position in °) to the number of slots.
    """
    counts: Counter[tuple[float, float]] = Counter()
    for number in range(1, plan.runs + 1):
        run = plan.run(number)
        bins = np.floor(run.temp_c / bin_c + 1e-9).astype(np.int64)
        angles, which = np.unique(run.position_deg, return_inverse=True)
        lowest = int(bins.min())
        cells = np.bincount((bins - lowest) * angles.size + which.ravel())
        for cell in cells.nonzero()[0].tolist():
            edge, at = divmod(cell, angles.size)
            counts[(edge + lowest) * bin_c, float(angles[at])] += int(cells[cell])
    return dict(counts)
