"""Shares of simulated sets in which the limits of `stability` and `runin` hold the truth.

`benchmarks/bench_stability_coverage.py` runs these with many sets, the suite with few.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pytest

from errormodel.arrays import FloatArray
from tests.thermo.run_in.examples import LIMIT, SIGMA, series_of
from tests.thermo.stability.examples import SIX, one_run, recorded
from thermo.run_in import judge as run_in
from thermo.run_in import relaxation
from thermo.run_in.relaxation import cycles_needed
from thermo.run_in.rivals import HORIZON, lay_out
from thermo.stability.judge import judge_stability
from thermo.stability.shape import Shape

DIFFERENCES = {"k0": 20.0, "k1": 10.0, "k0_t1": 0.1}  # µg, ppm, µg/°C, 1 sigma between runs
SPAN_X_C = (-65.0, 45.0)  # of the runs, from 25 °C


@dataclass(frozen=True, slots=True, kw_only=True)
class Coverage:
    """In how many of the sets each limit held the truth, or each thing came about."""

    sets: int
    counts: dict[str, int]

    def share(self, name: str) -> float:
        """Return the share of sets."""
        return self.counts.get(name, 0) / self.sets

    @property
    def text(self) -> str:
        """All shares in one line."""
        told = ", ".join(f"{n} {100 * k / self.sets:.1f} %" for n, k in self.counts.items())
        return f"{self.sets} sets: {told}"


def stability_coverage(
    runs: int, seeds: Sequence[int], differing: bool, readings: int = 240
) -> Coverage:
    """Judge sets of runs of one accelerometer, alike or differing."""
    sizes = DIFFERENCES if differing else dict.fromkeys(DIFFERENCES, 0.0)
    held: Counter[str] = Counter()
    for seed in seeds:
        rng = np.random.default_rng([20, runs, seed])
        own = {n: s * rng.standard_normal(runs) for n, s in sizes.items()}
        names = {"k0": "k0", "k1": "k1_ppm", "k0_t1": "k0_t1"}
        frames = [
            one_run(rng, "A", f"r{k}", {names[n]: float(v[k]) for n, v in own.items()}, n=readings)
            for k in range(runs)
        ]
        (one,) = judge_stability(recorded(frames), terms=SIX).accelerometers
        for name, sigma in sizes.items():
            found = one.coefficient(name)
            assert found is not None
            low, high = found.scatter.ci95
            held[f"{name} sigma"] += low <= sigma <= high
            low, high = found.scatter.max_minus_min_ci95
            held[f"{name} range"] += low <= np.ptp(own[name]) <= high
        x = np.linspace(*SPAN_X_C, 111)
        curves = own["k0"][:, None] + own["k0_t1"][:, None] * x
        rms = np.sqrt(np.mean(2.0 * np.var(curves, axis=0, ddof=1)))
        assert one.k0_distance is not None
        low, high = one.k0_distance.rms_bounds(0.05)
        held["curve rms"] += low <= rms <= high
        _count_spread(held, one.shape, sizes, x)
    return Coverage(sets=len(seeds), counts=dict(held))


def _count_spread(
    held: Counter[str], shape: Shape | None, sizes: Mapping[str, float], x: FloatArray
) -> None:
    assert shape is not None
    spread = float(np.sqrt(np.mean(sizes["k0"] ** 2 + (sizes["k0_t1"] * x) ** 2)))
    low, high = shape.spread_ci95_ug
    held["spread"] += low <= spread <= high
    if spread > 0.0:
        held["spread above truth"] += shape.spread_ug > spread


CYCLES = 90  # true ones; the rule looks at 25 of them and is held to 60 more
LOOKS = (5, 7, 9, 11, 13, 16, 20, 25)
TOLD = (5, 7, 9, 11, 13)  # cycles after which "cycles still needed" is held against the truth
Law = Callable[[np.random.Generator], FloatArray]
Shaped = Callable[[FloatArray, FloatArray, np.random.Generator], FloatArray]


def _relaxing(rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Draw sizes (2, 1) and κ of an exponential run-in of K0 and K1."""
    return rng.uniform(100, 250, (2, 1)) * rng.choice([-1.0, 1.0], (2, 1)), rng.uniform(1.5, 4.0)


def _law(shape: Shaped) -> Law:
    def path(rng: np.random.Generator) -> FloatArray:
        size, kappa = _relaxing(rng)
        k = np.arange(CYCLES, dtype=float)
        return np.asarray(size * shape(k / kappa, k, rng))

    return path


def _beside(slower: Shaped) -> Law:
    def path(rng: np.random.Generator) -> FloatArray:
        size, kappa = _relaxing(rng)
        k = np.arange(CYCLES, dtype=float)
        return np.asarray(size * np.exp(-k / kappa) + slower(k, size, rng))

    return path


