"""What a calibration leaves in the sensors, by the names of its parameters.

The error of six sensors is linear in the parameters:

    δω = ν⁰ + Θ·ω + D·f + κ·|ω|        δf = Δf⁰ + Γ·f + K₂·f² + lever arms

with row i of Θ, D and Γ the sensor i; `gyro_misalignment_xy` is Θ's row x, column y. A lever arm
r of accelerometer i adds the component i of ω̇ × r + ω × (ω × r).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray, freeze, readonly
from sinscal.run import AXES

# group: its title and the names of its parameters with their place in the group's array
_PAIRS = tuple((i, j) for i in range(3) for j in range(3) if i != j)
_ALL = tuple((i, j) for i in range(3) for j in range(3))
_DIAGONAL = tuple((i, i) for i in range(3))


def _matrix(prefix: str, places: Sequence[tuple[int, int]]) -> dict[str, tuple[int, int]]:
    return {f"{prefix}_{AXES[i]}{AXES[j]}": (i, j) for i, j in places}


def _vector(prefix: str) -> dict[str, tuple[int, int]]:
    return {f"{prefix}_{AXES[i]}": (i, i) for i in range(3)}


GROUPS: Mapping[str, Mapping[str, tuple[int, int]]] = {
    "gyro bias": _vector("gyro_bias"),
    "gyro scale": _vector("gyro_scale"),
    "gyro misalignment": _matrix("gyro_misalignment", _PAIRS),
    "gyro g-sensitivity": _matrix("gyro_g_sensitivity", _ALL),
    "gyro scale asymmetry": _vector("gyro_scale_asymmetry"),
    "accelerometer bias": _vector("accel_bias"),
    "accelerometer scale": _vector("accel_scale"),
    "accelerometer misalignment": _matrix("accel_misalignment", _PAIRS),
    "accelerometer second order": _vector("accel_second_order"),
    "lever arms": {f"lever_arm_{AXES[i]}_{AXES[j]}": (i, j) for i, j in _ALL},
}
GROUP_OF = {name: group for group, names in GROUPS.items() for name in names}
RIG_PREFIX = "rig_"  # the rig's own parameters stay on the rig


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Calibration:
    """How well a calibration knows the sensors.

    Attributes
    ----------
    names : tuple of str
        Parameters of the sensors, by the names of `rig calibrate`.
    cov : ndarray, shape (m, m)
        Covariance of what compensation leaves of them, SI.

    Raises
    ------
    ValueError
        If names are unknown or double, or the matrix is no covariance of theirs.
    """

    names: tuple[str, ...]
    cov: FloatArray

    def __post_init__(self) -> None:
        freeze(self, cov=readonly(self.cov))
        m = len(self.names)
        unknown = [name for name in self.names if name not in GROUP_OF]
        if unknown:
            raise ValueError(f"{unknown[0]} is no parameter of a gyro or an accelerometer")
        if len(set(self.names)) != m:
            raise ValueError("a parameter stands twice")
        if m == 0 or self.cov.shape != (m, m):
            raise ValueError(f"the covariance has shape {self.cov.shape}, expected ({m}, {m})")
        if not np.isfinite(self.cov).all():
            raise ValueError("the covariance holds a value that is not finite")
        sigma = np.sqrt(np.maximum(np.diag(self.cov), 0.0))
        scale = np.where(sigma > 0.0, sigma, 1.0)
        correlation = self.cov / np.outer(scale, scale)
        if np.abs(correlation - correlation.T).max() > 1e-6:
            raise ValueError("the covariance is not symmetric")
        # rounding of a filter's covariance may leave a correlation matrix short of zero by this
        if np.linalg.eigvalsh(correlation).min() < -1e-8 * m:
            raise ValueError("the covariance has a negative variance in some direction")

    @classmethod
    def of_sensors(cls, names: Sequence[str], cov: FloatArray) -> "Calibration":
        """Leave out the parameters that are the rig's and not the sensors'."""
        keep = [k for k, name in enumerate(names) if not name.startswith(RIG_PREFIX)]
        cov = np.asarray(cov, dtype=float)
        if cov.shape != (len(names), len(names)):
            raise ValueError(f"the covariance has shape {cov.shape}, expected {(len(names),) * 2}")
        return cls(names=tuple(names[k] for k in keep), cov=cov[np.ix_(keep, keep)])

    @property
    def root(self) -> FloatArray:
        """A matrix L with L Lᵀ the covariance, shape (m, m), even of a singular one."""
        value, vector = np.linalg.eigh(self.cov)
        return vector * np.sqrt(np.maximum(value, 0.0))


def sensor_errors(
    parameters: Mapping[str, float], gyro: FloatArray, accel: FloatArray, gyro_rate: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return measured less true rate and specific force.

    Parameters
    ----------
    parameters : mapping
        Value of each parameter by its name, SI; those left out are zero.
    gyro, accel, gyro_rate : ndarray, shape (n, 3)
        True rate, rad/s, specific force, m/s², and the rate's derivative, rad/s².

    Returns
    -------
    tuple of ndarray, each of shape (n, 3)
    """
    blocks = {group: np.zeros((3, 3)) for group in GROUPS}
    for name, value in parameters.items():
        blocks[GROUP_OF[name]][GROUPS[GROUP_OF[name]][name]] = value
    on_gyros, on_accels = np.zeros(gyro.shape), np.zeros(accel.shape)
    for group in {GROUP_OF[name] for name in parameters}:
        target = on_gyros if group.startswith("gyro") else on_accels
        target += _EFFECTS[group](blocks[group], gyro, accel, gyro_rate)
    return on_gyros, on_accels


def _at_lever_arms(r: FloatArray, w: FloatArray, w_rate: FloatArray) -> FloatArray:
    arms = r[None]  # of each accelerometer a row
    w, w_rate = w[:, None], w_rate[:, None]
    felt = np.cross(w_rate, arms) + np.cross(w, np.cross(w, arms))
    return np.einsum("kii->ki", felt)


_Effect = Callable[[FloatArray, FloatArray, FloatArray, FloatArray], FloatArray]
_EFFECTS: Mapping[str, _Effect] = {
    "gyro bias": lambda b, w, f, dw: np.diag(b),
    "gyro scale": lambda b, w, f, dw: w @ b.T,
    "gyro misalignment": lambda b, w, f, dw: w @ b.T,
    "gyro g-sensitivity": lambda b, w, f, dw: f @ b.T,
    "gyro scale asymmetry": lambda b, w, f, dw: np.abs(w) @ b.T,
    "accelerometer bias": lambda b, w, f, dw: np.diag(b),
    "accelerometer scale": lambda b, w, f, dw: f @ b.T,
    "accelerometer misalignment": lambda b, w, f, dw: f @ b.T,
    "accelerometer second order": lambda b, w, f, dw: f**2 @ b.T,
    "lever arms": lambda b, w, f, dw: _at_lever_arms(b, w, dw),
}
