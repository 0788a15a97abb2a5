"""Run-in: whether an accelerometer has settled, and how many cycles it still needs.

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
from dataclasses import dataclass

import numpy as np
from scipy import stats

from errormodel.arrays import FloatArray, IntArray
from thermo.run_in.relaxation import Draws, Series, SlowRival, weigh
from thermo.run_in.rivals import HORIZON, Law
from thermo.run_in.signs import DailySwing, Jump, daily_swing, jumps_of

DRAWS = 3000  # a probability of 0.95 is then known to 0.004
SEED = 1  # the same estimates always give the same verdict
MIN_CYCLES = 3
RIVAL_DRAWS = 400  # under each slow process: a probability of 0.05 is then known to 0.011
LEAST_PLAIN = 0.05  # share of the draws in which nothing slow goes on, for figures under that
EXCLUDED = 3.0  # a law or slow process is excluded at odds of 20, of which this is the logarithm
# So many cycles at either end make the instability before and after, fewer when there are fewer.
WINDOW = 4
SCATTER_TOLD = 0.25  # of the limit: two cycles then differ by a third of it and more


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """Standard deviation between runs, with its 95 % limits for so few of them."""

    sigma: float
    ci95: tuple[float, float]
    runs: int


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Relaxation:
    """One coefficient's way: the estimates, the fit, and how unsteady it was before and after.

    `kappa`, `amplitude`, `final` and `remaining` are median and standard deviation; `remaining` is
    the change still to come after the last cycle. `before` and `after` are None with fewer than
    four cycles. `estimate_sigma` is what the estimates at the end are themselves known to
    (median): an instability of that size is noise.
    """

    series: Series
    draws: Draws
    kappa: tuple[float, float]
    amplitude: tuple[float, float]
    final: tuple[float, float]
    remaining: tuple[float, float]
    before: Spread | None
    after: Spread | None
    estimate_sigma: float
    cycles_needed: tuple[int, int | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Unseen:
    """A slow process that the cycles do not exclude.

    `change` is what 95 % of its possible changes of the coefficient within `HORIZON` cycles do not
    exceed.
    """

    process: str
    coefficient: str
    unit: str
    change: float

    @property
    def sentence(self) -> str:
        """The process and its size in a few words."""
        name = self.coefficient.upper()
        return f"{self.process} of {name} by up to {self.change:.2g} {self.unit}"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RunInVerdict:
    """Verdict on one accelerometer's run-in after its last cycle.

    Attributes
    ----------
    serial : str
    cycles : int
    law : {"exponential", "hyperbolic"}
        The law that the estimates support better; the verdict is the mean over both, each with
        its evidence.
    log_evidence_ratio : float
        Natural logarithm of the hyperbolic law's evidence over the exponential one's.
    other_law_needs : (int, int or None) or None
        `cycles_needed` under the other law; None when the estimates exclude that one.
    coefficients : tuple of Relaxation
    settled_probability : float
        That no coefficient will again change by more than its limit: 1 less the largest risk, in
        the mean over all rivals or under a kind of slow process.
    confidence : float
    settled : bool
        Whether `settled_probability` reaches `confidence`.
    cycles_needed : (int, int or None)
        Fewer than the first or more than the second are needed with a risk of 1 − `confidence`
        each; until it has settled the second holds under every slow process that the cycles do not
        exclude, however rare it is. None: more than `thermo.run_in.rivals.HORIZON`.
    needed_if_nothing_slow : (int, int or None) or None
        The same if nothing slower than the relaxation goes on; None where the cycles leave that no
        weight.
    nothing_slow : bool
        Whether it was assumed that nothing slower than the relaxation goes on.
    settled_if_nothing_slow : float or None
        `settled_probability` under that assumption; None where the cycles leave it no weight.
    not_excluded : tuple of str
        Slow processes that the cycles do not exclude at odds of 20.
    unseen : tuple of Unseen
        How large those could be that could leave a limit.
    swings : tuple of DailySwing
        Coefficients that follow the time of day.
    """

    serial: str
    cycles: int
    law: Law
    log_evidence_ratio: float
    other_law_needs: tuple[int, int | None] | None
    coefficients: tuple[Relaxation, ...]
    settled_probability: float
    confidence: float
    settled: bool
    cycles_needed: tuple[int, int | None]
    nothing_slow: bool
    settled_if_nothing_slow: float | None
    needed_if_nothing_slow: tuple[int, int | None] | None
    not_excluded: tuple[str, ...]
    unseen: tuple[Unseen, ...]
    swings: tuple[DailySwing, ...]

    @property
    def sentence(self) -> str:
        """The verdict in one line."""
        jumped = "".join(
            f"; {j.coefficient.upper()} jumped by {j.size:+.3g} {j.unit} in cycle {j.cycle}"
            for j in self.jumps
        )
        swung = "".join(f"; {s.sentence}, not counted" for s in self.swings)
        if self.settled:
            what = f"settled after {self.cycles} cycles: no further change above the limits"
            assumed = (
                "if there is no process slower than the relaxation (assumed)"
                if self.nothing_slow
                else "unless a process begins that these cycles do not show"
            )
            if self.unseen:
                slow = ", ".join(u.sentence for u in self.unseen)
                assumed += (
                    f" (taken to be rare, as these cycles do not exclude it within {HORIZON} more: "
                    f"{slow})"
                )
            return (
                f"{self.serial}: {what}, risk {_percent(self.settled_probability)}, {assumed}"
                f"{self._scatter_text()}{swung}{jumped}"
            )
        return (
            f"{self.serial}: not settled after {self.cycles} cycles; cycles still needed: "
            f"{self._needed_text()} (risk {100 * (1 - self.confidence):.2g} % on either side)"
            f"{swung}{jumped}"
        )

    def _needed_text(self) -> str:
        """Tell both: if nothing slow goes on, and over all that the cycles do not exclude."""
        plain = self.needed_if_nothing_slow
        if plain is None or self.nothing_slow or plain == self.cycles_needed:
            return needed_text(self.cycles_needed)
        high = self.cycles_needed[1]
        slower = f"more than {HORIZON}" if high is None else f"up to {high}"
        return (
            f"{needed_text(plain)} if there is no process slower than the relaxation; a slower "
            f"one is not excluded and would need {slower}"
        )

    @property
    def scale_fitted(self) -> bool:
        """True when µg are over each cycle's own K1; else over the nominal scale factor."""
        return any(c.series.name == "k1" for c in self.coefficients)

    @property
    def jumps(self) -> tuple[Jump, ...]:
        """Changes from one cycle to the next that no relaxation makes, and noise hardly."""
        return tuple(j for c in self.coefficients for j in jumps_of(c.series))

    def _scatter_text(self) -> str:
        """Tell a scatter of single cycles that their own sigmas do not explain."""
        told = [
            f"{c.series.name.upper()} {c.after.sigma:.2g} {c.series.unit}"
            for c in self.coefficients
            if c.after is not None
            and c.after.ci95[0] > c.estimate_sigma
            and c.after.sigma > SCATTER_TOLD * c.series.limit
        ]
        if not told:
            return ""
        return (
            f"; single cycles scatter by {', '.join(told)} (1 σ: turn-on, time of day), not counted"
        )


