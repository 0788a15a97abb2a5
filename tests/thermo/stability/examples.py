"""Recorded runs for stability, simulated by themselves: the model equation written out.

A run is 240 readings in four hours, 25 → −40 → 70 → 25 °C, four positions of the head in turn.
"""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta

import numpy as np
import pandas as pd

from errormodel.arrays import FloatArray
from thermo.fitting.fit import TermsFile
from thermo.recording.files import RecordedRuns, make_runs

SIX = TermsFile(terms=("k1", "k0", "k0_t1", "k1_t1", "k2", "delta_o"))
NOMINAL = 1.3
CLEAN = {"k0": 1500.0, "k0_t1": 5.0, "k1_ppm": 200.0, "k1_t1": 80.0, "k2": 15.0, "delta_o": 300.0}


def drift(
    rng: np.random.Generator, size: int, period_s: float, sigma: float, tau_s: float
) -> FloatArray:
    """Draw an Ornstein-Uhlenbeck process, stationary from the first reading."""
    keep = np.exp(-period_s / tau_s)
    kicks = sigma * np.sqrt(1 - keep**2) * rng.standard_normal(size)
    kicks[0] = sigma * rng.standard_normal()
    found = np.zeros(size)
    state = 0.0
    for k, kick in enumerate(kicks.tolist()):
        state = keep * state + kick
        found[k] = state
    return found


def one_run(
    rng: np.random.Generator,
    serial: str,
    run: str,
    moved: Mapping[str, float] = {},
    *,
    n: int = 240,
    hours: float = 4.0,
    white_ug: float = 5.0,
    drift_ug: float = 3.0,
    tau_h: float = 1.0,
    loop_ug: float = 0.0,
    span_c: tuple[float, ...] = (25.0, -40.0, 70.0, 25.0),
) -> pd.DataFrame:
    """Simulate a run; `moved` is added to `CLEAN`, µg, ppm and µrad (per °C)."""
    t = np.linspace(0.0, hours * 3600.0, n)
    moved_c: FloatArray = np.abs(np.diff(np.array(span_c)))
    way = np.append(0.0, np.cumsum(moved_c)) / float(moved_c.sum())
    temp_c: FloatArray = np.asarray(np.interp(t / t[-1], way, np.array(span_c)), dtype=np.float64)
    theta = np.deg2rad(90.0 * (np.arange(n) % 4))
    x, a_i, a_p = temp_c - 25.0, np.sin(theta), np.cos(theta)
    c = {name: value + moved.get(name, 0.0) for name, value in CLEAN.items()}
    heating = np.gradient(temp_c, t) > 0
    side = np.where(heating, 0.5, -0.5) * loop_ug * (1 - ((temp_c - 15.0) / 55.0) ** 2)
    noise = white_ug * rng.standard_normal(n)
    noise += drift(rng, n, t[1] - t[0], drift_ug, 3600.0 * tau_h)
    bracket = a_i + 1e-6 * (
        c["k0"] + c["k0_t1"] * x + c["k2"] * a_i**2 + c["delta_o"] * a_p + side + noise
    )
    k1 = NOMINAL * (1 + 1e-6 * c["k1_ppm"]) * (1 + 1e-6 * c["k1_t1"] * x)
    return pd.DataFrame(
        {
            "run": run,
            "serial": serial,
            "time_s": t,
            "temp_c": temp_c + 0.002 * rng.standard_normal(n),
            "position_deg": np.rad2deg(theta),
            "output": k1 * bracket,
        }
    )


def recorded(frames: Sequence[pd.DataFrame], days: Mapping[str, float] = {}) -> RecordedRuns:
    """Put runs together; `days` says when they began."""
    begin = datetime(2026, 1, 1, tzinfo=UTC)
    return make_runs(
        pd.concat(frames),
        output_unit="mA",
        gravity_m_s2=9.80665,
        nominal_scale=NOMINAL,
        run_start_utc={run: begin + timedelta(days=day) for run, day in days.items()},
    )


def runs_of(
    rng: np.random.Generator,
    count: int,
    sigmas: Mapping[str, float],
    serial: str = "A",
    **kw: float,
) -> list[pd.DataFrame]:
    """Simulate runs whose coefficients differ by normal values of the sigmas given."""
    return [
        one_run(
            rng,
            serial,
            f"r{k + 1}",
            {name: s * rng.standard_normal() for name, s in sigmas.items()},
            **kw,  # type: ignore[arg-type]
        )
        for k in range(count)
    ]
