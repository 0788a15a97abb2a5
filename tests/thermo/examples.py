"""Recorded runs made by a simulation of its own: the model equation written out, no term used."""

import numpy as np
import pandas as pd

from thermo.recording.files import RecordedRuns, make_runs

ANGLES = (0.0, 90.0, 180.0, 270.0, 45.0, 225.0)
NOMINAL = 1.3
# Reported units: µg, ppm, µrad per power of °C; k1 in mA/g.
TRUTH = {
    "k1": 1.30229,
    "k1_t1": 80.7,
    "k1_t2": 0.309,
    "k0": -429.0,
    "k0_t1": -6.7,
    "k0_t2": -0.0576,
    "k0_t3": 4e-4,
    "k2": 17.0,
    "k3": -9.0,
    "delta_o": 310.0,
    "k_ip": 6.0,
}


def ou(rng: np.random.Generator, time_s: np.ndarray, sigma: float, tau_s: float) -> np.ndarray:
    """Draw an Ornstein-Uhlenbeck process on a grid ten times finer than the readings."""
    fine = np.arange(0.0, time_s[-1] + 1.0, (time_s[1] - time_s[0]) / 10)
    keep = np.exp(-(fine[1] - fine[0]) / tau_s)
    kicks = rng.standard_normal(fine.size) * sigma * np.sqrt(1 - keep**2)
    kicks[0] = sigma * rng.standard_normal()
    state, out = 0.0, np.empty(fine.size)
    for k, kick in enumerate(kicks):
        state = keep * state + kick
        out[k] = state
    return np.interp(time_s, fine, out)


def simulate_run(
    rng: np.random.Generator,
    *,
    serial: str = "A",
    run: str = "1",
    n: int = 1300,
    period_s: float = 12.0,
    angles: tuple[float, ...] = ANGLES,
    white_ug: float = 5.0,
    drift_ug: float = 3.0,
    loop_ug: float = 0.0,
    truth: dict[str, float] = TRUTH,
) -> pd.DataFrame:
    """Simulate one run: −40 → 70 → −40 °C, tumbled at random, output in mA."""
    time_s = np.arange(n) * period_s
    turn, end = time_s[-1] / 2, time_s[-1]
    temp_c = np.interp(time_s, [0, 0.05 * end, turn, 0.95 * end, end], [-40, -40, 70, -40, -40])
    position = rng.choice(angles, n)
    th = np.deg2rad(position)
    x, a_i, a_p = temp_c - 25.0, np.sin(th), np.cos(th)
    t = {k: v * 1e-6 for k, v in truth.items() if k != "k1"}
    k0 = sum(t.get(f"k0_t{k}", 0.0) * x**k for k in range(1, 5)) + t["k0"]
    k1 = truth["k1"] * (1 + sum(t.get(f"k1_t{k}", 0.0) * x**k for k in range(1, 5)))
    side = np.where(time_s < turn, 1.0, -1.0) * (1 - np.exp(-np.abs(x - x[0]) / 8.0))
    bracket = k0 + a_i + t["k2"] * a_i**2 + t["k3"] * a_i**3 + t["delta_o"] * a_p
    bracket = bracket + t["k_ip"] * a_i * a_p + 1e-6 * loop_ug * side
    noise = white_ug * rng.standard_normal(n) + ou(rng, time_s, drift_ug, 3600.0)
    return pd.DataFrame(
        {
            "run": run,
            "serial": serial,
            "time_s": time_s,
            "temp_c": temp_c + 0.002 * rng.standard_normal(n),
            "position_deg": position,
            "output": k1 * bracket + truth["k1"] * 1e-6 * noise,
        }
    )


def recorded(*frames: pd.DataFrame) -> RecordedRuns:
    return make_runs(
        pd.concat(frames), output_unit="mA", gravity_m_s2=9.80665, nominal_scale=NOMINAL
    )


def runs_of(seed: int, count: int = 3, **kw: object) -> RecordedRuns:
    """Return `count` runs of one accelerometer."""
    rng = np.random.default_rng(seed)
    return recorded(*(simulate_run(rng, run=str(k + 1), **kw) for k in range(count)))  # type: ignore[arg-type]
