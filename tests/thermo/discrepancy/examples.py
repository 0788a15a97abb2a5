"""Chamber runs with an effect hidden in them, simulated apart from the package's models."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from tests.thermo.examples import ou
from thermo.library import thermal_library
from thermo.planning.default_station import default_station
from thermo.planning.plan import make_plan
from thermo.planning.sequence import Sequence
from thermo.recording.files import RecordedRuns, make_runs

PERIOD_S, DWELL = 10.0, 60
NOMINAL = 1.3
# what repeats and follows position, temperature or direction: a search in a second
QUICK = tuple(
    e
    for e in thermal_library().effects
    if not e.event and e.name not in ("thermal_lag", "warm_up", "scale_hysteresis")
)


def profile(rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Return time and temperature: soaks at −40 and 70 °C, a case that lags by a minute."""
    ramp_s = 110.0 / rate * 60.0
    time_s = np.arange(0.0, 4800.0 + 2 * ramp_s, PERIOD_S)
    corners = [0, 1800, 1800 + ramp_s, 3600 + ramp_s, 3600 + 2 * ramp_s, 1e9]
    return time_s, lagged(time_s, np.interp(time_s, corners, [-40, -40, 70, 70, -40, -40]), 60.0)


def lagged(
    time_s: np.ndarray, x: np.ndarray, tau_s: float, period_s: float = PERIOD_S
) -> np.ndarray:
    """Return a first-order lag, in steps of a tenth of a reading."""
    out, share = np.empty_like(x), 1.0 - np.exp(-period_s / 10.0 / tau_s)
    state = x[0]
    for k in range(x.size):
        before = x[k - 1] if k else x[0]
        for part in np.arange(1, 11) / 10.0:
            state += share * (before + (x[k] - before) * (part - 0.05) - state)
        out[k] = state
    return out


def loop(x: np.ndarray, width: float) -> np.ndarray:
    """Return a loop's state: from −1 to 1, it follows the direction within a width."""
    out = np.zeros_like(x)
    for k in range(1, x.size):
        step = x[k] - x[k - 1]
        side = np.sign(step)
        out[k] = side + (out[k - 1] - side) * np.exp(-abs(step) / width) if step else out[k - 1]
    return out


