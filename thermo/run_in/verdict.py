"""The verdict on an accelerometer's run-in, and its words."""

from dataclasses import dataclass

from thermo.run_in.relaxation import CoefficientSeries, Draws
from thermo.run_in.rivals import HORIZON, Law
from thermo.run_in.signs import DailySwing, Jump, jumps_of

DRAWS = 3000  # a probability of 0.95 is then known to 0.004
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

    series: CoefficientSeries
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
class SlowChange:
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
    unseen : tuple of SlowChange
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
    unseen: tuple[SlowChange, ...]
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


def _percent(probability: float) -> str:
    """Write the risk that is left; no draw tells of one smaller than its share."""
    return f"{100 * max(1 - probability, 1 / DRAWS):.2g} %"


def needed_text(needed: tuple[int, int | None]) -> str:
    """Write how many cycles are still needed."""
    low, high = needed
    if high is None:
        return f"more than {low}" if low == HORIZON else f"{low} to more than {HORIZON}"
    return f"{low}" if low == high else f"{low} to {high}"
