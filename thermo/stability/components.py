"""Variance components of a batch: accelerometers, runs, directions, positions, noise."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray, IntArray
from errormodel.columns import derivative
from errormodel.statistics.variance import RandomFactor, VarianceFit, fit_components
from errormodel.statistics.variance_design import stratum_degrees_of_freedom
from thermo.library.effects import MICRO
from thermo.recording.channel import HOLD
from thermo.selection.residuals import MIN_READINGS
from thermo.stability.events import CommonEvent
from thermo.stability.runs import RunByRun, reported_as

MAX_POSITIONS = 36  # more angles than these are no positions that repeat
# name: what it is
FACTORS = {
    "accelerometer": "one accelerometer's K0 differs from another's",
    "run": "a run of an accelerometer differs from its other runs",
    "direction": "heating differs from cooling equally in all runs of an accelerometer",
    "run_direction": "a direction of a run differs from that of other runs: drift within a run",
    "position": "a position of the head differs from others equally in all runs",
    "noise": "the rest, of the mean of a cell of run, direction and position",
}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Cells:
    """Mean errors of cells, µg: what the variance components are estimated from."""

    error_ug: FloatArray
    accelerometer: IntArray
    run: IntArray
    direction: IntArray
    position: IntArray


def cells_of(batch: Sequence[RunByRun], events: Sequence[CommonEvent] = ()) -> Cells:
    """Average each accelerometer's error within runs, directions and positions.

    The error is what the accelerometer's own model of all runs leaves, plus its K0 at the
    reference temperature. Where there are ramps, readings of holds are left out: a hold is neither
    direction. What all accelerometers did together in a run (`events`) is no error of theirs.
    """
    rows: list[tuple[float, int, int, int, int]] = []
    for k, one in enumerate(batch):
        channel, joint = one.joint.channel, one.joint
        angle = np.nan_to_num(np.round(channel.position_deg), nan=-1.0).astype(np.intp)
        if np.unique(angle).size > MAX_POSITIONS:
            angle = np.zeros_like(angle)
        used = np.flatnonzero(one.direction != HOLD) if np.any(one.direction) else None
        keep = np.arange(angle.size) if used is None else used
        labels = np.stack([channel.record.run, one.direction, angle])[:, keep]
        kinds, code = np.unique(labels, axis=1, return_inverse=True)
        code = code.ravel()
        count = np.bincount(code)
        left_ug = joint.residual_ug - _common_ug(one, events)
        mean = np.bincount(code, weights=left_ug[keep]) / count
        k0_ug = MICRO * joint.fit.as_dict().get("k0", 0.0)
        for j in np.flatnonzero(count >= MIN_READINGS).tolist():
            run, direction, position = (int(v) for v in kinds[:, j])
            rows.append((k0_ug + float(mean[j]), k, run, direction, position))
    values = np.array(rows, dtype=float).reshape(-1, 5)
    accelerometer, run, direction, position = values[:, 1:].T.astype(np.intp)
    return Cells(
        error_ug=values[:, 0],
        accelerometer=accelerometer,
        run=run,
        direction=direction,
        position=position,
    )


def _common_ug(one: RunByRun, events: Sequence[CommonEvent]) -> FloatArray:
    """Return what the events add to the readings of an accelerometer, µg, shape (n,)."""
    joint, channel = one.joint, one.joint.channel
    columns = derivative(joint.fit.model, channel.record, joint.fit.as_dict())
    at_input = abs(channel.nominal_scale / joint.own_scale)
    added: FloatArray = np.zeros(len(channel.record))
    for event in events:
        if event.run_id in channel.run_ids and joint.serial in event.shifts:
            rows = channel.record.run == channel.run_ids.index(event.run_id)
            factor = reported_as(joint.fit.model, event.coefficient)[0]
            column = at_input * columns[:, joint.fit.names.index(event.coefficient)]
            # the model of all runs took up the run's share of the shift
            shift = event.shifts[joint.serial][0] * MICRO / factor
            centred: FloatArray = np.asarray(rows - np.mean(rows), dtype=np.float64)
            added += shift * centred * column
    return added


def variance_components(
    batch: Sequence[RunByRun], events: Sequence[CommonEvent] = ()
) -> VarianceFit | None:
    """Estimate the components that these runs can tell apart; None when there is none.

    Runs, directions and positions are nested in their accelerometer.
    """
    cells = cells_of(batch, events)
    kept: list[RandomFactor] = []
    for factor in _candidates(cells):
        if min(stratum_degrees_of_freedom([*kept, factor], cells.error_ug.size)) >= 1:
            kept.append(factor)
    if not kept or not np.any(np.diff(cells.error_ug)):
        return None
    return fit_components(cells.error_ug, kept)


def _candidates(cells: Cells) -> list[RandomFactor]:
    unit = cells.accelerometer
    return [
        RandomFactor.nested("accelerometer", unit),
        RandomFactor.nested("run", unit, cells.run),
        RandomFactor.nested("direction", unit, cells.direction),
        RandomFactor.nested("run_direction", unit, cells.run, cells.direction),
        RandomFactor.nested("position", unit, cells.position),
    ]
