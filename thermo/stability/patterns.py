"""Patterns of an accelerometer's runs over time: a step, one odd run, a loop in some runs only.

A step or an odd run is sought by the contrast that explains most of the scatter of a coefficient.
How much the best of them explains by chance does not depend on the size of the scatter, so its
law is had by simulation, exact for normal values of one size.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.statistics.scatter import holm
from thermo.stability.coefficients import FIRST, CoefficientStability
from thermo.stability.limits import FALSE_ALARM
from thermo.stability.noise import LOOPS_DIFFER
from thermo.stability.runs import RunByRun

MIN_RUNS = 4  # of fewer each is as odd as the others
DRAWS = 20_000
LOOP_GRID = 25
Kind = Literal["step", "odd run"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Pattern:
    """A step before a run, or one odd run, of a coefficient.

    `size` is the step, or how far the run lies from the mean of the others.
    """

    coefficient: str
    unit: str
    kind: Kind
    run_id: str
    size: float
    p_value: float

    @property
    def sentence(self) -> str:
        """The pattern in one line."""
        size = f"{self.size:+.3g} {self.unit}"
        if self.kind == "step":
            what = f"{self.coefficient} steps by {size} with run {self.run_id}"
            return f"{what} (p = {self.p_value:.1g})"
        return (
            f"run {self.run_id} is the odd one: its {self.coefficient} lies {size} from the others "
            f"(p = {self.p_value:.1g})"
        )


def patterns_of(
    coefficients: Sequence[CoefficientStability], trends: Sequence[str]
) -> tuple[Pattern, ...]:
    """Return the steps and odd runs of K0 and K1 beyond chance, 5 % for one false name or more.

    What a straight line explains as well is a trend, not a step.
    """
    found: dict[str, Pattern] = {}
    for c in coefficients:
        if c.name in FIRST and c.values.size >= MIN_RUNS and np.ptp(c.values) > 0.0:
            pattern, explained = _best(c)
            if c.name not in trends or explained > c.scatter.trend_share:
                found[c.name] = pattern
    named = holm({n: p.p_value for n, p in found.items()}, FALSE_ALARM)
    return tuple(found[n] for n in found if n in named)


def _best(c: CoefficientStability) -> tuple[Pattern, float]:
    """Return the step or odd run that explains most, and its share of the sum of squares."""
    n = c.values.size
    contrasts = _contrasts(n)
    rest = c.values - c.values.mean()
    explained = (contrasts @ rest) ** 2 / float(rest @ rest)
    k = int(np.argmax(explained))
    share = float(explained[k])
    odd = k < n
    at = k if odd else k - n + 2
    outside = np.delete(c.values, k) if odd else c.values[:at]
    inside = c.values[k : k + 1] if odd else c.values[at:]
    law = _law(n)
    pattern = Pattern(
        coefficient=c.name,
        unit=c.unit,
        kind="odd run" if odd else "step",
        run_id=c.run_ids[at],
        size=float(inside.mean() - outside.mean()),
        p_value=float((1 + np.count_nonzero(law >= share)) / (1 + law.size)),
    )
    return pattern, share


@cache
def _contrasts(n: int) -> FloatArray:
    """Return unit contrasts: each run against the rest, then steps with two runs on either side."""
    odd = np.eye(n)
    steps = np.array([np.arange(n) >= k for k in range(2, n - 1)], dtype=float).reshape(-1, n)
    rows = np.vstack([odd, steps])
    rows = rows - rows.mean(axis=1, keepdims=True)
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


@cache
def _law(n: int) -> FloatArray:
    """Return what the best contrast explains of normal values, many times."""
    draws = np.random.default_rng(n).standard_normal((DRAWS, n))
    draws -= draws.mean(axis=1, keepdims=True)
    return np.asarray(np.max((draws @ _contrasts(n).T) ** 2, axis=1) / np.sum(draws**2, axis=1))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Loops:
    """Heating less cooling of K0, mean over temperature, in each run, µg.

    `p_value` says how often chance alone makes them differ so; `odd` are the runs whose loop
    differs from that of most.
    """

    run_ids: tuple[str, ...]
    values: FloatArray
    sigmas: FloatArray
    p_value: float
    odd: tuple[str, ...]

    @property
    def sentence(self) -> str:
        """Say which runs differ."""
        shown = ", ".join(
            f"{r} {v:+.3g} ± {s:.2g}"
            for r, v, s in zip(self.run_ids, self.values, self.sigmas, strict=True)
        )
        which = f"in run {', '.join(self.odd)}" if self.odd else "between runs"
        return f"heating less cooling differs {which} (K0, µg: {shown}; p = {self.p_value:.1g})"


def loops_of(one: RunByRun) -> Loops | None:
    """Compare the loops of the runs; None where fewer than two have both directions."""
    heating = {r.run_id: r for r in one.curves.get(1, ())}
    cooling = {r.run_id: r for r in one.curves.get(-1, ())}
    both = [r.run_id for r in one.runs if r.run_id in heating and r.run_id in cooling]
    if len(both) < 2:
        return None
    pairs = [(heating[r], cooling[r]) for r in both]
    low = max(f.temp_c[0] for pair in pairs for f in pair)
    high = min(f.temp_c[1] for pair in pairs for f in pair)
    if low >= high:
        return None
    x = np.linspace(low, high, LOOP_GRID) - one.joint.t_ref_c
    values, variances = np.zeros(len(both)), np.zeros(len(both))
    for k, pair in enumerate(pairs):
        for sign, fitted in zip((1.0, -1.0), pair, strict=True):
            curve, gradient = fitted.curve("k0", x)
            mean = gradient.mean(axis=0)
            values[k] += sign * float(curve.mean())
            variances[k] += float(mean @ fitted.fit.cov @ mean)
    sigmas = np.sqrt(variances)
    return Loops(
        run_ids=tuple(both),
        values=values,
        sigmas=sigmas,
        p_value=one.loops_p,
        odd=_odd(both, values) if one.loops_p < LOOPS_DIFFER else (),
    )


def _odd(run_ids: Sequence[str], values: FloatArray) -> tuple[str, ...]:
    """Return the runs that lie on the far side of the half way from most to the farthest."""
    apart = np.abs(values - np.median(values))
    if values.size < 3:
        return ()
    return tuple(r for r, d in zip(run_ids, apart, strict=True) if d > 0.5 * apart.max())
