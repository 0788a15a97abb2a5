"""Recorded runs as a stranger's chamber gives them: runs that differ, lags, steps, soaks, drift.

A simulation of its own: the model equation written out, no term of the program used.
"""

from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from scipy import signal

from thermo.recording.files import RecordedRuns, make_runs

TRUE = {
    "k1": 1.302,
    "k1_t1": 80.0,
    "k1_t2": 0.2,
    "k0": -430.0,
    "k0_t1": 11.0,
    "k0_t2": 0.05,
    "k2": 20.0,
    "k3": -15.0,
    "k_ip": 8.0,
    "delta_o": 300.0,
}
NOMINAL = 1.3
EIGHT = tuple(45.0 * k for k in range(8))


@dataclass(frozen=True, kw_only=True)
class Setup:
    """One campaign; errors are zero unless said."""

    runs: int = 4
    corners_c: tuple[float, ...] = (25.0, -40.0, 70.0, 25.0)
    soaks_c: tuple[float, ...] = ()
    rates: tuple[float, ...] = (0.8, 1.0, 1.25, 1.6)
    positions: tuple[float, ...] = EIGHT
    dwell_s: float = 60.0
    step_s: float = 10.0
    white_ug: float = 4.0
    drift_ug: float = 2.5
    drift_tau_s: float = 3600.0
    offset_ug: float = 0.0
    scale_ppm: float = 0.0
    thermistor_c: float = 0.0
    thermistor_noise_c: float = 0.005
    lag_s: float = 0.0
    loop_ug: float = 0.0
    line_ug_h: float = 0.0
    lsb_ug: float = 0.0
    odd_run_ug: float = 0.0
    nominal: float = NOMINAL
    gravity: float = 9.80665
    truth: dict[str, float] = field(default_factory=lambda: dict(TRUE))


def campaign(setup: Setup, seed: int, *, first: int = 1) -> RecordedRuns:
    """Return a campaign's recorded runs."""
    rng = np.random.default_rng(seed)
    many = [_run(setup, rng, k) for k in range(setup.runs)]
    if setup.odd_run_ug:
        many[1]["output"] += setup.truth["k1"] * 1e-6 * setup.odd_run_ug
    for k, frame in enumerate(many):
        frame["run"] = f"R{k + first}"
    return make_runs(
        pd.concat(many, ignore_index=True),
        output_unit="mA",
        gravity_m_s2=setup.gravity,
        nominal_scale=setup.nominal,
    )


def _profile(setup: Setup, k: int) -> tuple[np.ndarray, np.ndarray]:
    if setup.soaks_c:
        time_s = np.arange(0.0, 3600.0, setup.step_s)
        return time_s, np.full(time_s.size, setup.soaks_c[k % len(setup.soaks_c)])
    corners = np.array(setup.corners_c)
    rate = setup.rates[k % len(setup.rates)] / 60.0
    at = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(corners)) / rate)])
    time_s = np.arange(0.0, at[-1], setup.step_s)
    return time_s, np.interp(time_s, at, corners)


def _run(setup: Setup, rng: np.random.Generator, k: int) -> pd.DataFrame:
    time_s, temp_c = _profile(setup, k)
    n = time_s.size
    stays = int(np.ceil(time_s[-1] / setup.dwell_s)) + 1
    order = np.concatenate(
        [rng.permutation(setup.positions) for _ in range(stays // len(setup.positions) + 1)]
    )
    position = order[(time_s / setup.dwell_s).astype(int)]
    inside = temp_c
    if setup.lag_s:
        keep = np.exp(-setup.step_s / setup.lag_s)
        inside, _ = signal.lfilter([1 - keep], [1, -keep], temp_c, zi=[keep * temp_c[0]])
    inside = inside + setup.thermistor_c * rng.standard_normal()
    exact = output_of(setup.truth, inside, position, setup.gravity / 9.80665)
    noise = setup.white_ug * rng.standard_normal(n)
    keep = np.exp(-setup.step_s / setup.drift_tau_s)
    kicks = setup.drift_ug * rng.standard_normal(n) * np.sqrt(1 - keep**2)
    kicks[0] /= np.sqrt(1 - keep**2)
    noise += signal.lfilter([1.0], [1.0, -keep], kicks)
    noise += setup.offset_ug * rng.standard_normal() + setup.line_ug_h * time_s / 3600.0
    noise += setup.loop_ug * np.sign(np.gradient(temp_c))
    own = 1.0 + 1e-6 * setup.scale_ppm * rng.standard_normal()
    output = exact * own + setup.truth["k1"] * 1e-6 * noise
    if setup.lsb_ug:
        step = setup.truth["k1"] * 1e-6 * setup.lsb_ug
        output = step * np.round(output / step)
    return pd.DataFrame(
        {
            "serial": "Q1",
            "time_s": time_s,
            "temp_c": temp_c + setup.thermistor_noise_c * rng.standard_normal(n),
            "position_deg": position,
            "output": output,
        }
    )


def output_of(
    truth: dict[str, float], temp_c: np.ndarray, position: np.ndarray, site: float = 1.0
) -> np.ndarray:
    """Return the output without noise; `site` is gravity there over that of the truth's g."""
    x, angle = temp_c - 25.0, np.deg2rad(position)
    a_i, a_p = site * np.sin(angle), site * np.cos(angle)
    c = {n: 1e-6 * v for n, v in truth.items() if n != "k1"}
    bias = c["k0"] + sum(c.get(f"k0_t{k}", 0.0) * x**k for k in range(1, 6))
    scale = 1.0 + sum(c.get(f"k1_t{k}", 0.0) * x**k for k in range(1, 6))
    inner = a_i + bias + c["k2"] * a_i**2 + c["k3"] * a_i**3
    inner = inner + c["delta_o"] * a_p + c["k_ip"] * a_i * a_p
    return truth["k1"] * scale * inner
