"""From recorded runs to K0 and K1 of every cycle: the series that a run-in is judged by."""

from collections.abc import Sequence

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.errors import InputError, NotSeparableError
from errormodel.fit import ModelFit, fit
from errormodel.model import ErrorModel
from thermo.planning.run_in_rule import RunInRule
from thermo.recording.channel import Channel, channel_of
from thermo.recording.files import RecordedRuns
from thermo.run_in.judge import MIN_CYCLES, WINDOW, judge_run_in
from thermo.run_in.relaxation import CoefficientSeries
from thermo.run_in.verdict import RunInVerdict
from thermo.selection.orders import separable_names, usual_equation

MICRO = 1e6


def judge_runs(
    runs: RecordedRuns, rule: RunInRule, *, window: int = WINDOW
) -> tuple[RunInVerdict, ...]:
    """Judge the run-in of every accelerometer in recorded runs; each run is a cycle.

    Parameters
    ----------
    runs : RecordedRuns
    rule : RunInRule
        Limits, confidence and reference temperature.
    window : int
        Cycles at either end that make the instability before and after.

    Returns
    -------
    tuple of RunInVerdict
        In the order of the serial numbers in the runs.

    Raises
    ------
    InputError
        If an accelerometer has fewer than three runs, or a run cannot give K0 (or K1) alone.
    """
    return tuple(
        judge_run_in(
            serial,
            cycle_series(runs, serial, rule),
            confidence=rule.confidence,
            window=window,
            nothing_slow=rule.nothing_slow,
            hours=cycle_hours(runs, serial),
        )
        for serial in runs.serials
    )


def in_order(runs: RecordedRuns) -> tuple[str, ...]:
    """Return the runs as they followed one another: by their start where all are known."""
    starts = runs.run_start_utc
    if all(run in starts for run in runs.run_ids):
        return tuple(sorted(runs.run_ids, key=lambda run: starts[run]))
    return runs.run_ids


def cycle_hours(runs: RecordedRuns, serial: str) -> FloatArray | None:
    """Return when the middle of each cycle of an accelerometer was, h from the first run's start.

    None where a start is not known, or a cycle begins before the one before it has ended: such
    runs were not timed by one clock.
    """
    starts = runs.run_start_utc
    mine = (runs.serial.codes == runs.serials.index(serial)) & runs.good
    middles: list[float] = []
    ended = -np.inf
    for run in in_order(runs):
        inside = runs.time_s[mine & (runs.run.codes == runs.run_ids.index(run))]
        if inside.size == 0:
            continue
        if run not in starts:
            return None
        begun = (starts[run] - min(starts.values())).total_seconds()
        if begun < ended:
            return None
        ended = begun + float(inside.max())
        middles.append((begun + float(np.mean(inside))) / 3600.0)
    return np.array(middles)


def cycle_series(runs: RecordedRuns, serial: str, rule: RunInRule) -> tuple[CoefficientSeries, ...]:
    """Fit every run of an accelerometer alone, with one and the same model.

    Returns
    -------
    tuple of Series
        K0 in µg and, where the input is known, K1 in ppm of the nominal scale factor, at the
        rule's reference temperature, in the order of `in_order`.

    Raises
    ------
    InputError
        As for `judge_runs`.
    """
    channel = channel_of(runs, serial, t_ref_c=rule.t_ref_c)
    ordered = [run for run in in_order(runs) if run in channel.run_ids]
    place = f"serial {serial}"
    if len(ordered) < MIN_CYCLES:
        problem = f"{len(ordered)} runs; a run-in needs {MIN_CYCLES} at least, one for each cycle"
        raise InputError(runs.source, place, problem)
    alone = [channel.take(channel.runs_mask((run,))) for run in ordered]
    model = usual_equation(separable_names(alone[0])[0])
    if "k0" not in model.names:
        raise InputError(runs.source, f"{place}, run {ordered[0]}", "cannot give K0")
    fits = [_fit(model, one, runs.source) for one in alone]
    series = [_series(fits, "k0", "µg", 0.0, rule.k0_limit_ug)]
    if "k1" in model.names:
        series.append(_series(fits, "k1", "ppm", 1.0, rule.k1_limit_ppm))
    return tuple(series)


def _fit(model: ErrorModel, cycle: Channel, source: str) -> ModelFit:
    try:
        return fit(model, cycle.record)
    except (NotSeparableError, ValueError) as err:
        place = f"serial {cycle.serial}, run {cycle.run_ids[0]}"
        raise InputError(source, place, str(err)) from None


def _series(
    fits: Sequence[ModelFit], name: str, unit: str, nominal: float, limit: float
) -> CoefficientSeries:
    return CoefficientSeries(
        name=name,
        unit=unit,
        values=MICRO * (np.array([f.value(name) for f in fits]) - nominal),
        sigmas=MICRO * np.array([f.sigma(name) for f in fits]),
        limit=limit,
    )
