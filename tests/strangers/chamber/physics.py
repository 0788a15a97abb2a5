"""Physics of an accelerometer in a chamber, from IEEE 1293 alone: no code of accelbench."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

Array = NDArray[np.float64]
DEFAULTS = {"white_ug": 5.0, "temp_noise_c": 0.002, "drift_tau_s": 3600.0, "loop_width_c": 12.0}


class Faults(dict[str, float]):
    """What a test does beside the equation, by name with its unit; what is not named is 0."""

    def __missing__(self, name: str) -> float:
        return DEFAULTS.get(name, 0.0)


@dataclass(frozen=True)
class Run:
    """What one run recorded; forces along IA, PA, OA in local g as the positions say."""

    time_s: Array
    temp_c: Array
    position_deg: Array
    force_g: Array
    output: Array


@dataclass(frozen=True)
class Accelerometer:
    """True coefficients about 25 °C: µg, ppm and µrad as reported; `scale` is output unit per g."""

    scale: float
    k0: tuple[float, ...]
    k1: tuple[float, ...]  # ppm/°C, order 1 upwards
    static: dict[str, float]

    def coefficients(self, t_ref_c: float, constant: bool = False) -> dict[str, float]:
        """Return the true coefficients about a reference temperature.

        With `constant` the input is an unknown 1 g: K0 holds it, K1 and what else it makes.
        """
        shift = Polynomial([t_ref_c - 25.0, 1.0])
        bias = Polynomial(self.k0)(shift)
        gain = Polynomial([1.0, *(1e-6 * s for s in self.k1)])(shift)
        if constant:
            still = 1e6 + self.static["k2"] + self.static["k3"]
            return _series("k0", gain * (bias + still))
        at_ref = float(gain(0.0))
        found = _series("k0", bias) | _series("k1", 1e6 * gain / at_ref)
        return found | self.static | {"k1": self.scale * at_ref}

    def shifted(self, k0_ug: float, k1_ppm: float) -> "Accelerometer":
        """Return the same accelerometer with another K0 and K1."""
        gain = 1.0 + 1e-6 * k1_ppm
        return replace(self, k0=(self.k0[0] + k0_ug, *self.k0[1:]), scale=self.scale * gain)

    def output(self, temp_c: Array, force_g: Array, more_ug: Array, more_ppm: Array) -> Array:
        """Return the output for forces, shape (rows, 3), in g, with added µg and ppm."""
        inner = Polynomial(self.k0)(temp_c - 25.0) + more_ug
        for name, value in self.static.items():
            inner = inner + value * columns(force_g)[name]
        gain = 1.0 + 1e-6 * (Polynomial([0.0, *self.k1])(temp_c - 25.0) + more_ppm)
        return self.scale * gain * (force_g[:, 0] + 1e-6 * inner)


def _series(family: str, polynomial: Polynomial) -> dict[str, float]:
    coefficients = np.asarray(polynomial.coef, dtype=float)
    names = [family, *(f"{family}_t{k}" for k in range(1, len(coefficients)))]
    return dict(zip(names, map(float, coefficients), strict=True))


def columns(force_g: Array) -> dict[str, Array]:
    """Return what each static coefficient multiplies, g to its power; K1's in g."""
    i, p, o = force_g.T
    found = {"k1": i, "k0": np.ones(len(i)), "k2": i**2, "k3": i**3, "delta_o": p}
    return found | {"delta_p": -o, "k_ip": i * p, "k_io": i * o}


def forces(head_deg: Array) -> Array:
    """Return the forces along IA, PA, OA in g on the indexing head, shape (rows, 3)."""
    turn = np.deg2rad(head_deg)
    return np.column_stack([np.sin(turn), np.cos(turn), np.zeros(len(turn))])


def lagged(time_s: Array, value: Array, tau_s: float) -> Array:
    """Return a first-order lag of `value`, starting in equilibrium, exact for straight pieces."""
    out = value.copy()
    for k in range(1, len(out)):
        step = time_s[k] - time_s[k - 1]
        late = (value[k] - value[k - 1]) / step * tau_s
        out[k] = value[k] - late + (out[k - 1] - value[k - 1] + late) * np.exp(-step / tau_s)
    return out


def loop(temp_c: Array, width_c: float) -> Array:
    """Return the state −1…1 of a rate-independent loop that begins at 0 (Duhem)."""
    state = np.zeros(len(temp_c))
    for k, step in enumerate(np.diff(temp_c), start=1):
        side = np.sign(step)
        state[k] = side + (state[k - 1] - side) * np.exp(-abs(step) / width_c)
    return state


