"""The effects that the program has names for, by their physical definitions in docs/reference.

Each is a column in µg at the input for a size of one; an effect of the scale factor is multiplied
by a_i. `rivals` gives all that each name could take of a residual, over a grid of its parameters.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.second.accelerometer import Accelerometer
from benchmarks.blind.second.campaign import Campaign

Floats = NDArray[np.float64]
Drawn = tuple[Floats, dict[str, float]]

NAMES: tuple[str, ...] = (
    "bias_temperature_order",
    "scale_temperature_order",
    "second_order",
    "third_order",
    "cross_axis",
    "temperature_rate_bias",
    "temperature_rate_scale",
    "bias_hysteresis",
    "scale_hysteresis",
    "thermal_lag",
    "run_in",
    "warm_up",
    "turn_on_offset",
    "bias_step",
    "bias_drift",
    "indexer_harmonic",
    "output_nonlinearity",
)
SHARED = ("indexer_harmonic", "output_nonlinearity")  # of the head and the digitiser
EVENTS = ("run_in", "turn_on_offset", "bias_step", "bias_drift")  # no new run shows them
# positions with which an effect is there at all, one of them drawn
NEEDS: dict[str, dict[str, tuple[object, ...]]] = {
    "third_order": {"positions": (12,)},
    "second_order": {"positions": (4, 6, 12)},
    "cross_axis": {"positions": (4, 6, 12)},
    "indexer_harmonic": {"positions": (6, 12)},
    "output_nonlinearity": {"positions": (4, 12)},
}


def loop(c: Campaign, width_c: float, memory: bool) -> Floats:
    """State of a loop, dz/dx = (sgn dx - z) / width; with memory it goes on over the rests."""
    dx = np.diff(c.x, prepend=c.x[0])
    begins = np.diff(c.run, prepend=-1) != 0
    dx[begins] = 0.0
    keep, sign = np.exp(-np.abs(dx) / width_c).tolist(), np.sign(dx).tolist()
    z, out = 0.0, []
    for k, s, new in zip(keep, sign, begins.tolist(), strict=True):
        z = 0.0 if new and not memory else s + (z - s) * k
        out.append(z)
    return np.array(out)


def plays(c: Campaign, widths_c: Floats, memory: bool) -> Floats:
    """Mean of plays (stops of dry friction) of some widths, each between -1 and 1."""
    w = np.asarray(widths_c)
    begins = (np.diff(c.run, prepend=-1) != 0).tolist()
    dx = np.diff(c.x, prepend=c.x[0]).tolist()
    state, out = np.zeros(len(w)), np.empty(len(c.run))
    for i, (step, new) in enumerate(zip(dx, begins, strict=True)):
        if new:
            state = state if memory else np.zeros(len(w))
        else:
            state = np.clip(state + 2 * step / w, -1, 1)
        out[i] = state.mean()
    return out


def inner_x(c: Campaign, tau_s: float) -> Floats:
    """Temperature inside, one time constant behind: exact where it changes evenly."""
    x, t = c.x.tolist(), c["t_s"].tolist()
    out, state = [], x[0]
    for i in range(len(x)):
        if i == 0 or c.run[i] != c.run[i - 1]:
            state = x[i]
        else:
            lag = (x[i] - x[i - 1]) / (t[i] - t[i - 1]) * tau_s
            state = x[i] - lag + (state - x[i - 1] + lag) * np.exp(-(t[i] - t[i - 1]) / tau_s)
        out.append(state)
    return np.array(out)


def head_error(c: Campaign, periods: int) -> Floats:
    """Columns of a head whose angle errs with sine and cosine of some periods a turn."""
    angle = periods * np.radians(c["theta"])
    return np.column_stack([np.sin(angle) * c.a_p, np.cos(angle) * c.a_p])


def draw(name: str, c: Campaign, acc: Accelerometer, rng: np.random.Generator) -> Drawn:
    """Return an effect's column for a size of one, and its other parameters."""
    return _DRAWS[name](c, acc, rng)


def _order(k: int, by: Floats, c: Campaign) -> Drawn:
    return by * (c.x / 50) ** k, {"order": float(k)}


def _hysteresis(c: Campaign, rng: np.random.Generator, by: Floats | float) -> Drawn:
    width = float(rng.uniform(4, 30))
    memory = bool(rng.random() < 0.5)
    if rng.random() < 0.3:
        widths = width * rng.uniform(0.3, 2.0, 6)
        return by * plays(c, widths, memory), {"plays_c": width, "memory": float(memory)}
    return by * loop(c, width, memory), {"width_c": width, "memory": float(memory)}


def _lag(c: Campaign, acc: Accelerometer, rng: np.random.Generator) -> Drawn:
    """Not linear in its size: `truth` finds the time constant instead."""
    del rng
    return acc.lagged_ug(c, inner_x(c, 1.0)), {}


def _run_in(c: Campaign, acc: Accelerometer, rng: np.random.Generator) -> Drawn:
    length = c["elapsed_h"][~c.unseen][-1]
    tau = float(np.clip(length * np.exp(rng.uniform(np.log(0.1), np.log(0.7))), 0.5, 150))
    return np.exp(-c["elapsed_h"] / tau), {"tau_h": tau}


