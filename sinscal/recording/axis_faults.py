"""Name of a map from the gyros' axes to those of the forces: swapped, reversed, scaled."""

from collections.abc import Iterator
from itertools import permutations, product

import numpy as np

from errormodel.arrays import FloatArray
from sinscal.frames.earth import DEG_PER_H
from sinscal.recording.run import AXES

RATIO = 1.15  # a factor is recognised when it is as near as this
NEAR = 0.35  # entries of a signed permutation may be off by this


def factor_name(factor: float, step_s: float) -> str:
    """Return what must have happened when the gyros' readings need a factor to be rad/s."""
    degrees = np.pi / 180.0
    known = {
        "they are in °/s, expected rad/s": degrees,
        "they are increments over a step, expected rates (or columns dtheta_*)": 1.0 / step_s,
        "they are rates, expected increments (or columns gyro_*)": step_s,
        "they are increments in °, expected rates in rad/s": degrees / step_s,
        "they are rates in °/s, expected increments in rad": degrees * step_s,
        "they are in °/h, expected rad/s": DEG_PER_H,
        "time_s is in ms, expected s (or the rates are in mrad/s)": 1e-3,
        "time_s is in µs, expected s": 1e-6,
        "they are in rpm, expected rad/s": 2.0 * np.pi / 60.0,
    }
    return _nearest(factor, known)


def force_name(ratio: float, g_m_s2: float, step_s: float) -> str:
    """Return what must have happened when the force is `ratio` times gravity."""
    known = {
        "it is in g, expected m/s²": 1.0 / g_m_s2,
        "it is in mg, expected m/s²": 1e3 / g_m_s2,
        "it is in cm/s², expected m/s²": 100.0,
        "it is in ft/s², expected m/s²": 1.0 / 0.3048,
        "it is an increment over a step, expected m/s² (or columns dv_*)": step_s,
        "it is a force, expected increments (or columns accel_*)": 1.0 / step_s,
    }
    return _nearest(ratio, known)


def _nearest(value: float, known: dict[str, float]) -> str:
    off = {text: abs(float(np.log(value / one))) for text, one in known.items()}
    near = [text for text in sorted(off, key=lambda name: off[name]) if off[text] < np.log(RATIO)]
    return ", or ".join(near) or "no known unit explains it"


def permutation_of(matrix: FloatArray, known: tuple[bool, ...]) -> FloatArray | None:
    """Return the signed permutation that the known columns are near to, others zero; or None."""
    out = np.zeros((3, 3))
    for k in np.flatnonzero(known).tolist():
        column = matrix[:, k] / np.linalg.norm(matrix[:, k])
        row = int(np.argmax(np.abs(column)))
        out[row, k] = np.sign(column[row])
        if np.max(np.abs(column - out[:, k])) > NEAR:
            return None
    return out if (np.abs(out).sum(axis=1) <= 1).all() else None


def fault_names(permutation: FloatArray, known: tuple[bool, ...]) -> list[str]:
    """Return the simplest faults that explain a signed permutation in its known columns.

    With accelerometers N f and gyros Q ω in place of f and ω the map is det(N) N Qᵀ.
    """
    columns = np.flatnonzero(known)
    found: dict[int, list[str]] = {}
    for (n, cost_n, text_n), (q, cost_q, text_q) in product(
        _signed("accelerometer"), _signed("gyro")
    ):
        made = np.linalg.det(n) * n @ q.T
        if np.allclose(made[:, columns], permutation[:, columns]):
            text = " and ".join(t for t in (text_n, text_q) if t)
            found.setdefault(cost_n + cost_q, []).append(text)
    return found[min(found)]


def _signed(sensor: str) -> Iterator[tuple[FloatArray, int, str]]:
    """Yield every signed permutation, how many faults it takes, and their names.

    A whole triad reversed is one fault: another convention of signs.
    """
    for order in permutations(range(3)):
        moved = [k for k in range(3) if order[k] != k]
        swaps = max(len(moved) - 1, 0)
        for signs in product((1.0, -1.0), repeat=3):
            matrix = np.diag(signs) @ np.eye(3)[list(order)]
            minus = [AXES[k] for k in range(3) if signs[k] < 0]
            parts: list[str] = []
            if moved:
                parts.append(f"{sensor} axes {', '.join(AXES[k] for k in moved)} swapped")
            if minus:
                which = f"all {sensor}s" if len(minus) == 3 else f"{sensor} {', '.join(minus)}"
                parts.append(f"{which} reversed")
            yield matrix, swaps + (1 if len(minus) == 3 else len(minus)), " and ".join(parts)
