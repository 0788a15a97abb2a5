"""Findings of a fit: does a higher order help, is a loop left, and of what kind."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray
from thermo.fitting.fit import AccelerometerFit
from thermo.library import MAX_ORDER
from thermo.recording.channel import COOLING, HEATING
from thermo.selection.orders import WORTH, OrderTrial
from thermo.selection.residuals import CELL_C, ResidualSummary

# A loop counts as one when it exceeds the rms of what is left (its two branches then make up more
# than a quarter of the variance), with one sign in this share of the temperature cells.
ONE_SIGN = 0.8
WANTED_C = 40.0  # besides the median, the loop is told at this temperature


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderFinding:
    """Comparison of the chosen polynomial orders with the next higher ones.

    Attributes
    ----------
    chosen : OrderTrial or None
        None when the terms were given and no orders were tried.
    higher : tuple of OrderTrial
        The trials of the next order of K0 and of K1, where the data can carry them.
    helps : bool or None
        None when it was not tried.
    sentence : str
    """

    chosen: OrderTrial | None
    higher: tuple[OrderTrial, ...]
    helps: bool | None
    sentence: str


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopFinding:
    """The difference between heating and cooling that the model leaves, µg.

    Attributes
    ----------
    median_ug, at_40c_ug : float or None
        None with one direction only, or with 40 °C outside the range that both passed.
    by_run_ug : tuple of (str, float)
        Median of each run that has both directions.
    stands_out : bool
        It is large against what else is left, and of one sign over the temperature.
    repeats : bool or None
        It has that sign in every run; None with fewer than two runs that have both directions.
    sentence : str
        Empty when nothing stands out.
    """

    median_ug: float | None
    at_40c_ug: float | None
    by_run_ug: tuple[tuple[str, float], ...]
    stands_out: bool
    repeats: bool | None
    sentence: str


def find_order(one: AccelerometerFit) -> OrderFinding:
    """Tell whether a polynomial of higher order would help, by readings not fitted."""
    selection = one.selection
    if selection is None:
        text = "the terms were given; no other polynomial orders were tried"
        return OrderFinding(chosen=None, higher=(), helps=None, sentence=text)
    i, j = selection.k0_order, selection.k1_order
    chosen = selection.trial(i, j)
    assert chosen is not None
    higher = tuple(t for t in (selection.trial(i + 1, j), selection.trial(i, j + 1)) if t)
    beyond = [t for t in selection.trials if t.k0_order >= i and t.k1_order >= j and t != chosen]
    if not beyond:
        why = (
            "the highest order that is tried"
            if i == MAX_ORDER
            else "the highest order that the data determine"
        )
        text = f"orders K0 {i}, K1 {j}: {why}"
        return OrderFinding(chosen=chosen, higher=(), helps=None, sentence=text)
    helps = min(t.heldout_ug for t in beyond) < chosen.heldout_ug * (1.0 - WORTH)
    tries = "; ".join(_tried(t, chosen) for t in higher)
    verdict = "a higher order helps" if helps else "a higher order does not help"
    text = (
        f"orders K0 {i}, K1 {j} ({chosen.heldout_ug:.4g} µg on held-out readings, "
        f"{chosen.residual_ug:.4g} µg in the fit); {verdict}: {tries}"
    )
    return OrderFinding(chosen=chosen, higher=higher, helps=helps, sentence=text)


def _tried(t: OrderTrial, chosen: OrderTrial) -> str:
    which = f"K0 {t.k0_order}" if t.k0_order > chosen.k0_order else f"K1 {t.k1_order}"
    return f"{which} gives {t.heldout_ug:.4g} µg held out, {t.residual_ug:.4g} µg in the fit"


def find_loop(one: AccelerometerFit) -> LoopFinding:
    """Tell whether heating and cooling differ by more than the rest of the residual explains.

    With two runs or more a thermal history effect is told from a drift by its sign, which repeats;
    with one run the two look alike.
    """
    summary = one.summary
    median = summary.heating_minus_cooling_ug
    by_run = tuple(_by_run(one))
    if median is None:
        return LoopFinding(
            median_ug=None,
            at_40c_ug=None,
            by_run_ug=by_run,
            stands_out=False,
            repeats=None,
            sentence="",
        )
    cells = np.array([c.heating_minus_cooling_ug for c in summary.loop])
    one_sign = float(np.mean(cells * median > 0)) >= ONE_SIGN
    stands_out = abs(median) > summary.rms_ug and one_sign
    repeats = all(m * median > 0 for _, m in by_run) if len(by_run) > 1 else None
    return LoopFinding(
        median_ug=median,
        at_40c_ug=summary.loop_at(WANTED_C),
        by_run_ug=by_run,
        stands_out=stands_out,
        repeats=repeats,
        sentence=_loop_sentence(summary, median, repeats) if stands_out else "",
    )


def _by_run(one: AccelerometerFit) -> Iterator[tuple[str, float]]:
    """Yield each run's median; one run has fewer readings in a cell, so that each cell counts."""
    channel = one.channel
    cell = np.floor(channel.temp_c / CELL_C).astype(np.intp)
    cell -= cell.min()
    for number, run in enumerate(channel.run_ids):
        means: list[FloatArray] = []
        for direction in (HEATING, COOLING):
            mine = (channel.record.run == number) & (channel.direction == direction)
            count = np.bincount(cell[mine], minlength=int(cell.max()) + 1)
            total = np.bincount(cell[mine], one.residual_ug[mine], minlength=int(cell.max()) + 1)
            means.append(np.divide(total, count, out=np.full(count.size, np.nan), where=count > 0))
        difference = means[0] - means[1]
        shared = difference[np.isfinite(difference)]
        if shared.size:
            yield run, float(np.median(shared))


def _loop_sentence(summary: ResidualSummary, median: float, repeats: bool | None) -> str:
    head = (
        f"heating lies {abs(median):.4g} µg {'above' if median > 0 else 'below'} cooling at equal "
        f"temperature, more than the {summary.rms_ug:.4g} µg rms of the residual"
    )
    if repeats is None:
        return (
            f"{head}: a thermal-history effect, which no polynomial in temperature can describe, "
            f"or a drift; a single run cannot separate the two"
        )
    if repeats:
        return (
            f"{head}, and with the same sign in every run: a thermal-history effect is left, which "
            f"no polynomial in temperature can describe"
        )
    return f"{head}, but not with the same sign in every run: a drift rather than thermal history"