def _warm_up(c: Campaign, acc: Accelerometer, rng: np.random.Generator) -> Drawn:
    tau = float(np.exp(rng.uniform(np.log(200), np.log(5000))))
    return np.exp(-c["t_s"] / tau), {"tau_s": tau}


def _offsets(c: Campaign, acc: Accelerometer, rng: np.random.Generator) -> Drawn:
    values = rng.standard_normal(c.protocol.runs + 1)
    values[-1] = 0.0
    return values[c.run], {}


def _step(c: Campaign, acc: Accelerometer, rng: np.random.Generator) -> Drawn:
    seen = c["elapsed_h"][~c.unseen]
    at = float(seen[int(rng.uniform(0.15, 0.85) * len(seen))])
    return (c["elapsed_h"] >= at).astype(float), {"at_h": at}


def _harmonic(c: Campaign, acc: Accelerometer, rng: np.random.Generator) -> Drawn:
    periods = int(rng.integers(2, 5))
    phase = rng.uniform(0, 2 * np.pi)
    column = head_error(c, periods) @ np.array([np.cos(phase), np.sin(phase)])
    return column, {"periods": float(periods), "phase": float(phase)}


def _readout(c: Campaign, acc: Accelerometer, rng: np.random.Generator) -> Drawn:
    odd = bool(rng.random() < 0.4)
    return (c.a_i * np.abs(c.a_i) if odd else np.abs(c.a_i)), {"odd": float(odd)}


_DRAWS: dict[str, Callable[[Campaign, Accelerometer, np.random.Generator], Drawn]] = {
    "bias_temperature_order": lambda c, acc, rng: _order(_next(acc)[0], np.ones(len(c.run)), c),
    "scale_temperature_order": lambda c, acc, rng: _order(_next(acc)[1], c.a_i, c),
    "second_order": lambda c, acc, rng: (c.a_i**2, {}),
    "third_order": lambda c, acc, rng: (c.a_i**3, {}),
    "cross_axis": lambda c, acc, rng: (c.a_p, {}),
    "temperature_rate_bias": lambda c, acc, rng: (c["rate"], {}),
    "temperature_rate_scale": lambda c, acc, rng: (c["rate"] * c.a_i, {}),
    "bias_hysteresis": lambda c, acc, rng: _hysteresis(c, rng, 1.0),
    "scale_hysteresis": lambda c, acc, rng: _hysteresis(c, rng, c.a_i),
    "thermal_lag": _lag,
    "run_in": _run_in,
    "warm_up": _warm_up,
    "turn_on_offset": _offsets,
    "bias_step": _step,
    "bias_drift": lambda c, acc, rng: (c["elapsed_h"], {}),
    "indexer_harmonic": _harmonic,
    "output_nonlinearity": _readout,
}


def _next(acc: Accelerometer) -> tuple[int, int]:
    """Lowest orders of bias and scale factor that the present model lacks."""
    if acc.present == "bare":
        return 3, 3
    return len(acc.bias), len(acc.slopes) + 1


def rivals(c: Campaign, acc: Accelerometer) -> dict[str, list[Floats]]:
    """Return for each name its columns, a list over its parameters: what it might be taken for."""
    one, a, x = np.ones(len(c.run)), c.a_i, c.x / 50
    k0, k1 = _next(acc)
    hours, seen = c["elapsed_h"], c["elapsed_h"][~c.unseen]
    length = float(seen[-1])
    loops = [loop(c, w, m) for w in (3.0, 7.0, 15.0, 40.0) for m in (False, True)]
    powers0 = [one * x**k for k in range(k0, max(k0, 4) + 1)]
    powers1 = [a * x**k for k in range(k1, max(k1, 4) + 1)]
    runs = [(c.run == k).astype(float) for k in range(c.protocol.runs)]
    heads = [head_error(c, n) for n in (2, 3, 4)]
    return {
        "bias_temperature_order": [np.column_stack(powers0)],
        "scale_temperature_order": [np.column_stack(powers1)],
        "second_order": [(a**2)[:, None]],
        "third_order": [(a**3)[:, None]],
        "cross_axis": [c.a_p[:, None]],
        "temperature_rate_bias": [np.column_stack([c["rate"], c["rate"] * x])],
        "temperature_rate_scale": [(c["rate"] * a)[:, None]],
        "bias_hysteresis": [np.column_stack(loops[0::2]), np.column_stack(loops[1::2])],
        "scale_hysteresis": [
            np.column_stack(loops[0::2]) * a[:, None],
            np.column_stack(loops[1::2]) * a[:, None],
        ],
        "thermal_lag": [acc.lagged_ug(c, inner_x(c, s))[:, None] for s in (5.0, 60.0, 300.0)],
        "run_in": [np.exp(-hours / (f * length))[:, None] for f in (0.03, 0.1, 0.3, 1.0)],
        "warm_up": [np.exp(-c["t_s"] / s)[:, None] for s in (60.0, 300.0, 1500.0, 6000.0)],
        "turn_on_offset": [np.column_stack(runs)],
        "bias_step": [
            (hours >= seen[int(f * len(seen))]).astype(float)[:, None]
            for f in np.linspace(0.04, 0.96, 24)
        ],
        "bias_drift": [hours[:, None]],
        "indexer_harmonic": [np.column_stack(heads)],
        "output_nonlinearity": [np.column_stack([np.abs(a), a * np.abs(a)])],
    }
