"""How visible an effect is in a rig run: d, projected and whitened, by a batch of its own.

An error of the rates turns the computed attitude, φ̇ = −Ω × φ + C·δω, and the computed force is then
wrong by φ × g + C·δf; with the rig's angle φ less the encoder's error along the axis is seen as
well, beside a platform that may stand anyhow; across the axis the angle's noise is the bound of the
bearing's wobble. All of it in means of a second. The gyros' noise makes φ a random walk, so the
rows of a cycle have a full covariance; nothing here is a filter.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from benchmarks.blind.rig.motion import (
    AXES,
    EARTH_RATE,
    STEP_S,
    Floats,
    Motion,
    attitude_at_zero,
    axis_angles,
    move,
    normal_gravity,
    skew,
)
from benchmarks.blind.rig.setup import ARCSEC, DEG_H, PRIOR, T_REF_C, Setup, draw_baseline
from benchmarks.blind.rig.truth import Stranger, Truth, cut, measured, temperatures

EVERY = 20  # 50 Hz are enough for what is smooth within a second
PER_S = round(1 / STEP_S) // EVERY
AZIMUTH_SIGMA = np.deg2rad(1.0)  # as the sidecar says
FREE = 1e3  # sigma, rad, of what is not known at all


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Leg:
    """One cycle seen by the yardstick: its motion, what attitude does to the rows, their noise."""

    motion: Motion
    t: Floats
    x: Floats
    c_nb: Floats
    turned: Floats  # what the earth has turned since the start, (n, 3, 3)
    by_attitude: Floats  # rows of a second, (m, 3)
    along: Floats
    root: Floats  # Cholesky factor of the rows' covariance
    seconds: int

    def means(self, values: Floats) -> Floats:
        """Return means over seconds, (seconds, …)."""
        whole = values[: self.seconds * PER_S]
        return whole.reshape(self.seconds, PER_S, *values.shape[1:]).mean(axis=1)

    def rows(self, rate: Floats, force: Floats, truth: Truth) -> Floats:
        """Return what errors of rates, forces (n, 3) and those of the rig do, whitened."""
        seen = np.einsum("nij,nj->ni", self.c_nb, rate)
        frozen = np.cumsum(np.einsum("nji,nj->ni", self.turned, seen), axis=0) / PER_S
        attitude = self.means(np.einsum("nij,nj->ni", self.turned, frozen))
        out = attitude @ self.by_attitude.T
        out[:, :3] += self.means(np.einsum("nij,nj->ni", self.c_nb, force))
        if self.by_attitude.shape[0] > 3:
            mount = self.c_nb @ truth.vec("rig_mount")
            out[:, 3:] -= self.means(_angle_error(truth, self.motion)[:, None] * self.along + mount)
        return np.linalg.solve(self.root, out.ravel())

    def starts(self) -> Floats:
        """Return what errors of the attitude at the start do, whitened, three columns."""
        turned = self.means(self.turned)
        made = np.einsum("ai,nij->naj", self.by_attitude, turned)
        return np.linalg.solve(self.root, made.reshape(-1, 3))

    def platform(self) -> Floats:
        """Return what the platform's attitude does, whitened, three columns; none without angle."""
        rows = self.by_attitude.shape[0]
        made = np.zeros((self.seconds, rows, rows - 3))
        made[:, 3:] = np.eye(rows - 3)
        return np.linalg.solve(self.root, made.reshape(self.seconds * rows, -1))


def _leg(setup: Setup, number: int, start_s: float) -> Leg:
    axis = AXES.index(setup.axes[number])
    whole = move(setup.rig, axis, setup.programme, np.zeros(3))
    seconds = int(len(whole.omega_ib) * STEP_S + 1e-9)
    motion = cut(whole, seconds * PER_S * EVERY, EVERY)
    n = len(motion.omega_ib)
    since = STEP_S * EVERY * (np.arange(n) + 0.5)
    along, _ = axis_angles(setup.rig)
    zero = attitude_at_zero(setup.rig, axis)
    middle = 0.5 * (motion.angle[1:] + motion.angle[:-1])
    c_nb = _turns(along, middle) @ zero
    latitude = np.deg2rad(setup.rig.latitude_deg)
    earth = np.array([0.0, np.cos(latitude), np.sin(latitude)])
    g = normal_gravity(latitude, setup.rig.height_m)
    by_attitude = -g * skew([0.0, 0.0, 1.0])
    if setup.angles:
        by_attitude = np.vstack([by_attitude, np.eye(3)])
    t = start_s + since
    return Leg(
        motion=motion,
        t=t,
        x=temperatures(setup, t) - T_REF_C,
        c_nb=c_nb,
        turned=_turns(earth, -EARTH_RATE * since),
        by_attitude=by_attitude,
        along=along,
        root=_root(setup, by_attitude, seconds),
        seconds=seconds,
    )


