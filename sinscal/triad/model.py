"""The equation of a triad, f = T·K·(a − b), its derivatives, and where to start."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.errors import InputError
from sinscal.recording.run import AXES

PLACES = {"lower": ((1, 0), (2, 0), (2, 1)), "upper": ((0, 1), (0, 2), (1, 2))}


def parameter_names(gauge: Literal["lower", "upper"], with_temperature: bool) -> tuple[str, ...]:
    """Return the unknowns in their order."""
    names = [f"scale_{a}" for a in AXES]
    names += [f"misalignment_{AXES[i]}{AXES[j]}" for i, j in PLACES[gauge]]
    names += [f"bias_{a}" for a in AXES]
    if with_temperature:
        names += [f"{what}_t_{a}" for what in ("bias", "scale") for a in AXES]
    return tuple(names)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TriadModel:
    """A triad: scales K, (m/s²) per unit, T unit triangular, bias b in units, their slopes."""

    gauge: Literal["lower", "upper"]
    scale: FloatArray
    skew: FloatArray
    bias: FloatArray
    bias_t: FloatArray
    scale_t: FloatArray

    @classmethod
    def of(cls, values: FloatArray, gauge: Literal["lower", "upper"]) -> "TriadModel":
        """Return the triad of a parameter vector, shape (9,) or (15,)."""
        skew = np.eye(3)
        for (i, j), value in zip(PLACES[gauge], values[3:6], strict=True):
            skew[i, j] = value
        more = values[9:] if values.size == 15 else np.zeros(6)
        return cls(
            gauge=gauge,
            scale=values[:3],
            skew=skew,
            bias=values[6:9],
            bias_t=more[:3],
            scale_t=more[3:],
        )

    @property
    def matrix(self) -> FloatArray:
        """T·K at the reference temperature, shape (3, 3)."""
        return self.skew * self.scale

    def apply(self, readings: FloatArray, warm: FloatArray | float = 0.0) -> FloatArray:
        """Return the specific force, m/s², of readings (n, 3); `warm` is T − T_ref, °C, (n,)."""
        warm = np.broadcast_to(warm, readings.shape[:1])[:, None]
        scaled = (readings - self.bias - warm * self.bias_t) * (1.0 + warm * self.scale_t)
        return scaled @ self.matrix.T

    def magnitude(self, readings: FloatArray, warm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return |f|, shape (n,), and its derivatives by all fifteen unknowns, shape (n, 15)."""
        hot = warm[:, None]
        force = self.apply(readings, warm)
        size = np.linalg.norm(force, axis=1)
        unit = force / size[:, None]
        grown = 1.0 + hot * self.scale_t
        centred = (readings - self.bias - hot * self.bias_t) * grown
        along = unit @ self.skew  # by the scaled reading K·(a − b)
        by_scale = along * centred
        by_skew = [unit[:, i] * self.scale[j] * centred[:, j] for i, j in PLACES[self.gauge]]
        by_bias = -along * self.scale * grown
        by_scale_t = along * self.scale * centred / grown * hot
        parts = [by_scale, np.column_stack(by_skew), by_bias, by_bias * hot, by_scale_t]
        return size, np.hstack(parts)


def start_values(
    means: FloatArray, gravity_m_s2: float, gauge: Literal["lower", "upper"], source: str
) -> FloatArray:
    """Return a start from the ellipsoid on which readings at rest lie, shape (9,).

    Raises
    ------
    InputError
        If they lie on no ellipsoid: the positions are too few or too much alike.
    """
    middle = 0.5 * (means.max(axis=0) + means.min(axis=0))
    size = max(float(np.max(np.ptp(means, axis=0))) / 2.0, 1e-300)
    x = (means - middle) / size
    pairs = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
    columns = [x[:, i] * x[:, j] * (1.0 if i == j else 2.0) for i, j in pairs]
    found = np.linalg.lstsq(np.column_stack([*columns, 2.0 * x]), np.ones(x.shape[0]))[0]
    a = np.zeros((3, 3))
    for (i, j), value in zip(pairs, found[:6], strict=True):
        a[i, j] = a[j, i] = value
    try:
        centre = -np.linalg.solve(a, found[6:])
        a = a / (1.0 + centre @ a @ centre)
        upper = np.linalg.cholesky(a if gauge == "upper" else a[::-1, ::-1]).T
    except np.linalg.LinAlgError:
        raise InputError(
            source,
            "",
            "the readings at rest do not lie on an ellipsoid, expected positions with each axis "
            "up, down "
            "and between",
        ) from None
    matrix = (upper if gauge == "upper" else upper[::-1, ::-1]) * gravity_m_s2 / size
    scale = np.diag(matrix)
    skew = [matrix[i, j] / scale[j] for i, j in PLACES[gauge]]
    return np.concatenate([scale, skew, middle + size * centre])
