"""Rests of a triad in many positions, made for tests."""

import numpy as np

from sinscal.triad.model import TriadModel

G = 9.81
COUNTS = np.array([2.4e-3, 2.5e-3, 2.3e-3, 0.004, -0.009, 0.02, 33_000.0, 33_200.0, 32_400.0])


def directions(k: int, rng: np.random.Generator) -> np.ndarray:
    """Random directions, and each axis up and down among them."""
    drawn = rng.standard_normal((k - 6, 3))
    drawn /= np.linalg.norm(drawn, axis=1)[:, None]
    return np.vstack([np.eye(3), -np.eye(3), drawn])


def readings(force: np.ndarray, values: np.ndarray, gauge: str, warm: np.ndarray) -> np.ndarray:
    """Return what the triad reads: the inverse of its equation."""
    model = TriadModel.of(values, gauge)  # type: ignore[arg-type]
    scaled = force @ np.linalg.inv(model.matrix).T
    return scaled / (1 + warm[:, None] * model.scale_t) + model.bias + warm[:, None] * model.bias_t


def recording(
    *,
    seed: int,
    positions: int = 20,
    rest_s: float = 4.0,
    move_s: float = 2.0,
    noise: float = 3.0,
    values: np.ndarray = COUNTS,
    unit: float = 1.0,
) -> tuple[np.ndarray, list[tuple[int, int]]]:
    """Return raw readings at 100 Hz, handled between rests, and the rows of the true rests."""
    rng = np.random.default_rng(seed)
    force = G * directions(positions, rng)
    still, move = round(100 * rest_s), round(100 * move_s)
    parts, rests, row = [], [], 0
    for k in range(positions):
        parts.append(np.repeat(force[k : k + 1], still, axis=0))
        rests.append((row, row + still))
        if k + 1 < positions:
            share = np.linspace(0, 1, move)[:, None]
            way = (1 - share) * force[k] + share * force[k + 1]
            parts.append(way + 2.0 * rng.standard_normal((move, 3)))  # a hand
        row += still + move
    all_force = np.vstack(parts)
    raw = readings(all_force, values, "lower", np.zeros(all_force.shape[0]))
    return unit * (raw + noise * rng.standard_normal(raw.shape)), rests
