"""Rig cycles held out: what the other cycles' choice and sizes of effects leave of a cycle.

The effects are chosen anew without the cycle, by filters that never saw it, and their sizes come
from the other cycles' innovations. Every cycle turns about another axis and shows some sizes that
the others hardly do. Sizes are mixed so that those of a cycle and of the others are independent; a
mixture that the cycle shows better than all others together cannot be judged by them: it is fitted
to the cycle and left out of the comparison, before and after: to first order, in the innovations of
the present model.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from errormodel.arrays import FloatArray
from errormodel.discrepancy.choices import Choice
from errormodel.discrepancy.problem import independent
from errormodel.discrepancy.search import Search
from sinscal.discrepancy.source import RigSource
from sinscal.library import rig_library
from sinscal.recording.run import BoolArray
from sinscal.sensitivity.problem import FilterProblem


@dataclass(frozen=True, slots=True, kw_only=True)
class CycleGap:
    """Rms of a cycle's innovations before and after, by channel; m/s² and rad.

    `names` are the effects in the model after: of a cycle held out, those that the others chose.
    """

    cycle: int
    before: dict[str, float]
    after: dict[str, float]
    names: tuple[str, ...]


def held_out(source: RigSource, search: Search, choices: Sequence[Choice]) -> tuple[CycleGap, ...]:
    """Judge effects on each cycle by the choice and the sizes of the others.

    Parameters
    ----------
    source : RigSource
    search : Search
        Of the whole run: its laws and rules are those of every choice.
    choices : sequence of Choice
        The effects found.

    Returns
    -------
    tuple of CycleGap
        None without effects, and none with a single cycle.
    """
    cycles = range(len(source.run.cycles))
    if not choices or len(cycles) < 2:
        return ()
    before = source.filter_with(())
    made: list[CycleGap] = []
    for k in cycles:
        others = source.of_cycles([j for j in cycles if j != k])
        chosen = Search(others, search.floor, search.laws, search.rules).chosen()
        made.append(_gap_of(before, k, chosen))
    return tuple(made)


def _gap_of(before: FilterProblem, k: int, chosen: Sequence[Choice]) -> CycleGap:
    """Return the gap in cycle k by effects with sizes from the other cycles."""
    effects = [(rig_library().by_name[c.name], c.theta) for c in chosen]
    y = before.residual
    parts = [before.signature(e, theta).columns * before.prior_sigmas(e) for e, theta in effects]
    seen = np.hstack([np.zeros((y.size, 0)), *parts])
    mine = before.found.cycle_of_step[before.step_of] == k
    was, left = _judged(seen[mine], y[mine], seen[~mine], y[~mine])
    return CycleGap(
        cycle=k + 1,
        before=rms_by_channel(before, _squares(before, mine, was)),
        after=rms_by_channel(before, _squares(before, mine, left)),
        names=tuple(c.name for c in chosen),
    )


def gaps_by_cycle(
    before: FilterProblem, after: FilterProblem, choices: Sequence[Choice]
) -> tuple[CycleGap, ...]:
    """Return the innovations of every cycle by the filter of the present and the larger model."""

    def of_cycle(one: FilterProblem, k: int) -> dict[str, float]:
        mine = (one.found.cycle_of_step == k)[:, None]
        return rms_by_channel(one, np.where(mine, one.found.filtered.innovation**2, np.nan))

    names = tuple(c.name for c in choices)
    return tuple(
        CycleGap(cycle=k + 1, before=of_cycle(before, k), after=of_cycle(after, k), names=names)
        for k in range(len(before.cycles))
    )


def _judged(
    own: FloatArray, y: FloatArray, other: FloatArray, y_other: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return a cycle's normalised innovations before and after; columns count in prior sigmas."""
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