def _turns(axis: Floats, angles: Floats) -> Floats:
    """Return rotations about one axis, (n, 3, 3)."""
    k = skew(axis)
    sine, cosine = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    return np.eye(3) + sine * k + (1 - cosine) * (k @ k)


def _root(setup: Setup, by_attitude: Floats, seconds: int) -> Floats:
    """Return the Cholesky factor of the rows' covariance: white noise and the walk of attitude."""
    middle = np.arange(seconds) + 0.5
    walk = np.minimum.outer(middle, middle) - np.eye(seconds) / 6  # a mean's own second
    walk *= (setup.gyro_noise_deg_h * DEG_H) ** 2
    white = [setup.accel_noise**2] * 3 + [(setup.angle_noise_arcsec * ARCSEC) ** 2] * 3
    cov = np.kron(walk, by_attitude @ by_attitude.T)
    cov += np.kron(np.eye(seconds), np.diag(white[: by_attitude.shape[0]]))
    return np.linalg.cholesky(cov)


@dataclass(frozen=True, slots=True, eq=False)
class RigYardstick:
    """Measures d² = mᵀV⁻¹m, m what a change leaves beside the errors every calibration expects.

    These count with their a priori sigmas, attitudes at the start are free but for a common
    azimuth known to a degree.
    """

    legs: tuple[Leg, ...]
    baseline: Floats  # orthonormal; the last rows are the priors'
    priors: int

    @classmethod
    def of(cls, setup: Setup) -> "RigYardstick":
        legs: list[Leg] = []
        start_s = 0.0
        for number in range(len(setup.axes)):
            legs.append(_leg(setup, number, start_s))
            start_s += legs[-1].seconds + setup.gap_s
        names = list(draw_baseline(np.random.default_rng(0)))
        blocks = [_column(legs, {n: 1.0}, None)[:, None] for n in names]
        sigmas = [PRIOR[n.rpartition("_")[0]] for n in names]
        starts = [leg.starts() for leg in legs]
        edges = np.cumsum([0, *(len(s) for s in starts)])
        azimuth = np.concatenate([s[:, 2] for s in starts])[:, None]
        blocks.append(azimuth)
        sigmas.append(AZIMUTH_SIGMA)
        for k, leg in enumerate(legs):
            free = np.column_stack([starts[k][:, :2], leg.platform()])
            wide = np.zeros((edges[-1], free.shape[1]))
            wide[edges[k] : edges[k + 1]] = free
            blocks.append(wide)
            sigmas += [FREE] * free.shape[1]
        columns = np.vstack([np.hstack(blocks), np.diag(1 / np.array(sigmas))])
        scaled = columns / np.linalg.norm(columns, axis=0)
        q, _ = np.linalg.qr(scaled)
        return cls(tuple(legs), q, len(sigmas))

    def trace(self, values: Mapping[str, float], stranger: Stranger | None = None) -> Floats:
        """Return what parameters, or a stranger, leave beside the baseline, whitened."""
        column = np.append(_column(self.legs, values, stranger), np.zeros(self.priors))
        return column - self.baseline @ (self.baseline.T @ column)

    def strength(self, values: Mapping[str, float], stranger: Stranger | None = None) -> float:
        """Return d."""
        return float(np.linalg.norm(self.trace(values, stranger)))


@lru_cache(maxsize=4)
def yardstick_of(setup: Setup) -> RigYardstick:
    """Return a set-up's yardstick, made once."""
    return RigYardstick.of(setup)


def _column(legs: Sequence[Leg], values: Mapping[str, float], stranger: Stranger | None) -> Floats:
    """Return the whitened rows of all cycles."""
    truth, none = Truth(values), Truth({})
    parts: list[Floats] = []
    for leg in legs:
        rate, force = measured(truth, leg.motion, leg.t, leg.x)
        plain_rate, plain_force = measured(none, leg.motion, leg.t, leg.x)
        rate, force = rate - plain_rate, force - plain_force
        if stranger is not None:
            more_rate, more_force = stranger(leg.motion, leg.t, leg.x)
            rate, force = rate + more_rate, force + more_force
        parts.append(leg.rows(rate, force, truth))
    return np.concatenate(parts)


def _angle_error(truth: Truth, motion: Motion) -> Floats:
    """Return the encoder's error: the clock's offset and harmonics."""
    angle = 0.5 * (motion.angle[1:] + motion.angle[:-1])
    turn = np.diff(motion.angle) / (STEP_S * EVERY)
    waves = sum(
        truth.one(f"rig_angle_harmonic_{name}{k}") * wave(k * angle)
        for name, wave in (("sin", np.sin), ("cos", np.cos))
        for k in (1, 2)
    )
    return truth.one("rig_time_offset") * turn + waves
