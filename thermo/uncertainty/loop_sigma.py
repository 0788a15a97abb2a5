"""Sigma of heating minus cooling: a median over cells that move together."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from errormodel.arrays import FloatArray
from thermo.recording.channel import Channel
from thermo.selection.residuals import loop_cells
from thermo.uncertainty.linearised import LinearisedFit

DRAWS = 4000  # the sigma is then known to 2 %
SEED = 1
Z95 = 1.959964


def loop_sigma_ug(line: LinearisedFit, channel: Channel) -> float | None:
    """Return the sigma of heating minus cooling, µg; None with one direction only.

    White noise is new in each cell, the drift is shared by neighbours, and where runs differ in
    K1 every cell moves by its own share of it: as its readings lie unevenly over the positions.
    The sum over the cells may happen to hold little of that, the median does not. So cells are
    drawn with the covariance that they have, and 1.96 of the sigma hold 95 % of the medians.

    Parameters
    ----------
    line : LinearisedFit
        With its run effects.
    channel : Channel
        What was fitted.
    """
    cell, weight = loop_cells(channel)
    count = int(cell.max(initial=-1)) + 1
    if not count:
        return None
    cov = line.sums(line.left(lambda rows: _spread_out(cell[rows], weight[rows], count)), count).cov
    sizes, axes = np.linalg.eigh(cov)
    root = axes * np.sqrt(np.maximum(sizes, 0.0))
    draws = root @ np.random.default_rng(SEED).standard_normal((count, DRAWS))
    return 1e6 * float(np.quantile(np.abs(np.median(draws, axis=0)), 0.95)) / Z95


def _spread_out(cell: NDArray[np.integer[Any]], weight: FloatArray, count: int) -> FloatArray:
    """Return the weights of readings with a column for each cell, shape (n, count)."""
    columns = np.zeros((cell.size, count))
    inside = np.flatnonzero(cell >= 0)
    columns[inside, cell[inside]] = weight[inside]
    return columns
