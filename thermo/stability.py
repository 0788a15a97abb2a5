"""Run-to-run stability of accelerometers: what repeats, by how much not, and a verdict.

`judge_stability` puts together the runs' own fits (`thermo.stability_runs`), their curves
(`thermo.stability_curves`), the variance components (`thermo.stability_components`) and the limits
(`thermo.stability_limits`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.allan import AllanDeviation, allan_deviation
from errormodel.errors import InputError
from errormodel.scatter import holm
from errormodel.variance import VarianceFit
from thermo.fitting import TermsFile, fit_runs
from thermo.inputs import HOLD
from thermo.recording import RecordedRuns
from thermo.stability_coefficients import (
    CoefficientStability,
    coefficients_at,
    criteria_of,
    model_coefficients,
)
from thermo.stability_components import variance_components
from thermo.stability_curves import CurveSet, Distance, Shape, curve_sets, distance, shape_of
from thermo.stability_limits import (
    FALSE_ALARM,
    Criterion,
    Interval,
    LimitsFile,
    Verdict,
    grade_of,
    intervals,
    verdict_of,
)
from thermo.stability_runs import RunByRun, fit_run_by_run

DEFINITION = (
    "Repeatability: the agreement of repeated measurements of the same quantity under the same "
    "conditions, with changed conditions or non-operating periods between them. (Stability would "
    "be its invariance under one fixed operating condition.) Words of IEEE Std 528 from memory, "
    "not checked against the standard."
)
# Of a hold, for its Allan deviation: readings in a row, spaced evenly to within this share.
MIN_HOLD, EVEN = 24, 0.2


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AccelerometerStability:
    """One accelerometer.

    Attributes
    ----------
    runs : RunByRun
    coefficients : tuple of CoefficientStability
        Those of the model, at the reference temperature, then K0 and K1 at the others.
    curves : tuple of CurveSet
    k0_distance, k1_distance : Distance or None
    shape : Shape or None
    allan : AllanDeviation
        Of the holds; empty without any.
    trends : tuple of str
        Coefficients that move with the runs, with 5 % for one false name or more.
    criteria : tuple of Criterion
    verdict : str
    grade : str or None
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
    criteria: tuple[Criterion, ...]
    verdict: Verdict
    grade: str | None
    rank: int
    notes: tuple[str, ...]

    @property
    def serial(self) -> str:
        """Serial number."""
        return self.runs.joint.serial

    def coefficient(self, name: str) -> CoefficientStability | None:
        """Return one coefficient; None when too few runs give it."""
        return next((c for c in self.coefficients if c.name == name), None)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Stability:
    """A batch: `order` are the runs in their order, `at_c` the reference temperatures."""

    accelerometers: tuple[AccelerometerStability, ...]
    components: VarianceFit | None
    order: tuple[str, ...]
    by_time: bool
    intervals: tuple[Interval, ...]
    at_c: tuple[float, ...]
    limits: LimitsFile

    @property
    def failed(self) -> bool:
        """Whether an accelerometer fails."""
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
        Two runs or more of each accelerometer.
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
        If an accelerometer has one run only, a run cannot give K0, or the limits name something
        that is not there.
    NotSeparableError
        If the data cannot separate the terms given.
    """
    _check_runs(runs)
    wanted, asked = terms or TermsFile(), limits or LimitsFile()
    temperatures = tuple(at_c) or (wanted.t_ref_c,)
    # the head's errors are the same in every run: no part of what one run differs from another by
    wanted = wanted.model_copy(update={"t_ref_c": temperatures[0], "head_arcsec": 0.0})
    order, by_time = _order(runs)
    between = intervals(order, asked.between, runs.run_start_utc, _spans_s(runs))
    batch = tuple(
        fit_run_by_run(one, [r for r in order if r in one.channel.run_ids])
        for one in fit_runs(runs, terms=wanted, at_one_temperature=True)
    )
    judged = [_judge(one, temperatures, asked) for one in batch]
    _check_limits(judged, asked, runs.source)
    return Stability(
        accelerometers=_ranked(judged),
        components=variance_components(batch),
        order=order,
        by_time=by_time,
        intervals=between,
        at_c=temperatures,
        limits=asked,
    )


def _check_runs(runs: RecordedRuns) -> None:
    for k, serial in enumerate(runs.serials):
        mine = np.unique(runs.run.codes[(runs.serial.codes == k) & runs.good])
        if mine.size < 2:
            problem = f"{mine.size} run with good readings; run-to-run stability needs two or more"
            raise InputError(runs.source, f"serial {serial}", problem)


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


def _judge(
    one: RunByRun, temperatures: Sequence[float], limits: LimitsFile
) -> AccelerometerStability:
    coefficients = (*model_coefficients(one), *coefficients_at(one, temperatures[1:]))
    sets = curve_sets(one)
    k0_distance, k1_distance = distance(sets, "k0"), distance(sets, "k1")
    shape = shape_of(sets)
    criteria = criteria_of(coefficients, k0_distance, limits)
    p_values = {c.name: c.scatter.trend_p for c in coefficients}
    return AccelerometerStability(
        runs=one,
        coefficients=coefficients,
        curves=sets,
        k0_distance=k0_distance,
        k1_distance=k1_distance if "k1" in one.joint.fit.names else None,
        shape=shape,
        allan=_allan(one),
        trends=holm({n: p for n, p in p_values.items() if p is not None}, FALSE_ALARM),
        criteria=criteria,
        verdict=verdict_of(criteria),
        grade=grade_of(limits.grades, shape.spread_ug, shape.bend_ug) if shape else None,
        rank=0,
        notes=_notes(one, temperatures),
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
    """Refuse limits that an accelerometer cannot be held against: it would pass unjudged."""
    for one in judged:
        known = [c.name for c in one.coefficients]
        for name in limits.limits:
            if name not in known:
                problem = (
                    f"runs of serial {one.serial} do not give it; they give {', '.join(known)}"
                )
                raise InputError(source, f"limits.{name}", problem)
        if limits.curve_ug != type(limits.curve_ug)() and one.k0_distance is None:
            problem = f"runs of serial {one.serial} share no temperature in one direction"
            raise InputError(source, "curve_ug", problem)


def _ranked(judged: Sequence[AccelerometerStability]) -> tuple[AccelerometerStability, ...]:
    def spread(one: AccelerometerStability) -> float:
        return one.shape.spread_ug if one.shape else np.inf

    by_spread = sorted(judged, key=spread)
    places: Mapping[str, int] = {a.serial: k for k, a in enumerate(by_spread, 1)}
    return tuple(replace(a, rank=places[a.serial]) for a in judged)


def _notes(one: RunByRun, temperatures: Sequence[float]) -> tuple[str, ...]:
    notes: list[str] = []
    for r in one.runs:
        if r.held:
            notes.append(f"run {r.run_id} cannot give {', '.join(r.held)}: held as of all runs")
    low, high = max(r.temp_c[0] for r in one.runs), min(r.temp_c[1] for r in one.runs)
    notes += [
        f"{t:g} °C lies outside the range that all runs share, {low:.3g} to {high:.3g} °C: "
        "coefficients there are extrapolated"
        for t in temperatures
        if not low <= t <= high
    ]
    if not one.joint.channel.has_input:
        notes.append("the input is not recorded: K0 holds it too, and K1 cannot be had")
    return tuple(notes)
