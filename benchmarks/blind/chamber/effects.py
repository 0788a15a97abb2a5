"""An accelerometer with something hidden: what each effect adds, one unit of size at a time."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from benchmarks.blind.chamber.physics import (
    COLD_C,
    HOT_C,
    STEP_S,
    Floats,
    Night,
    Relays,
    follow,
    relays,
)

SECOND_POLE = 0.05  # of the lag's time constant: the head behind the shell
WIDTH_C = 12.0
RUN_IN_S, WARM_UP_S, WAVE_S = 5 * 3600.0, 1200.0, 75 * 60.0
WAVE_C = 20.0

# name: unit of its size
UNITS = {
    "thermal_lag": "s",
    "temperature_rate_bias": "µg/(°C/min)",
    "temperature_rate_scale": "ppm/(°C/min)",
    "bias_hysteresis": "µg",
    "scale_hysteresis": "ppm",
    "bias_temperature_order": "µg",  # at the ends of the range
    "scale_temperature_order": "ppm",
    "second_order": "µg/g²",
    "third_order": "µg/g³",
    "cross_axis": "µrad",
    "run_in": "µg",
    "warm_up": "µg",
    "turn_on_offset": "µg",
    "bias_step": "µg",
    "bias_drift": "µg/h",
    "indexer_harmonic": "arcsec",
    "output_nonlinearity": "ppm",
    # in nobody's library
    "periodic_in_temperature": "µg",
    "periodic_in_time": "µg",
    "slow_wander": "µg",
    "intermittent_contact": "µg",
}
OUTSIDE = tuple(UNITS)[-4:]
LIBRARY = tuple(UNITS)[:-4]


@dataclass(frozen=True, slots=True, kw_only=True)
class Accelerometer:
    """What the baseline of the workflow knows: bias and scale factor, quadratic in temperature."""

    k1: float = 1.3  # mA/g
    k0_ug: float = 300.0
    b1_ug: float = 11.0
    b2_ug: float = 0.02
    s1_ppm: float = 100.0
    s2_ppm: float = 0.3

    @classmethod
    def drawn(cls, rng: np.random.Generator, *, tempco: bool = True) -> "Accelerometer":
        return cls(
            k1=1.3 * rng.uniform(0.98, 1.02),
            k0_ug=rng.uniform(-500.0, 500.0),
            b1_ug=rng.uniform(8.0, 14.0) * float(rng.choice([-1.0, 1.0])),
            b2_ug=rng.uniform(-0.03, 0.03),
            s1_ppm=rng.uniform(80.0, 120.0) * tempco,
            s2_ppm=rng.uniform(-0.4, 0.4) * tempco,
        )


def events(night: Night, rng: np.random.Generator) -> dict[str, Floats]:
    """Draw what happens once: shapes (rms or height one) that an effect then scales."""
    runs = int(night.run[-1]) + 1
    offsets = rng.standard_normal(runs)
    offsets -= offsets.mean()
    offsets = offsets / float(offsets.std())
    inside = np.flatnonzero((night.run > 0) & (night.run < runs - 1))
    # in the second or third run, not where they meet: that is an offset of a run
    share = 0.5 * float(rng.integers(2)) + rng.uniform(0.12, 0.4)
    chosen = inside[int(inside.size * share)]
    wander = np.cumsum(np.cumsum(rng.standard_normal(night.run.size)))
    k = np.arange(wander.size) - wander.size / 2
    wander = wander - wander.mean() - k * (k @ wander) / (k @ k)
    contact = np.zeros(night.run.size)
    for _ in range(40):
        k = int(rng.integers(night.run.size))
        contact[k : k + int(rng.integers(6, 60))] = 1.0
    phase = 2 * np.pi * rng.random()
    return {
        "turn_on_offset": offsets[night.run],
        "bias_step": (np.arange(night.run.size) >= chosen).astype(float),
        "slow_wander": wander / wander.std(),
        "intermittent_contact": contact,
        "periodic_in_time": np.sin(2 * np.pi * night.age_s / WAVE_S + phase),
    }


def bias_shapes(
    night: Night, inner_c: Floats, once: Mapping[str, Floats]
) -> dict[str, Callable[[], Floats]]:
    """Return what adds to the bias, in µg for a size of one; shape (n, 2) or (n, 1)."""
    u = (inner_c - 0.5 * (HOT_C + COLD_C)) / (0.5 * (HOT_C - COLD_C))
    column = {name: shape[:, None] for name, shape in once.items()}
    return {
        "temperature_rate_bias": lambda: night.flux_c_per_min,
        "bias_hysteresis": lambda: loop(night),
        "bias_temperature_order": lambda: u**3,
        "run_in": lambda: np.exp(-night.age_s / RUN_IN_S)[:, None],
        "warm_up": lambda: np.exp(-night.time_s / WARM_UP_S)[:, None],
        "bias_drift": lambda: night.age_s[:, None] / 3600,
        "periodic_in_temperature": lambda: np.sin(2 * np.pi * inner_c / WAVE_C),
        **{name: lambda name=name: column[name] for name in column},
    }


@lru_cache(maxsize=1)  # of the night at hand: it is walked through more than once
def loop(night: Night) -> Floats:
    """Return a Preisach loop whose half height in the middle of the range is one."""
    ensemble = relays(WIDTH_C)
    half = _half_height(ensemble)
    parts: list[Floats] = []
    for number, path in enumerate(night.path_c):
        state = ensemble.walk(path) / half
        at = night.time_s[night.run == number]
        parts.append(np.interp(at - 0.5, 4 * STEP_S * np.arange(path.size), state))
    return np.concatenate(parts)[:, None]


def _half_height(ensemble: Relays) -> float:
    up = np.arange(COLD_C, HOT_C, 0.25)
    state = ensemble.walk(np.concatenate([up, up[::-1]]))
    middle = (up > 0.0) & (up < 30.0)
    gap = state[: up.size] - state[up.size :][::-1]
    return 0.5 * float(gap[middle].mean())


def inner_temperature(night: Night, tau_s: float) -> Floats:
    """Return the temperature that the mechanism has: two poles behind the case."""
    if tau_s <= 0:
        return night.case_c
    parts: list[Floats] = []
    for number, path in enumerate(night.path_c):
        coarse = 4 * STEP_S * np.arange(path.size)
        fine = np.arange(0.0, coarse[-1] + STEP_S, STEP_S)
        inner = follow(follow(np.interp(fine, coarse, path), tau_s), SECOND_POLE * tau_s)
        at = night.time_s[night.run == number][:, None] - STEP_S * np.array([2, 1])
        parts.append(np.interp(at, fine, inner))
    return np.concatenate(parts)


def output_g(
    night: Night,
    device: Accelerometer,
    hidden: Mapping[str, float],
    once: Mapping[str, Floats],
    head_deg: Floats | float = 0.0,
) -> Floats:
    """Return the output without noise over K1 at 25 °C, g: mean of the half seconds of a reading.

    `hidden` has the effects' sizes, `head_deg` how far the head stands from where it should.
    """
    inner = inner_temperature(night, hidden.get("thermal_lag", 0.0))
    x = inner - 25.0
    commanded = np.deg2rad(night.angle_deg)
    harmonic = hidden.get("indexer_harmonic", 0.0) / 3600 * np.cos(2 * commanded)
    angle = commanded + np.deg2rad(night.mount_deg + harmonic + head_deg)
    a_i, a_p = np.sin(angle)[:, None], np.cos(angle)[:, None]
    bias = device.k0_ug + device.b1_ug * x + device.b2_ug * x**2
    shapes = bias_shapes(night, inner, once)
    for name, size in hidden.items():
        if name in shapes:
            bias = bias + size * shapes[name]()
    bias = bias + hidden.get("second_order", 0.0) * a_i**2
    bias = bias + hidden.get("third_order", 0.0) * a_i**3
    bias = bias + hidden.get("cross_axis", 0.0) * a_p
    scale = device.s1_ppm * x + device.s2_ppm * x**2
    if "temperature_rate_scale" in hidden:
        scale = scale + hidden["temperature_rate_scale"] * night.flux_c_per_min
    if "scale_hysteresis" in hidden:
        scale = scale + hidden["scale_hysteresis"] * loop(night)
    if "scale_temperature_order" in hidden:
        scale = scale + hidden["scale_temperature_order"] * ((inner - 15.0) / 55.0) ** 3
    out = (1 + 1e-6 * scale) * (a_i + 1e-6 * bias)
    out = out + 1e-6 * hidden.get("output_nonlinearity", 0.0) * np.abs(out)
    return np.asarray(out.mean(axis=1))