def judge_run_in(
    serial: str,
    series: Sequence[Series],
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
    series : sequence of Series
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


def _unseen(series: Sequence[Series], rivals: Sequence[SlowRival]) -> tuple[Unseen, ...]:
    """Return the largest change that each slow process could bring, where above a limit."""
    found: dict[str, Unseen] = {}
    for rival in rivals:
        for place in rival.places:
            changes = np.abs(rival.draws[place].future[:, HORIZON])
            mine = Unseen(
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


def _percent(probability: float) -> str:
    """Write the risk that is left; no draw tells of one smaller than its share."""
    return f"{100 * max(1 - probability, 1 / DRAWS):.2g} %"


def needed_text(needed: tuple[int, int | None]) -> str:
    """Write how many cycles are still needed."""
    low, high = needed
    if high is None:
        return f"more than {low}" if low == HORIZON else f"{low} to more than {HORIZON}"
    return f"{low}" if low == high else f"{low} to {high}"


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
    series: Series,
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
        before=spread_of(series.values[:count]) if enough else None,
        after=spread_of(series.values[-count:]) if enough else None,
        estimate_sigma=float(np.median(series.sigmas[-max(count, 1) :])),
        cycles_needed=_needed(draws.needed, under, risk),
    )


def _summary(values: FloatArray) -> tuple[float, float]:
    return float(np.median(values)), float(np.std(values))


def spread_of(values: FloatArray) -> Spread:
    """Return the standard deviation of two or more runs, with limits that hold for so few.

    The limits are those of χ² for independent normal values; a trend within them makes σ larger.
    """
    dof = values.size - 1
    sigma = float(np.std(values, ddof=1))
    low, high = (sigma * float(np.sqrt(dof / stats.chi2.ppf(p, dof))) for p in (0.975, 0.025))
    return Spread(sigma=sigma, ci95=(low, high), runs=values.size)
