"""Recordings of a simulation of its own, and ways in which such recordings are spoiled."""

from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd

from thermo.recording.files import RecordedRuns, make_runs

NOMINAL = 1.3  # mA/g


def clean(
    seed: int,
    *,
    period_s: float = 20.0,
    noise_ug: float = 4.0,
    loop_ug: float = 0.0,
    loop_c: float = 12.0,
    step_ug: float = 0.0,
    settling_ug: float = 0.0,
    lag_s: float = 0.0,
    offsets_ug: Sequence[float] = (0.0, 0.0),
) -> pd.DataFrame:
    """Simulate runs 25 → −40 → 70 → 25 °C at 1 °C/min, eight positions of a minute.

    There are as many runs as offsets of K0.
    """
    rng = np.random.default_rng(seed)
    frames = []
    for run, offset_ug in enumerate(offsets_ug, 1):
        time_s = np.arange(0.0, 13_200.0, period_s)
        temp_c = np.interp(time_s, [0, 3900, 10_500, 13_200], [25, -40, 70, 25])
        inner_c = np.interp(time_s - lag_s, time_s, temp_c)
        dwell = max(1, int(60 / period_s))
        angle = np.repeat(rng.choice(np.arange(0, 360, 45.0), len(time_s)), dwell)[: len(time_s)]
        since_s = np.tile(np.arange(dwell) * period_s, len(time_s))[: len(time_s)]
        a_i, a_p, x = np.sin(np.radians(angle)), np.cos(np.radians(angle)), inner_c - 25.0
        heating = np.gradient(temp_c) > 0
        turn_c = np.where(heating, -40.0, np.where(time_s < 5000, 25.0, 70.0))
        side = np.where(heating, 1.0, -1.0) * (1 - np.exp(-np.abs(temp_c - turn_c) / loop_c))
        error_ug = -430 + 11 * x + 0.05 * x**2 + 20 * a_i**2 - 15 * a_i**3 + 300 * a_p
        error_ug += loop_ug * side + step_ug * (time_s > 8000) + offset_ug
        error_ug += settling_ug * np.exp(-since_s / 20.0)
        error_ug += noise_ug * rng.standard_normal(len(time_s))
        k1 = 1.302 * (1 + 80e-6 * x + 0.2e-6 * x**2)
        frames.append(
            pd.DataFrame(
                {
                    "run": str(run),
                    "serial": "A",
                    "time_s": time_s,
                    "temp_c": np.round(temp_c + 0.005 * rng.standard_normal(len(time_s)), 3),
                    "position_deg": angle,
                    "output": k1 * (a_i + 1e-6 * error_ug),
                }
            )
        )
    return pd.concat(frames, ignore_index=True)


def recorded(frame: pd.DataFrame) -> RecordedRuns:
    return make_runs(frame, output_unit="mA", gravity_m_s2=9.80665, nominal_scale=NOMINAL)


def _some(frame: pd.DataFrame, rng: np.random.Generator, length: int) -> np.ndarray:
    share = max(1, len(frame) // 100 // length)
    starts = rng.choice(len(frame) - length, share, replace=False)
    if length > 1:  # a burst anywhere, or at an end of a run, where there is no coming back
        starts[0] = rng.choice([0, len(frame) - length, starts[0]])
    return np.unique((starts[:, None] + np.arange(length)).ravel())


def _set(column: str, change: Callable[[np.ndarray], np.ndarray | float], length: int = 1):
    def spoil(frame: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
        rows, out = _some(frame, rng, length), frame.copy()
        values = out[column].to_numpy(copy=True)
        values[rows] = change(values[rows])
        return out.assign(**{column: values})

    return spoil


def _flat(column: str):
    def spoil(frame: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
        length = len(frame) // 100
        first = int(rng.integers(50, int((frame["run"] == "1").sum()) - length - 50))
        values = frame[column].to_numpy(copy=True)
        values[first : first + length] = values[first]
        return frame.assign(**{column: values})

    return spoil


def _clip(frame: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    top = np.sort(frame["output"].to_numpy())[-len(frame) // 100]
    return frame.assign(output=np.minimum(frame["output"], top))


# one row in a hundred is spoiled in each
WAYS = {
    "sensor that does not answer": _set("temp_c", lambda v: -127.0),
    "absolute zero": _set("temp_c", lambda v: -273.15),
    "sensor just powered": _set("temp_c", lambda v: 85.0),
    "temperature 5 °C off": _set("temp_c", lambda v: v + 5.0),
    "temperature 5 °C off, bursts": _set("temp_c", lambda v: v + 5.0, 8),
    "temperature flat": _flat("temp_c"),
    "overload": _set("output", lambda v: 9.9e37),
    "output 100 µg off": _set("output", lambda v: v + 130e-6),
    "output 1 mg off, bursts": _set("output", lambda v: v - 1.3e-3, 8),
    "output zero": _set("output", lambda v: 0.0),
    "output flat": _flat("output"),
    "output clipped": _clip,
}