def drift(time_s: Array, fault: Faults, started_s: float, rng: np.random.Generator) -> Array:
    """Return what drifts in a run, µg: Gauss-Markov, walk, 1/f, linear, daily, step."""
    steps = np.diff(time_s, prepend=time_s[0])
    keep = np.exp(-steps / fault["drift_tau_s"])
    markov = fault["drift_ug"] * rng.standard_normal(len(time_s))
    for k in range(1, len(markov)):
        markov[k] = keep[k] * markov[k - 1] + np.sqrt(1.0 - keep[k] ** 2) * markov[k]
    kicks = rng.standard_normal(len(time_s)) * np.sqrt(steps / 3600.0)
    spectrum = np.fft.rfft(rng.standard_normal(2 * len(time_s)))
    spectrum[1:] /= np.sqrt(np.arange(1, len(spectrum)))
    spectrum[0] = 0.0
    pink = np.fft.irfft(spectrum)[: len(time_s)]
    hours = (started_s + time_s) / 3600.0
    total = markov + fault["walk_ug_per_rt_h"] * np.cumsum(kicks)
    total += fault["flicker_ug"] * pink / np.std(pink) + fault["linear_ug_per_h"] * hours
    total += fault["daily_ug"] * np.sin(2.0 * np.pi * hours / 24.0)
    return total + fault["step_ug"] * (time_s > 0.55 * time_s[-1])


def noise(count: int, fault: Faults, rng: np.random.Generator) -> Array:
    """Return the readings' own noise, µg: normal or Student, with bursts of 40 sigma."""
    white = rng.standard_normal(count)
    if fault["tails"]:
        white = rng.standard_t(fault["tails"], count)
    bursts = (rng.random(count) < fault["burst_share"]) * rng.choice([-40.0, 40.0], count)
    return fault["white_ug"] * (white + bursts)


def record(
    sensor: Accelerometer,
    fault: Faults,
    plan: tuple[Array, Array, Array, Array | None],
    rng: np.random.Generator,
    started_s: float = 0.0,
    site: float = 1.0,
) -> Run:
    """Record one run of a plan: times, temperatures, head's angles, forces in g or None.

    `site` is local gravity over that at which a g of `sensor.scale` is meant.
    """
    time_s, temp_c, head_deg, force = plan
    stated = forces(head_deg) if force is None else force
    true = forces(head_deg + np.rad2deg(1e-6 * fault["head_urad"])) if force is None else force
    inside = lagged(time_s, temp_c, fault["lag_s"]) if fault["lag_s"] else temp_c
    rate, state = 60.0 * np.gradient(inside, time_s), loop(inside, fault["loop_width_c"])
    since = np.full(len(time_s), 1e9)
    for k in np.flatnonzero(np.any(np.diff(true, axis=0, prepend=true[:1]) != 0.0, axis=1)):
        since[k:] = time_s[k:] - time_s[k] + 2.0
    knee = np.tanh((inside - 40.0) / 6.0)  # no polynomial of order 4
    ug = drift(time_s, fault, started_s, rng) + noise(len(time_s), fault, rng)
    ug += fault["rate_ug"] * rate + fault["loop_ug"] * state + fault["kink_ug"] * knee
    ug += fault["settle_ug"] * np.exp(-since / max(fault["settle_s"], 1.0))
    slopes = fault["k2_slope"] * true[:, 0] ** 2 + fault["delta_slope"] * true[:, 1]
    ug += (inside - 25.0) * slopes + fault["asymmetry_ug"] * np.abs(true[:, 0])
    ppm = fault["rate_ppm"] * rate + fault["loop_ppm"] * state + fault["k1_kink_ppm"] * knee
    output = sensor.output(inside, site * true, ug, ppm)
    output = _stepped(output, abs(sensor.scale) * 1e-6 * fault["output_step_ug"])
    if fault["saturate_g"]:
        top = abs(sensor.scale) * fault["saturate_g"]
        output = np.clip(output, -top, top)
    shown = temp_c + fault["temp_offset_c"]
    shown = shown + fault["temp_noise_c"] * rng.standard_normal(len(temp_c))
    return Run(time_s, _stepped(shown, fault["temp_step_c"]), head_deg, stated, output)


def _stepped(value: Array, step: float) -> Array:
    return step * np.round(value / step) if step else value
