"""Noise families, as drawn and as a covariance, and an effect's strength under the true one."""

from dataclasses import dataclass

import numpy as np

from benchmarks.blind.chamber.physics import Floats, Night

WHITE_UG = 5.0  # of a reading
BLOCK_S = 60.0
HEAD_REPEAT_ARCSEC = 0.05  # of the head, from move to move
UG_PER_ARCSEC = 1e6 * np.deg2rad(1 / 3600)
OCTAVE_TAUS_S = 60.0 * 2.0 ** np.arange(13)  # one minute to 68 hours: one over f between


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """White noise and one slow part, which goes on while the accelerometer rests."""

    white_ug: float = WHITE_UG
    ou_ug: float = 0.0
    ou_tau_s: float = 3600.0
    walk_ug_rth: float = 0.0  # per root hour
    octave_ug: float = 0.0  # flicker: this much in each octave

    def slow_parts(self) -> list[tuple[float, float]]:
        """Return (sigma, correlation time) of the stationary parts."""
        parts = [(self.octave_ug, float(tau)) for tau in OCTAVE_TAUS_S]
        return [p for p in [(self.ou_ug, self.ou_tau_s), *parts] if p[0] > 0]

    def draw(self, night: Night, rng: np.random.Generator) -> Floats:
        """Return the noise of all readings, µg."""
        t = night.age_s
        dt = np.diff(t, prepend=t[0])
        total = self.white_ug * rng.standard_normal(t.size)
        for sigma, tau in self.slow_parts():
            keep = np.exp(-dt / tau)
            kicks = sigma * np.sqrt(1 - keep**2) * rng.standard_normal(t.size)
            state = sigma * rng.standard_normal()
            for k in range(t.size):
                state = keep[k] * state + kicks[k]
                total[k] += state
        walk = self.walk_ug_rth * np.sqrt(dt / 3600) * rng.standard_normal(t.size)
        return total + np.cumsum(walk)

    def covariance(self, t: Floats, readings: Floats, period_s: float) -> Floats:
        """Return the covariance of means of so many readings around times t, µg²."""
        lag = np.abs(t[:, None] - t[None, :])
        cov = np.diag(self.white_ug**2 / readings)
        for sigma, tau in self.slow_parts():
            inside = period_s * readings[:, None] / tau  # a mean is quieter than its readings
            quiet = np.where(lag == 0, 2 * (inside - 1 + np.exp(-inside)) / inside**2, 1.0)
            cov += sigma**2 * np.exp(-lag / tau) * quiet
        if self.walk_ug_rth:
            cov += self.walk_ug_rth**2 / 3600 * np.minimum(t[:, None], t[None, :])
        return cov


FAMILIES = {
    "white": Noise(),
    "white+OU": Noise(ou_ug=3.0),
    "white+RW": Noise(walk_ug_rth=1.5),
    "white+flicker": Noise(octave_ug=1.0),
}


@dataclass(frozen=True, slots=True, eq=False)
class Yardstick:
    """Measures how visible a change of the output is: d, projected and whitened.

    d² = mᵀV⁻¹m, m the block means of the change (µg) less what bias and scale factor, both
    quadratic in temperature, can take of it, V the true covariance of the noise.
    """

    block: np.ndarray
    readings: Floats
    root: Floats  # Cholesky factor of V
    baseline: Floats  # orthonormal, whitened

    @classmethod
    def of(cls, night: Night, noise: Noise) -> "Yardstick":
        came = np.diff(night.dwell, prepend=-1) != 0
        dwell = np.cumsum(came)  # through all runs
        since = np.arange(night.run.size) - np.flatnonzero(came)[dwell - 1]
        key = 1000 * dwell + (since * night.period_s // BLOCK_S).astype(int)
        key = np.where(night.moving, -1, key)
        _, block = np.unique(key, return_inverse=True)
        block = np.where(night.moving, -1, block - int(night.moving.any()))
        readings = np.bincount(block[block >= 0]).astype(float)

        def means(y: Floats) -> Floats:
            good = block >= 0
            return np.bincount(block[good], weights=y[good]) / readings

        x = (night.case_c.mean(axis=1) - 25.0) / 50.0
        a = np.sin(np.deg2rad(night.angle_deg))
        columns = np.column_stack([means(f * x**k) for f in (np.ones_like(a), a) for k in range(3)])
        cov = noise.covariance(means(night.age_s), readings, night.period_s)
        head = HEAD_REPEAT_ARCSEC * UG_PER_ARCSEC * means(np.cos(np.deg2rad(night.angle_deg)))
        together = np.equal.outer(means(dwell), means(dwell))
        root = np.linalg.cholesky(cov + together * np.outer(head, head))
        q, _ = np.linalg.qr(np.linalg.solve(root, columns))
        return cls(block, readings, root, q)

    def strength(self, change_ug: Floats) -> float:
        """Return d of a change of all readings."""
        good = self.block >= 0
        mean = np.bincount(self.block[good], weights=change_ug[good]) / self.readings
        white = np.linalg.solve(self.root, mean)
        return float(np.linalg.norm(white - self.baseline @ (self.baseline.T @ white)))
