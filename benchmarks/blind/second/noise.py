"""Noise of the readings, and the whitening that gives an effect's strength d under it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

FLICKER_TAUS_S = (100.0, 1e3, 1e4, 1e5)  # relaxations that together are 1/f between their ends


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """Noise of one set; zero is none. Deviations in µg at the input, per reading."""

    white_ug: float
    heavy_tails: bool = False  # Student t of 3 degrees of freedom instead of a Gaussian
    flicker_ug: float = 0.0  # of each relaxation
    walk_ug_per_rt_h: float = 0.0
    walk_goes_on: bool = False  # through the rests
    count_ug: float = 0.0  # step of the output
    thermistor_c: float = 0.002
    gaps: int = 0  # of 10 to 40 minutes
    outlier_share: float = 0.0

    @property
    def label(self) -> str:
        """Families, joined by a plus sign."""
        words = {
            "t3": self.heavy_tails,
            "flicker": self.flicker_ug > 0,
            "walk": self.walk_ug_per_rt_h > 0,
            "counts": self.count_ug > 2,
            "thermistor": self.thermistor_c > 0.015,
            "gaps": self.gaps > 0,
            "outliers": self.outlier_share > 0,
        }
        return "+".join(["white", *(name for name, there in words.items() if there)])


def draw_noise(rng: np.random.Generator) -> Noise:
    """Draw the families of a set: white always, each other in some."""
    slow = rng.random()
    white = float(np.exp(rng.uniform(np.log(1.5), np.log(10))))
    return Noise(
        white_ug=white,
        heavy_tails=bool(rng.random() < 0.2),
        flicker_ug=float(rng.uniform(0.4, 1.5)) if slow < 0.3 else 0.0,
        walk_ug_per_rt_h=float(rng.uniform(0.5, 2.0)) if 0.3 <= slow < 0.55 else 0.0,
        walk_goes_on=bool(rng.random() < 0.5),
        count_ug=float(white * rng.uniform(2, 6)) if rng.random() < 0.15 else 0.1,
        thermistor_c=float(rng.uniform(0.02, 0.08)) if rng.random() < 0.15 else 0.002,
        gaps=int(rng.integers(1, 5)) if rng.random() < 0.2 else 0,
        outlier_share=0.005 if rng.random() < 0.2 else 0.0,
    )


def white_sigma(noise: Noise, slope_ug_per_c: Floats) -> Floats:
    """Deviation of what is white at each reading: noise, counts, the thermistor times the slope."""
    counts = noise.count_ug**2 / 12
    return np.sqrt(noise.white_ug**2 + counts + (slope_ug_per_c * noise.thermistor_c) ** 2)


def draw_readings(noise: Noise, hours: Floats, run: NDArray[np.int64], rng: np.random.Generator):
    """Return what the noise adds to the readings but for counts and thermistor, µg: white, slow."""
    n = len(hours)
    white = rng.standard_t(3, n) / np.sqrt(3) if noise.heavy_tails else rng.standard_normal(n)
    slow = np.zeros(n)
    for tau in FLICKER_TAUS_S if noise.flicker_ug else ():
        keep = np.exp(-np.diff(hours, prepend=hours[0]) * 3600 / tau)
        fresh = noise.flicker_ug * np.sqrt(1 - keep**2) * rng.standard_normal(n)
        fresh[0] = noise.flicker_ug * rng.standard_normal()
        state, out = 0.0, []
        for k, f in zip(keep.tolist(), fresh.tolist(), strict=True):
            state = k * state + f
            out.append(state)
        slow += out
    if noise.walk_ug_per_rt_h:
        walk = np.cumsum(np.sqrt(_walked_h(noise, hours, run)) * rng.standard_normal(n))
        if not noise.walk_goes_on:
            first = np.searchsorted(run, np.arange(run[-1] + 1))
            walk = walk - walk[first][run]
        slow += noise.walk_ug_per_rt_h * walk
    return noise.white_ug * white, slow


def _walked_h(noise: Noise, hours: Floats, run: NDArray[np.int64]) -> Floats:
    passed = np.diff(hours, prepend=hours[0])
    if not noise.walk_goes_on:
        passed[np.diff(run, prepend=run[0]) != 0] = 0.0
    return passed


def whiten(
    noise: Noise, sigma: Floats, hours: Floats, run: NDArray[np.int64], columns: Floats
) -> Floats:
    """Whiten columns, shape (n, p), exactly: innovations of a filter of the slow processes."""
    taus_h = np.array(FLICKER_TAUS_S if noise.flicker_ug else ()) / 3600
    k = len(taus_h) + bool(noise.walk_ug_per_rt_h)
    if k == 0:
        return columns / sigma[:, None]
    var = np.full(len(taus_h), noise.flicker_ug**2)
    cov = np.diag(np.append(var, 0.0)[:k])
    state = np.zeros((k, columns.shape[1]))
    passed = np.diff(hours, prepend=hours[0])
    walked = _walked_h(noise, hours, run) * noise.walk_ug_per_rt_h**2
    restart = (np.diff(run, prepend=run[0]) != 0) & (not noise.walk_goes_on)
    keep = np.ones((len(hours), k))
    keep[:, : len(taus_h)] = np.exp(-passed[:, None] / taus_h) if len(taus_h) else 1.0
    if k > len(taus_h):
        keep[restart, -1] = 0.0
    out = np.empty_like(columns)
    for i in range(len(hours)):
        f = keep[i]
        state *= f[:, None]
        cov *= np.outer(f, f)
        grown = np.append(var, 0.0)[:k] * (1 - f**2)
        if k > len(taus_h):
            grown[-1] = walked[i]
        cov.flat[:: k + 1] += grown
        reach = cov.sum(axis=0)
        total = reach.sum() + sigma[i] ** 2
        error = columns[i] - state.sum(axis=0)
        out[i] = error / np.sqrt(total)
        gain = reach / total
        state += gain[:, None] * error
        cov -= np.outer(gain, reach)
    return out


def project_out(columns: Floats, model: Floats) -> Floats:
    """Return whitened columns less what whitened model columns can take of them."""
    scaled = model / np.maximum(np.linalg.norm(model, axis=0), 1e-300)
    u, s, _ = np.linalg.svd(scaled, full_matrices=False)
    basis = u[:, s > 1e-9 * s[0]]
    return columns - basis @ (basis.T @ columns)
