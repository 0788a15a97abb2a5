"""Judgement of a run-in: has an accelerometer settled, and how many cycles does it still need.

The rule is a sequential test. After each cycle the future of K0 and K1 is inferred
(`thermo.run_in.relaxation`), over all rivals of a single relaxation. The accelerometer has settled
when, with the confidence asked for, none of the two will ever again change by more than its limit:
in the mean over all rivals, and under every kind of slow process by itself, in one coefficient or
in all. Let b be the odds of a kind against all rivals, from `SLOW_ODDS` beforehand, and P the
probability under it of a later change. Then b·P (P itself where b is above 1) must not exceed the
risk, however rare the kind is among accelerometers. It may be looked at as often as one likes: b
hangs on the readings alone (Ville 1939).
"""

from collections.abc import Sequence

import numpy as np
from scipy import stats

from errormodel.arrays import FloatArray, IntArray
from thermo.run_in.relaxation import CoefficientSeries, Draws, SlowRival, weigh
from thermo.run_in.rivals import HORIZON
from thermo.run_in.signs import daily_swing
from thermo.run_in.verdict import DRAWS, Relaxation, RunInVerdict, SlowChange, Spread

SEED = 1  # the same estimates always give the same verdict
MIN_CYCLES = 3
RIVAL_DRAWS = 400  # under each slow process: a probability of 0.05 is then known to 0.011
LEAST_PLAIN = 0.05  # share of the draws in which nothing slow goes on, for figures under that
EXCLUDED = 3.0  # a law or slow process is excluded at odds of 20, of which this is the logarithm
# So many cycles at either end make the instability before and after, fewer when there are fewer.
WINDOW = 4


def judge_run_in(
    serial: str,
    series: Sequence[CoefficientSeries],
    *,
    confidence: float = 0.95,
    window: int = WINDOW,
    nothing_slow: bool = False,
    hours: FloatArray | None = None,
) -> RunInVerdict:
    """Judge one accelerometer's run-in from its estimates of every cycle.

    Parameters
    ----------
    serial : str
    series : sequence of CoefficientSeries
        K0 and K1, or K0 alone; of one length.
    confidence : float
        That the verdict "settled" is right.
    window : int
        Cycles at either end that make the instability before and after.
    nothing_slow : bool
        Assume that nothing slower than the relaxation goes on, instead of weighing it.
    hours : ndarray, shape (n,), optional
        Time of each cycle, h: then a daily swing is sought.

    Returns
    -------
    RunInVerdict

    Raises
    ------
    ValueError
        If the series are none or differ in length, or the confidence is not within 0.5…1.
    """
    lengths = {one.values.size for one in series}
    if len(lengths) != 1 or not 0.5 < confidence < 1:
        raise ValueError(f"series of {sorted(lengths)} cycles, confidence {confidence}")
    exponential = weigh(series, "exponential", slow=not nothing_slow)
    hyperbolic = weigh(series, "hyperbolic", slow=not nothing_slow)
    ratio = hyperbolic.log_evidence - exponential.log_evidence
    better, other = (hyperbolic, exponential) if ratio > 0 else (exponential, hyperbolic)
    mine = better.draw(DRAWS, np.random.default_rng(SEED))
    other_needs, draws = None, mine
    if abs(ratio) < EXCLUDED:
        rest = other.draw(DRAWS, np.random.default_rng(SEED + 1))
        other_needs = _interval(_of_all(rest), 1.0 - confidence)
        share = float(1.0 / (1.0 + np.exp(abs(ratio))))  # of the other law
        draws = tuple(a.joined(b, share) for a, b in zip(mine, rest, strict=True))
    risk = 1.0 - confidence
    rivals: tuple[SlowRival, ...] = ()
    if not nothing_slow:
        rivals = better.slow_rivals(RIVAL_DRAWS, np.random.default_rng(SEED + 2), np.exp(-EXCLUDED))
    needed = _of_all(draws)
    under = [_of_all(r.draws) for r in rivals]
    later = [
        float(np.mean(needed > 0)),
        *(min(r.odds, 1.0) * float(np.mean(n > 0)) for r, n in zip(rivals, under, strict=True)),
    ]
    settled = max(later) <= risk
    counted = () if settled else rivals
    plain = np.all([one.plain for one in draws], axis=0)
    enough = np.count_nonzero(plain) >= LEAST_PLAIN * needed.size
    if_plain = needed[plain]
    coefficients = tuple(
        _relaxation(s, draws[k], [r.draws[k].needed for r in counted], risk, window)
        for k, s in enumerate(series)
    )
    swings = (
        () if hours is None else (daily_swing(c.series, hours, c.kappa[0]) for c in coefficients)
    )
    return RunInVerdict(
        serial=serial,
        cycles=lengths.pop(),
        law=better.law,
        log_evidence_ratio=ratio,
        other_law_needs=other_needs,
        coefficients=coefficients,
        settled_probability=1.0 - max(later),
        confidence=confidence,
        settled=settled,
        cycles_needed=_needed(needed, under if counted else (), risk),
        nothing_slow=nothing_slow,
        settled_if_nothing_slow=(
            float(np.count_nonzero(if_plain == 0) / if_plain.size) if enough else None
        ),
        needed_if_nothing_slow=_interval(if_plain, risk) if enough else None,
        not_excluded=tuple(dict.fromkeys(r.name for r in rivals)),
        unseen=_unseen(series, rivals),
        swings=tuple(s for s in swings if s),
    )