# each draws the true K0 and K1 of every cycle, shape (2, CYCLES)
LAWS: dict[str, Law] = {
    "still": lambda rng: np.zeros((2, CYCLES)),
    "exponential": _law(lambda u, k, rng: np.exp(-u)),
    "two exponentials": _law(
        lambda u, k, rng: np.exp(-u) + rng.uniform(0.2, 0.6) * np.exp(-k / rng.uniform(15, 35))
    ),
    "stretched": _law(lambda u, k, rng: np.exp(-(u ** rng.uniform(0.45, 0.8)))),
    "log creep": _law(lambda u, k, rng: -rng.uniform(0.05, 0.3) * np.log1p(u)),
    "power": _law(lambda u, k, rng: (1 + u) ** -rng.uniform(0.7, 1.5)),
    "creep": _beside(lambda k, size, rng: rng.uniform(1.0, 3.0) * np.sign(size) * k),
    "walk": _beside(
        lambda k, size, rng: np.cumsum(
            rng.uniform(2.0, 6.0) * rng.standard_normal((2, CYCLES)), axis=1
        )
    ),
    # nothing relaxes, and a single coefficient walks, by steps from half to twice the noise
    "walk of K0 alone": lambda rng: np.vstack(
        [
            np.cumsum(rng.uniform(1.0, 4.0) * rng.standard_normal(CYCLES)),
            np.zeros(CYCLES),
        ]
    ),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class RunInCoverage:
    """What became of run-ins of one law.

    Attributes
    ----------
    sets, stopped, wrong : int
        `wrong`: stopped, and a limit is left within 60 cycles.
    stop, could_have : float
        Medians of the cycle of the stop and of the first at which it would have been right.
    risk : float
        Mean of what was stated at the stops.
    told, more, fewer : int
        Intervals of the cycles still needed; how often the truth was above or below.
    bounded, over : int
        Of those told if nothing slow goes on, how many had an upper end, and were too low.
    """

    sets: int
    stopped: int
    wrong: int
    stop: float
    could_have: float
    risk: float
    told: int
    more: int
    fewer: int
    bounded: int
    over: int

    @property
    def text(self) -> str:
        """All in one line."""
        told = max(self.told, 1)
        return (
            f"{self.sets} sets: {self.stopped} stopped, {self.wrong} wrongly "
            f"({100 * self.wrong / max(self.stopped, 1):.1f} % of them; stated in the mean "
            f"{100 * self.risk:.1f} %) in cycle {self.stop:g}, right from {self.could_have:g} on "
            f"(medians); of {self.told} intervals {100 * self.more / told:.1f} % too low, "
            f"{100 * self.fewer / told:.1f} % too high; "
            f"if nothing slow goes on, of {self.bounded} with an upper end "
            f"{100 * self.over / max(self.bounded, 1):.1f} % too low"
        )


def run_in_coverage(
    law: str, seeds: Sequence[int], *, looks: Sequence[int] = LOOKS, nothing_slow: bool = False
) -> RunInCoverage:
    """Stop run-ins of one law by the rule; hold every stop and every interval to the truth."""
    truths = {s: LAWS[law](np.random.default_rng([21, s])) for s in seeds}
    series = {s: series_of(t, np.random.default_rng([22, s]), SIGMA) for s, t in truths.items()}
    going, stops, risks = set(seeds), dict[int, int](), list[float]()
    wrong, told, more, fewer, bounded, over = 0, 0, 0, 0, 0, 0
    with pytest.MonkeyPatch.context() as patch:
        # estimates with the same sigmas share all that the readings do not enter
        patch.setattr(relaxation, "lay_out", lru_cache(maxsize=2)(lay_out))
        patch.setattr(run_in, "DRAWS", 600)  # a probability of 0.95 is then known to 0.009
        for n in looks:
            for s in sorted(going):
                seen = [one.first(n) for one in series[s]]
                verdict = run_in.judge_run_in("S", seen, nothing_slow=nothing_slow)
                path = truths[s][:, n - 1 : n + HORIZON]
                if verdict.settled:
                    going.remove(s)
                    stops[s] = n
                    risks.append(1.0 - verdict.settled_probability)
                    wrong += bool(np.max(np.abs(path - path[:, :1])) > LIMIT)
                elif n in TOLD:
                    low, high = verdict.cycles_needed
                    needed = int(cycles_needed(path, LIMIT).max())
                    told, fewer = told + 1, fewer + (needed < low)
                    more += high is not None and needed > high
                    plain = verdict.needed_if_nothing_slow
                    if plain is not None and plain[1] is not None:
                        bounded, over = bounded + 1, over + (needed > plain[1])
    could = [1 + int(cycles_needed(t[:, : 25 + HORIZON], LIMIT).max()) for t in truths.values()]
    return RunInCoverage(
        sets=len(seeds),
        stopped=len(stops),
        wrong=wrong,
        stop=float(np.median([stops.get(s, np.inf) for s in seeds])),
        could_have=float(np.median(could)),
        risk=float(np.mean(risks)) if risks else 0.0,
        told=told,
        more=more,
        fewer=fewer,
        bounded=bounded,
        over=over,
    )
