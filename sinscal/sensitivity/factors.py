"""Factors of a rig filter's innovations: phase, rate, cycle, time, temperature."""

from collections.abc import Sequence

import numpy as np

from errormodel.arrays import FloatArray, IntArray
from errormodel.discrepancy.problem import Factor
from sinscal.calibration.rig import RigCalibration
from sinscal.filter.data import CycleData
from sinscal.library.groups import CYCLE, LEAST_WARMING_C, PHASE, RATE, TEMPERATURE
from sinscal.recording.run import RigRun

BINS = 6
HATS = 5
# An error of order k of the sensors has orders k ± 1 in the local axes: these show the first three.
PHASE_ORDERS = (1, 2, 3, 4)


def rig_factors(
    run: RigRun,
    cycles: Sequence[CycleData],
    found: RigCalibration,
    step_of: IntArray,
    row_of: IntArray,
) -> tuple[Factor, ...]:
    """Return the factors that resolve innovations and come again with the programme.

    Parameters
    ----------
    run : RigRun
    cycles : sequence of CycleData
    found : RigCalibration
    step_of, row_of : ndarray of int, shape (n,)
        Of each innovation.
    """
    phase, rate, temp_c = history(cycles, found)
    per_cycle = (found.cycle_of_step[:, None] == np.arange(len(cycles))).astype(float)
    waves = np.column_stack([f(k * phase) for k in PHASE_ORDERS for f in (np.sin, np.cos)])
    # what is fixed to the sensors lies otherwise on the rig in each cycle
    phases = (waves[:, :, None] * per_cycle[:, None, :]).reshape(waves.shape[0], -1)

    def made(name: str, columns: FloatArray) -> Factor:
        """Return a factor; of the channels the one that follows it most closely counts."""
        mine = columns[step_of]
        groups = tuple(mine * (row_of == k)[:, None] for k in np.unique(row_of).tolist())
        return Factor(name=name, groups=groups, repeatable=True)

    factors = [
        made(PHASE, phases),
        made(RATE, _bins(rate, BINS)),
        made(CYCLE, per_cycle),
    ]
    if run.temp_c is not None and float(np.ptp(run.temp_c)) > LEAST_WARMING_C:
        factors.append(made(TEMPERATURE, _bins(temp_c, BINS)))
    return tuple(factors)


def history(
    cycles: Sequence[CycleData], found: RigCalibration
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the phase of rotation (mid-step), its rate and the temperature at every step."""
    parts: list[FloatArray] = []
    for cycle in cycles:
        m = cycle.measured
        along = m.w[:, int(np.argmax(np.mean(m.w**2, axis=0)))]
        turned = np.cumsum(along * m.step_s)
        temp = np.zeros(len(m)) if m.temp_c is None else m.temp_c.mean(axis=1)
        ends = cycle.first[1:] - 1
        middle = 0.5 * (turned[ends] + turned[cycle.first[:-1]])
        block = np.column_stack([middle, along[ends], temp[ends]])
        parts += [block[:1], block]  # the step that begins the cycle measures nothing
    every = np.vstack(parts)
    assert every.shape[0] == found.time_s.size
    return every[:, 0], every[:, 1], every[:, 2]


def slow_hats(cycles: Sequence[CycleData], found: RigCalibration) -> FloatArray:
    """Return triangles over the time of every cycle, `HATS` in each, shape (K, hats).

    Their sums are all that is slow in a run.
    """
    hats: list[FloatArray] = []
    for number in range(len(cycles)):
        mine = found.cycle_of_step == number
        knots = np.linspace(0.0, float(found.time_s[mine].max()), HATS)
        apart = float(knots[1])
        hats += [
            mine * np.maximum(0.0, 1.0 - np.abs(found.time_s - knot) / apart)
            for knot in knots.tolist()
        ]
    return np.column_stack(hats)


def _bins(values: FloatArray, count: int) -> FloatArray:
    """Return indicators of equally filled bins, shape (n, at most count)."""
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, count + 1)[1:-1]))
    return (np.searchsorted(edges, values)[:, None] == np.arange(edges.size + 1)).astype(float)
