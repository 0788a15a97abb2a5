"""Run-to-run stability of accelerometers: what repeats, by how much not, and a verdict.

`judge_stability` puts together the runs' own fits (`thermo.stability.runs`), their curves
(`thermo.stability.curves`), the variance components (`thermo.stability.components`) and the limits
(`thermo.stability.limits`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from itertools import pairwise

import numpy as np

from errormodel.errors import InputError
from errormodel.noise.allan import AllanDeviation, allan_deviation
from errormodel.progress import stage, track
from errormodel.statistics.scatter import holm
from errormodel.statistics.variance import VarianceFit
from thermo.fitting.fit import TermsFile, fit_runs
from thermo.recording.channel import HOLD
from thermo.recording.files import RecordedRuns
from thermo.stability.coefficients import (
    CoefficientStability,
    coefficients_at,
    criteria_of,
    model_coefficients,
    unjudged,
)
from thermo.stability.components import variance_components
from thermo.stability.curves import CurveSet, Distance, curve_sets, distance
from thermo.stability.events import CommonEvent, common_events, without_common
from thermo.stability.limits import (
    FALSE_ALARM,
    Criterion,
    Interval,
    LimitsFile,
    Verdict,
    grades_of,
    intervals_between_runs,
    verdict_of,
)
from thermo.stability.noise import LOOPS_DIFFER
from thermo.stability.notes import LeftOutRun, comparable, notes_of
from thermo.stability.patterns import Loops, Pattern, loops_of, patterns_of
from thermo.stability.runs import RunByRun, fit_run_by_run
from thermo.stability.shape import Shape, shape_of

DEFINITION = (
    "Repeatability: the agreement of repeated measurements of the same quantity under the same "
    "conditions, with changed conditions or non-operating periods between them. (Stability would "
    "be its invariance under one fixed operating condition.) Terms as IEEE Std 528 uses them, the "
    "wording is ours."
)
# Of a hold, for its Allan deviation: readings in a row, spaced evenly to within this share.
MIN_HOLD, EVEN = 24, 0.2


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AccelerometerStability:
    """One accelerometer.

    Attributes
    ----------
    runs : RunByRun
        What all accelerometers of the batch have in common taken out.
    coefficients : tuple of CoefficientStability
        Those of the model, at the reference temperature, then K0 and K1 at the others.
    curves : tuple of CurveSet
    k0_distance, k1_distance : Distance or None
    shape : Shape or None
    allan : AllanDeviation
        Of the holds; empty without any.
    trends : tuple of str
        Coefficients that move with time (with the runs' order where their starts are not known),
        with 5 % for one false name or more.
    patterns : tuple of Pattern
        Steps and odd runs.
    loops : Loops or None
        Heating less cooling of each run.
    criteria : tuple of Criterion
    verdict : str
    grade, grade_best : str or None
        The best grade shown to be kept, and the best not excluded.
    rank : int
        1 is the best of the batch by `shape.spread_ug`.
    notes : tuple of str
    """

    runs: RunByRun
    coefficients: tuple[CoefficientStability, ...]
    curves: tuple[CurveSet, ...]
    k0_distance: Distance | None
    k1_distance: Distance | None
    shape: Shape | None
    allan: AllanDeviation
    trends: tuple[str, ...]
    patterns: tuple[Pattern, ...]
    loops: Loops | None
    criteria: tuple[Criterion, ...]
    verdict: Verdict
    grade: str | None
    grade_best: str | None
    rank: int
    notes: tuple[str, ...]

    @property
    def serial(self) -> str:
        """Serial number."""
        return self.runs.joint.serial

    @property
    def loops_differ(self) -> bool:
        """True when the loop of heating and cooling differs from run to run beyond chance."""
        return self.loops is not None and self.loops.p_value < LOOPS_DIFFER

    def coefficient(self, name: str) -> CoefficientStability | None:
        """Return one coefficient; None when too few runs give it."""
        return next((c for c in self.coefficients if c.name == name), None)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Stability:
    """A batch.

    Attributes
    ----------
    accelerometers : tuple of AccelerometerStability
    components : VarianceFit or None
    order : tuple of str
        The runs in their order.
    by_time : bool
        Whether that is by their start.
    intervals : tuple of Interval
    at_c : tuple of float
        Reference temperatures.
    limits : LimitsFile
    events : tuple of CommonEvent
        Runs in which all accelerometers moved together.
    left_out : tuple of LeftOutRun
        Accelerometers, or runs of them, that could not be compared.
    """

    accelerometers: tuple[AccelerometerStability, ...]
    components: VarianceFit | None
    order: tuple[str, ...]
    by_time: bool
    intervals: tuple[Interval, ...]
    at_c: tuple[float, ...]
    limits: LimitsFile
    events: tuple[CommonEvent, ...]
    left_out: tuple[LeftOutRun, ...]

    @property
    def failed(self) -> bool:
        """True when an accelerometer fails."""
        return any(a.verdict == "fail" for a in self.accelerometers)


def judge_stability(
    runs: RecordedRuns,
    *,
    terms: TermsFile | None = None,
    at_c: Sequence[float] = (),
    limits: LimitsFile | None = None,
) -> Stability:
    """Compare the runs of one or many accelerometers.

    Parameters
    ----------
    runs : RecordedRuns
        Two runs or more of each accelerometer; one that has fewer is left out.
    terms : TermsFile, optional
        The model; by default the data of all runs choose it.
    at_c : sequence of float
        Reference temperatures, °C; the first is that of the coefficients. Default: that of
        `terms`.
    limits : LimitsFile, optional

    Returns
    -------
    Stability

    Raises
    ------
    InputError
        If no accelerometer has two runs that can be compared, a run cannot give K0, or the limits
        name something that no accelerometer gives.
    NotSeparableError
        If the data cannot separate the terms given.
    """
    usable, left_out = comparable(runs)
    wanted, asked = terms or TermsFile(), limits or LimitsFile()
    temperatures = tuple(at_c) or (wanted.t_ref_c,)
    # the head's errors are the same in every run: no part of what one run differs from another by
    wanted = wanted.model_copy(update={"t_ref_c": temperatures[0], "head_arcsec": 0.0})
    order, by_time = _order(usable)
    spans_s = _spans_s(usable)
    between = intervals_between_runs(order, asked.between, usable.run_start_utc, spans_s)
    with stage(0.0, 0.4):
        fits = fit_runs(usable, terms=wanted, at_one_temperature=True)
    with stage(0.4, 0.8):
        batch = tuple(
            fit_run_by_run(one, [r for r in order if r in one.channel.run_ids])
            for one in track(fits)
        )
    events = common_events(batch)
    own = tuple(without_common(one, events) for one in batch)
    days = _days(order, usable.run_start_utc, spans_s) if by_time else {}
    judged = [_judge(one, temperatures, asked, days) for one in own]
    _check_limits(judged, asked, usable.source)
    return Stability(
        accelerometers=_ranked(judged),
        components=variance_components(own, events),
        order=order,
        by_time=by_time,
        intervals=between,
        at_c=temperatures,
        limits=asked,
        events=events,
        left_out=left_out,
    )


def _order(runs: RecordedRuns) -> tuple[tuple[str, ...], bool]:
    """Return the runs by their start, or as they stand in the files when that is not known."""
    starts = runs.run_start_utc
    if all(r in starts for r in runs.run_ids):
        return tuple(sorted(runs.run_ids, key=lambda r: starts[r])), True
    return runs.run_ids, False


def _spans_s(runs: RecordedRuns) -> dict[str, float]:
    last = np.zeros(len(runs.run_ids))
    np.maximum.at(last, runs.run.codes, runs.time_s)
    return dict(zip(runs.run_ids, last.tolist(), strict=True))


def _days(
    order: Sequence[str], starts: Mapping[str, datetime], spans_s: Mapping[str, float]
) -> dict[str, float]:
    """Return when runs began, d from the first.

    Nothing where one begins before the run before it has ended: they were not timed by one clock.
    """
    begun = {r: (starts[r] - starts[order[0]]).total_seconds() for r in order}
    if any(begun[b] < begun[a] + spans_s[a] for a, b in pairwise(order)):
        return {}
    return {r: s / 86400.0 for r, s in begun.items()}


def _judge(
    one: RunByRun, temperatures: Sequence[float], limits: LimitsFile, days: Mapping[str, float]
) -> AccelerometerStability:
    coefficients = (
        *model_coefficients(one, days),
        *coefficients_at(one, temperatures[1:], days),
    )
    sets = curve_sets(one)
    k0_distance, k1_distance = distance(sets, "k0"), distance(sets, "k1")
    shape = shape_of(sets)
    criteria = criteria_of(coefficients, k0_distance, limits)
    missing = unjudged(coefficients, k0_distance, limits)
    verdict = verdict_of(criteria)
    p_values = {c.name: c.scatter.trend_p for c in coefficients}
    trends = holm({n: p for n, p in p_values.items() if p is not None}, FALSE_ALARM)
    shown, possible = (
        grades_of(limits.grades, shape.spread_ci95_ug, shape.bend_ci95_ug)
        if shape
        else (None, None)
    )
    return AccelerometerStability(
        runs=one,
        coefficients=coefficients,
        curves=sets,
        k0_distance=k0_distance,
        k1_distance=k1_distance if "k1" in one.joint.fit.names else None,
        shape=shape,
        allan=_allan(one),
        trends=trends,
        patterns=patterns_of(coefficients, trends),
        loops=loops_of(one),
        criteria=criteria,
        verdict=verdict if verdict == "fail" or not missing else "undecided",
        grade=shown,
        grade_best=possible,
        rank=0,
        notes=(
            *(f"limit of {n}: its runs give no value to compare with it" for n in missing),
            *notes_of(one, temperatures),
        ),
    )


def _allan(one: RunByRun) -> AllanDeviation:
    """Return the Allan deviation of what the runs' own coefficients leave in their holds."""
    record = one.joint.channel.record
    steps = np.diff(record.time_s)
    same = (np.diff(record.run) == 0) & (one.direction[1:] == HOLD) & (one.direction[:-1] == HOLD)
    if not np.any(same):
        return allan_deviation([], 1.0)
    period_s = float(np.median(steps[same]))
    even = same & (np.abs(steps / period_s - 1.0) < EVEN)
    cuts = np.flatnonzero(~even) + 1
    pieces = [p for p in np.split(one.residual_ug, cuts) if p.size >= MIN_HOLD]
    return allan_deviation(pieces, period_s)


def _check_limits(
    judged: Sequence[AccelerometerStability], limits: LimitsFile, source: str
) -> None:
    """Refuse limits that no accelerometer can be held against."""
    known = list(dict.fromkeys(c.name for one in judged for c in one.coefficients))
    for name in limits.limits:
        if name not in known:
            serials = ", ".join(one.serial for one in judged)
            problem = f"runs of serial {serials} do not give it; they give {', '.join(known)}"
            raise InputError(source, f"limits.{name}", problem)
    apart = [one.k0_distance for one in judged]
    if limits.curve_ug != type(limits.curve_ug)() and not any(apart):
        problem = "no accelerometer's runs share a temperature in one direction"
        raise InputError(source, "curve_ug", problem)


def _ranked(judged: Sequence[AccelerometerStability]) -> tuple[AccelerometerStability, ...]:
    """Rank by spread, those alike by its upper limit."""

    def spread(one: AccelerometerStability) -> tuple[float, float]:
        return (one.shape.spread_ug, one.shape.spread_ci95_ug[1]) if one.shape else (np.inf, np.inf)

    by_spread = sorted(judged, key=spread)
    places: Mapping[str, int] = {a.serial: k for k, a in enumerate(by_spread, 1)}
    return tuple(replace(a, rank=places[a.serial]) for a in judged)
