"""Held-out rig cycles: residual of a cycle with effects selected and estimated by the others.

The effects are selected again without the cycle, by filters that do not use it, and their sizes are
estimated from the innovations of the other cycles. Every cycle turns about another axis and
determines some sizes that the others hardly determine. The sizes are combined linearly so that the
estimates of the cycle and of the others are independent. A combination that the cycle determines
better than all others together is fitted to the cycle and left out of the comparison, before and
after. The comparison is to first order, in the innovations of the present model.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from errormodel.arrays import FloatArray
from errormodel.discrepancy.search.choices import Choice
from errormodel.linear import independent
from sinscal.library import rig_library
from sinscal.recording.run import BoolArray
from sinscal.sensitivity.problem import FilterProblem


@dataclass(frozen=True, slots=True, kw_only=True)
class CycleGap:
    """Rms of a cycle's innovations before and after, by channel; m/s² and rad.

    `names` are the effects in the enlarged model; for a held-out cycle, those selected by the
    others.
    """

    cycle: int
    before: dict[str, float]
    after: dict[str, float]
    names: tuple[str, ...]


def gap_of_cycle(before: FilterProblem, k: int, chosen: Sequence[Choice]) -> CycleGap:
    """Return the gap in a cycle by effects with sizes from the other cycles.

    Parameters
    ----------
    before : FilterProblem
        Filter of the present model, over all cycles.
    k : int
        The cycle, from 0.
    chosen : sequence of Choice
        The effects that the other cycles name.
    """
    effects = [(rig_library().by_name[c.name], c.theta) for c in chosen]
    y = before.residual
    parts = [before.signature(e, theta).columns * before.prior_sigmas(e) for e, theta in effects]
    seen = np.hstack([np.zeros((y.size, 0)), *parts])
    mine = before.found.cycle_of_step[before.step_of] == k
    was, left = _compared(seen[mine], y[mine], seen[~mine], y[~mine])
    return CycleGap(
        cycle=k + 1,
        before=rms_by_channel(before, _squares(before, mine, was)),
        after=rms_by_channel(before, _squares(before, mine, left)),
        names=tuple(c.name for c in chosen),
    )


def gaps_by_cycle(
    before: FilterProblem, after: FilterProblem, choices: Sequence[Choice]
) -> tuple[CycleGap, ...]:
    """Return the innovations of every cycle for the present and the larger model."""

    def of_cycle(one: FilterProblem, k: int) -> dict[str, float]:
        mine = (one.found.cycle_of_step == k)[:, None]
        return rms_by_channel(one, np.where(mine, one.found.filtered.innovation**2, np.nan))

    names = tuple(c.name for c in choices)
    return tuple(
        CycleGap(cycle=k + 1, before=of_cycle(before, k), after=of_cycle(after, k), names=names)
        for k in range(len(before.cycles))
    )


def _compared(
    own: FloatArray, y: FloatArray, other: FloatArray, y_other: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return normalised innovations of a cycle, before and after, in prior sigmas."""
    if own.shape[1] == 0:
        return y, y
    known = other.T @ other + np.eye(own.shape[1])
    share, mixed = linalg.eigh(own.T @ own, known)
    judged = share <= 1.0
    sizes = mixed[:, judged].T @ (other.T @ y_other)
    new = independent(own @ mixed[:, ~judged])

    def beside_new(values: FloatArray) -> FloatArray:
        return values - new @ (new.T @ values)

    return beside_new(y), beside_new(y - own @ (mixed[:, judged] @ sizes))


def _squares(one: FilterProblem, rows: BoolArray, normalised: FloatArray) -> FloatArray:
    """Return squared innovations, SI, of some of those used, NaN elsewhere, shape (K, m)."""
    flat = np.full(rows.size, np.nan)
    flat[rows] = normalised**2
    out = np.full(one.kept.shape, np.nan)
    out[one.kept] = flat
    return out * one.found.filtered.variance


def rms_by_channel(one: FilterProblem, square: FloatArray) -> dict[str, float]:
    """Return the rms by channel of settled innovations, given as squares (K, m)."""
    seen = one.settled & np.isfinite(square)
    return {
        name: float(np.sqrt(np.mean(square[seen[:, k], k])))
        for k, name in enumerate(one.rows.names)
        if seen[:, k].any()
    }
