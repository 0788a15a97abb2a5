"""What the innovations of a rig filter may follow: phase, rate, channel, cycle, time, warmth."""

from collections.abc import Sequence

import numpy as np

from errormodel.arrays import FloatArray, IntArray
from errormodel.discrepancy.problem import Factor
from sinscal.calibrate import RigCalibration
from sinscal.rig_effects import LEAST_WARMING_C
from sinscal.rigdata import CycleData
from sinscal.run import RigRun

BINS = 6
SLOW_BINS = 12


def rig_factors(
    run: RigRun,
    cycles: Sequence[CycleData],
    found: RigCalibration,
    step_of: IntArray,
    row_of: IntArray,
) -> tuple[Factor, ...]:
    """Return the factors that resolve innovations.

    Parameters
    ----------
    run : RigRun
    cycles : sequence of CycleData
    found : RigCalibration
    step_of, row_of : ndarray of int, shape (n,)
        Of each innovation.
    """
    phase, rate, temp_c = _history(cycles, found)
    channels = (row_of[:, None] == np.unique(row_of)).astype(float)
    time_s = np.arange(found.time_s.size, dtype=float)
    waves = np.column_stack([f(k * phase) for k in (1, 2) for f in (np.sin, np.cos)])
    per_cycle = (found.cycle_of_step[:, None] == np.arange(len(cycles))).astype(float)

    def each(columns: FloatArray) -> FloatArray:
        """Return each column for each channel."""
        return (columns[step_of][:, :, None] * channels[:, None, :]).reshape(step_of.size, -1)

    made = [
        Factor(name="channel", groups=(channels,), repeatable=True),
        Factor(name="rotation phase", groups=(each(waves),), repeatable=True),
        Factor(name="rate", groups=(each(_bins(rate, BINS)),), repeatable=True),
        Factor(name="cycle", groups=(each(per_cycle),), repeatable=True),
        Factor(name="time in run", groups=(each(_bins(time_s, SLOW_BINS)),), repeatable=False),
    ]
    if run.temp_c is not None and float(np.ptp(run.temp_c)) > LEAST_WARMING_C:
        warm = each(_bins(temp_c, BINS))
        made.append(Factor(name="temperature", groups=(warm,), repeatable=True))
    return tuple(made)


def _history(
    cycles: Sequence[CycleData], found: RigCalibration
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the phase and rate of rotation and the temperature at every step."""
    parts: list[FloatArray] = []
    for cycle in cycles:
        m = cycle.measured
        along = m.w[:, int(np.argmax(np.mean(m.w**2, axis=0)))]
        turned = np.cumsum(along * m.step_s)
        temp = np.zeros(len(m)) if m.temp_c is None else m.temp_c.mean(axis=1)
        ends = cycle.first[1:] - 1
        block = np.column_stack([turned, along, temp])[ends]
        parts += [block[:1], block]  # the step that begins the cycle measures nothing
    every = np.vstack(parts)
    assert every.shape[0] == found.time_s.size
    return every[:, 0], every[:, 1], every[:, 2]


def _bins(values: FloatArray, count: int) -> FloatArray:
    """Return indicators of equally filled bins, shape (n, at most count)."""
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, count + 1)[1:-1]))
    return (np.searchsorted(edges, values)[:, None] == np.arange(edges.size + 1)).astype(float)