def _unseen(
    series: Sequence[CoefficientSeries], rivals: Sequence[SlowRival]
) -> tuple[SlowChange, ...]:
    """Return the largest change that each slow process could bring, where above a limit."""
    found: dict[str, SlowChange] = {}
    for rival in rivals:
        for place in rival.places:
            changes = np.abs(rival.draws[place].future[:, HORIZON])
            mine = SlowChange(
                process=rival.name,
                coefficient=series[place].name,
                unit=series[place].unit,
                change=float(np.quantile(changes, 0.95)),
            )
            other = found.get(rival.name)
            above = mine.change > series[place].limit
            if above and (other is None or mine.change > other.change):
                found[rival.name] = mine
    return tuple(found.values())


def _of_all(draws: Sequence[Draws]) -> IntArray:
    """Return the cycles needed until the last of the coefficients has settled, shape (m,)."""
    return np.vstack([one.needed for one in draws]).max(axis=0)


def _interval(needed: IntArray, risk: float) -> tuple[int, int | None]:
    """Return the cycles that are too few, and enough, with the risk given each."""
    ordered = np.sort(needed)
    low = min(int(ordered[int(np.floor(risk * (ordered.size - 1)))]), HORIZON)
    high = int(ordered[max(0, int(np.ceil((1.0 - risk) * ordered.size)) - 1)])
    return low, (high if high <= HORIZON else None)


def _needed(needed: IntArray, under: Sequence[IntArray], risk: float) -> tuple[int, int | None]:
    """Return the cycles that are too few, in the mean, and those enough under each rival too."""
    low, high = _interval(needed, risk)
    highs = [high, *(_interval(n, risk)[1] for n in under)]
    known = [h for h in highs if h is not None]
    return low, (max(known) if len(known) == len(highs) else None)


def _relaxation(
    series: CoefficientSeries,
    draws: Draws,
    under: Sequence[IntArray],
    risk: float,
    window: int,
) -> Relaxation:
    count = min(window, series.values.size // 2)
    enough = count >= 2
    return Relaxation(
        series=series,
        draws=draws,
        kappa=_summary(draws.kappa),
        amplitude=_summary(draws.amplitude),
        final=_summary(draws.final),
        remaining=_summary(draws.future[:, -1]),
        before=run_spread(series.values[:count]) if enough else None,
        after=run_spread(series.values[-count:]) if enough else None,
        estimate_sigma=float(np.median(series.sigmas[-max(count, 1) :])),
        cycles_needed=_needed(draws.needed, under, risk),
    )


def _summary(values: FloatArray) -> tuple[float, float]:
    return float(np.median(values)), float(np.std(values))


def run_spread(values: FloatArray) -> Spread:
    """Return the standard deviation of two or more runs, with limits that hold for so few.

    The limits are those of χ² for independent normal values; a trend within them makes σ larger.
    """
    dof = values.size - 1
    sigma = float(np.std(values, ddof=1))
    low, high = (sigma * float(np.sqrt(dof / stats.chi2.ppf(p, dof))) for p in (0.975, 0.025))
    return Spread(sigma=sigma, ci95=(low, high), runs=values.size)