def positions(rng: np.random.Generator, n: int, every_45: bool) -> np.ndarray:
    """Return the head's angle: the four quarters in turn, or eighths in random order."""
    dwells = -(-n // DWELL)
    if every_45:
        order = np.concatenate([rng.permutation(8) * 45.0 for _ in range(dwells // 8 + 1)])
    else:
        order = np.tile([0.0, 90.0, 180.0, -90.0], dwells // 4 + 1)
    return np.repeat(order, DWELL)[:n]


def hidden_runs(
    seed: int,
    hidden: Mapping[str, float] | None = None,
    *,
    rates: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0),
    every_45: bool = False,
    drift_ug: float = 3.0,
    tempco: float = 100e-6,
) -> RecordedRuns:
    """Return runs of accelerometer "A" with effects hidden in them, sizes in µg and s."""
    hidden, rng = hidden or {}, np.random.default_rng(seed)
    frames: list[pd.DataFrame] = []
    begun_h = 0.0
    for number, rate in enumerate(rates):
        time_s, temp_c = profile(rate)
        angle = positions(rng, time_s.size, every_45)
        seen = Seen(f"{number + 1}", time_s, temp_c, angle, begun_h)
        frames.append(read(rng, seen, hidden, drift_ug=drift_ug, tempco=tempco))
        begun_h += time_s[-1] / 3600.0 + 1.0 / 360.0
    return recorded(frames)


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What an accelerometer went through in a run; it is mounted turned on the head."""

    run: str
    time_s: np.ndarray
    temp_c: np.ndarray
    angle_deg: np.ndarray
    begun_h: float
    mount_deg: float = 0.0
    mount_missed_rad: float = 0.0
    period_s: float = PERIOD_S


def carried_out(
    seed: int,
    sequence: Sequence,
    hidden: Mapping[str, float] | None = None,
    *,
    drift_ug: float = 3.0,
    tempco: float = 100e-6,
) -> RecordedRuns:
    """Return what a proposed sequence measures of the same accelerometer, a day later."""
    rng = np.random.default_rng([seed, 1])
    plan = make_plan(sequence, default_station(sequence))
    period_s = sequence.sampling.period_s
    frames: list[pd.DataFrame] = []
    begun_h = 100.0
    # one mounting for all of its runs, turned by 100 µrad too much or too little
    missed_rad = 1e-4 * rng.standard_normal()
    for number in range(1, plan.runs + 1):
        run = plan.run(number)
        temp_c = lagged(run.time_s, run.commanded_c, 60.0, period_s)
        mount_deg = sequence.accelerometers[0].mount_deg
        seen = Seen(
            f"next-{number}", run.time_s, temp_c, run.position_deg, begun_h,
            mount_deg, missed_rad if mount_deg else 0.0, period_s,
        )  # fmt: skip
        frames.append(read(rng, seen, hidden or {}, drift_ug=drift_ug, tempco=tempco))
        begun_h += run.time_s[-1] / 3600.0 + 1.0
    return recorded(frames)


def read(
    rng: np.random.Generator,
    seen: Seen,
    hidden: Mapping[str, float],
    *,
    drift_ug: float,
    tempco: float,
) -> pd.DataFrame:
    """Return the readings of one run."""
    time_s, temp_c = seen.time_s, seen.temp_c
    head = np.deg2rad(seen.angle_deg)
    # the head errs by itself, twice a turn
    wrong = 1e-6 * hidden.get("head", 0.0) * np.sin(2 * head) + seen.mount_missed_rad
    turned = head + np.deg2rad(seen.mount_deg)
    a_i, a_p = np.sin(turned + wrong), np.cos(turned + wrong)
    inside = temp_c
    if "lag" in hidden:
        inside = lagged(time_s, temp_c, hidden["lag"], seen.period_s)
    x, hours = inside - 25.0, seen.begun_h + time_s / 3600.0
    error = -429.0 + 11.0 * x + hidden.get("bend", 0.03) * x**2
    error += hidden.get("offset", 0.0) * rng.standard_normal()
    error += hidden.get("rate", 0.0) * np.gradient(temp_c, time_s) * 60.0
    error += hidden.get("k2", 0.0) * a_i**2 + hidden.get("k3", 0.0) * a_i**3
    error += hidden.get("cross", 0.0) * a_p + hidden.get("order", 0.0) * ((x / 65.0) ** 3)
    error += hidden.get("step", 0.0) * (hours > 9.0)
    error += hidden.get("wave", 0.0) * np.sin(2 * np.pi * temp_c / 20.0)
    if "loop" in hidden:
        error += hidden["loop"] * loop(temp_c, 12.0)
    error += 5.0 * rng.standard_normal(time_s.size) + ou(rng, time_s, drift_ug, 3600.0)
    scale = 1.0 + tempco * x + 0.003 * tempco * x**2
    force = np.round(np.column_stack([np.sin(turned), np.cos(turned), 0.0 * turned]), 15)
    return pd.DataFrame(
        {
            "run": seen.run,
            "serial": "A",
            "time_s": time_s,
            "temp_c": temp_c + 0.002 * rng.standard_normal(time_s.size),
            "position_deg": seen.angle_deg,
            **dict(zip(("a_i_g", "a_p_g", "a_o_g"), force.T, strict=True)),
            "output": np.round(NOMINAL * scale * (a_i + 1e-6 * error), 7),
        }
    )


def recorded(frames: list[pd.DataFrame]) -> RecordedRuns:
    return make_runs(
        pd.concat(frames), output_unit="mA", gravity_m_s2=9.80665, nominal_scale=NOMINAL
    )
