"""Differences between runs beyond noise and drift, in the covariance and in words."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from errormodel.arrays import FloatArray
from errormodel.columns import Columns
from errormodel.run_effects import estimate_run_effects, run_grams
from thermo.uncertainty.linearised import LinearisedFit, run_names

MIN_RUNS = 4  # fewer do not tell the odd one
ODD = 0.002  # probability that one of the runs is called odd by chance


@dataclass(frozen=True, slots=True, kw_only=True)
class OddRun:
    """A run that lies apart from all others.

    Attributes
    ----------
    run_id, name : str
        Which run, and in what: "k0", "k1" or "temp_c".
    off : float
        How far from the mean of the others, in the model's unit or °C.
    sigma : float
    """

    run_id: str
    name: str
    off: float
    sigma: float


def with_run_effects(line: LinearisedFit, flat_x_c: FloatArray) -> LinearisedFit:
    """Estimate how runs differ, and put it into the covariance of the fit.

    What the estimates take up of it, as what the runs have in common, no residual shows: it is
    allowed for with all that is not known of its sigma. The rest the residual shows.
    """
    names = run_names(line.fit)
    if len(line.record.run_slices) < 2 or not names:
        return line
    columns = line.columns
    if not np.array_equal(flat_x_c, line.record["x_c"]):
        flat = line.record.with_signals(x_c=flat_x_c)
        columns = Columns(line.fit.model, flat, line.fit.as_dict())
    moves = [line.run_moves(k) for k in range(len(names))]
    shares = [line.share(k) for k in range(len(names))]
    effects = estimate_run_effects(
        run_grams(line.record, line.noise, columns, line.residual),
        line.run_directions,
        names,
        np.array([float(np.sum((s @ m) ** 2)) for s, m in zip(shares, moves, strict=True)]),
        np.array([float(s @ line.fit.cov @ s) for s in shares]),
    )
    cov = line.fit.cov
    for k, (effect, move) in enumerate(zip(effects, moves, strict=True)):
        shown = line.run_shown(k)
        hidden = np.eye(len(shown)) - shown
        cov = cov + move @ (effect.mean_sigma**2 * hidden + effect.seen_sigma**2 * shown) @ move.T
    return replace(line, fit=replace(line.fit, cov=cov), run_effects=effects)


def odd_run(line: LinearisedFit, run_ids: tuple[str, ...]) -> OddRun | None:
    """Return the run that lies farthest from the others, None when none is odd."""
    if len(run_ids) < MIN_RUNS:
        return None
    effects = line.run_effects
    found: list[tuple[float, OddRun]] = []
    for effect in effects:
        shown, noise = np.array(effect.by_run), np.array(effect.noise_by_run)
        for k, run_id in enumerate(run_ids):
            p, off, sigma = _apart(shown, noise, k, line.drift_freedom)
            if p < ODD / len(run_ids) / len(effects):
                odd = OddRun(run_id=run_id, name=effect.name, off=off, sigma=sigma)
                found.append((abs(off) / sigma, odd))
    return max(found, key=lambda pair: pair[0])[1] if found else None


def _apart(
    shown: FloatArray, noise: FloatArray, k: int, noise_freedom: float
) -> tuple[float, float, float]:
    """Return how unlikely run k is among the others, how far off it is, and the sigma of that.

    The variance has two parts: the noise's, and what the others differ by, known from few runs
    (degrees of freedom by Welch and Satterthwaite).
    """
    others = np.delete(shown, k)
    known = float(np.mean(noise**2))
    between = max(float(np.var(others, ddof=1)) - known, 0.0)
    spread2 = known + between
    freedom = spread2**2 / (known**2 / noise_freedom + between**2 / (others.size - 1))
    sigma = float(np.sqrt(spread2 * (1.0 + 1.0 / others.size)))
    off = float(shown[k] - others.mean())
    return float(2.0 * stats.t.sf(abs(off) / sigma, freedom)), off, sigma
