"""Signs in single cycles beside the relaxation: a jump between two of them, a daily swing."""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from errormodel.arrays import FloatArray
from thermo.run_in.relaxation import CoefficientSeries
from thermo.run_in.rivals import law_bend, law_shape

JUMP_SIGMAS, JUMP_TIMES = 4.0, 1.5  # of noise; times what the cycle before changed by
DAY_H = 24.0
DAILY_P = 0.005  # chance of naming a swing of one coefficient that has none
# Of a swing's sum of squares, so much must not look like something slow: else it cannot be told.
APART = 0.5
MIN_DOF = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Jump:
    """A sudden change of a coefficient; `cycle` counts from 1 and is the first one changed."""

    coefficient: str
    unit: str
    cycle: int
    size: float


@dataclass(frozen=True, slots=True, kw_only=True)
class DailySwing:
    """A coefficient follows the time of day, by ± `amplitude`."""

    coefficient: str
    unit: str
    amplitude: float
    p_value: float

    @property
    def sentence(self) -> str:
        """The swing in a few words."""
        return (
            f"{self.coefficient.upper()} swings by ±{self.amplitude:.2g} {self.unit} with the time "
            f"of day (period 24 h, p = {self.p_value:.1g})"
        )


def jumps_of(series: CoefficientSeries) -> tuple[Jump, ...]:
    """Return the changes above the limit that are larger than the one before them.

    What relaxes changes by less and less.
    """
    change = np.diff(series.values)
    sigma = np.hypot(series.sigmas[1:], series.sigmas[:-1])
    usual = np.abs(change[:-1]) + JUMP_SIGMAS * sigma[1:]
    far = (np.abs(change[1:]) > series.limit) & (np.abs(change[1:]) > JUMP_TIMES * usual)
    # the way back from one odd cycle is no jump of its own
    far[1:] &= ~far[:-1]
    return tuple(
        Jump(
            coefficient=series.name,
            unit=series.unit,
            cycle=int(k) + 3,
            size=float(change[k + 1]),
        )
        for k in np.flatnonzero(far)
    )


def daily_swing(series: CoefficientSeries, hours: FloatArray, kappa: float) -> DailySwing | None:
    """Seek a period of 24 h beside a relaxation and a slow creep (F test of cosine and sine).

    Parameters
    ----------
    series : CoefficientSeries
    hours : ndarray, shape (n,)
        Time of each cycle, h.
    kappa : float
        Cycles over which the coefficient relaxes.

    Returns
    -------
    DailySwing or None
        None where there is none, or where cycles are too few or fall on the same hours each day.
    """
    cycle = np.arange(series.values.size, dtype=float)
    ratio = np.full(cycle.size, kappa)
    smooth = np.column_stack(
        [
            np.ones_like(cycle),
            cycle,
            law_shape("exponential", cycle, ratio),
            law_bend("exponential", cycle, ratio),
        ]
    )
    phase = 2.0 * np.pi * hours / DAY_H
    swing = np.column_stack([np.cos(phase), np.sin(phase)])
    basis = _basis(smooth)
    left = swing - basis @ (basis.T @ swing)
    # of the directions in which the swing can lie, those that nothing slow can
    sizes, directions = np.linalg.eigh(left.T @ left)
    told: FloatArray = left @ directions[:, sizes > APART * 0.5 * cycle.size]
    shown = int(told.shape[1])
    dof = int(cycle.size - basis.shape[1] - shown)
    if shown == 0 or dof < MIN_DOF:
        return None
    rest = series.values - basis @ (basis.T @ series.values)
    found = np.linalg.lstsq(told, rest, rcond=None)[0]
    explained: FloatArray = np.asarray(told @ found, dtype=np.float64)
    noise = float(np.sum((rest - explained) ** 2)) / dof
    f = float(np.sum(explained**2)) / shown / max(noise, 1e-300)
    p = float(stats.f.sf(f, shown, dof))
    if p > DAILY_P:
        return None
    return DailySwing(
        coefficient=series.name,
        unit=series.unit,
        amplitude=float(np.linalg.norm(found)),
        p_value=p,
    )


def _basis(columns: FloatArray) -> FloatArray:
    """Return an orthonormal basis of the columns' space."""
    u, sizes, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    return np.asarray(u[:, sizes > 1e-6 * sizes[0]])
