"""An emulated accelerometer: its true model, its noise, and what it remembers."""

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.constants import T_REF_C
from errormodel.model import ErrorModel
from errormodel.noise.model import NoiseModel
from errormodel.record import Record
from errormodel.terms import Memory
from thermo.library import term
from thermo.recording.signals import Conditions, emulated_columns, signals_of
from thermo.twin.assembly_stress import assembly_stress

# The accelerometer's memory (a loop, a lag) follows its temperature at least this often, read or
# not: no turning point is missed by more than what 30 s can do, and what happens on the way to a
# run and in the rests between runs is in it.
MEMORY_STEP_S = 30.0


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulatedAccelerometer:
    """An accelerometer that is not there: its true model and its noise.

    `values` are in the model's unit (g at the input); `nominal_scale` in output unit per g;
    `turn_on_ug` is the sigma of what each power-on adds to the bias until the next.
    """

    model: ErrorModel
    values: Mapping[str, float]
    nominal_scale: float = 1.3
    white_ug: float = 5.0
    drift_ug: float = 3.0
    drift_tau_s: float = 3600.0
    turn_on_ug: float = 0.0

    @property
    def noise(self) -> NoiseModel:
        """Noise of a reading, g."""
        return NoiseModel(
            white=1e-6 * self.white_ug, drift=1e-6 * self.drift_ug, drift_tau_s=self.drift_tau_s
        )


def emulated_accelerometer(
    serial: str,
    *,
    seed: int = 1,
    nominal_scale: float = 1.3,
    effects: Mapping[str, float] | None = None,
) -> EmulatedAccelerometer:
    """Make an accelerometer of a plausible quartz-flexure type, the same for the same serial.

    The mean is the Huygens HASI XServo (ESA PSA calibration data: scale factor 1.30229 mA/g,
    +80.7 ppm/°C and 0.309 ppm/°C², bias −429 µg, −0.70 µg/°C and −0.0076 µg/°C² at 25 °C); the
    spreads about it are assumed from common data sheets of navigation-grade units.

    Parameters
    ----------
    serial : str
    seed : int
    nominal_scale : float
        Output unit per g.
    effects : mapping, optional
        Further effects by coefficient or parameter name, in the model's unit (g, °C, s); the
        terms they belong to are appended.
    """
    rng = np.random.default_rng([seed, zlib.crc32(serial.encode())])
    micro = 1e-6
    spread = {
        "k1": (1.30229 / 1.3, 0.01),
        "k1_t1": (80.7 * micro, 20 * micro),
        "k1_t2": (0.309 * micro, 0.05 * micro),
        "k0": (-429 * micro, 500 * micro),
        "k0_t1": (-0.70 * micro, 5 * micro),
        "k0_t2": (-0.0076 * micro, 0.03 * micro),
        "k0_t3": (0.0, 0.0002 * micro),
        "k2": (0.0, 15 * micro),
        "delta_o": (0.0, 300 * micro),
    }
    values = {
        name: mean + sigma * float(rng.standard_normal()) for name, (mean, sigma) in spread.items()
    }
    model = ErrorModel(tuple(term(name) for name in spread))
    for name in effects or {}:
        if name not in model.names:
            model = model.with_terms(term(name))
    return EmulatedAccelerometer(
        model=model,
        values={**model.start_values(), **values, **(effects or {})},
        nominal_scale=nominal_scale,
    )


class AccelerometerState:
    """Memory and drift of one accelerometer, moved on with the emulated time."""

    def __init__(self, given: EmulatedAccelerometer, rng: np.random.Generator) -> None:
        self.given = given
        self.rng = rng
        self.memory: dict[str, Memory] = {}
        self.last_s = -np.inf
        self.passed: list[tuple[float, float, float]] = []  # time, temperature, its rate; not read
        self.drift_g = self.turn_on_g = 0.0
        self.restart()

    def restart(self) -> None:
        """Draw a new drift and a new offset, as after power-on."""
        self.drift_g = self.given.noise.drift * float(self.rng.standard_normal())
        if self.given.turn_on_ug:
            self.turn_on_g = 1e-6 * self.given.turn_on_ug * float(self.rng.standard_normal())

    def relive(self, time_s: FloatArray, inside_c: FloatArray) -> None:
        """Leave the memory as this past leaves it."""
        none = np.zeros(time_s.size)
        record = conditions_record(time_s, inside_c, none, angle_rad=np.nan, head_deg=0.0)
        _, self.memory = self.given.model.design(record, self.given.values, self.memory)
        self.passed.clear()

    def pass_by(self, now_s: float, inside_c: float, rate: float) -> None:
        """Be at a temperature without being read."""
        before_s = self.passed[-1][0] if self.passed else self.last_s
        if now_s - before_s >= MEMORY_STEP_S:
            self.passed.append((now_s, inside_c, rate))

    def output_g(
        self, now_s: float, inside_c: float, rate: float, angle_rad: float, head_deg: float
    ) -> float:
        """Return the output over the nominal scale, g, noise of the meter apart."""
        now_s = max(now_s, self.last_s + 1e-6)  # a second question at the same instant
        path = [p for p in self.passed if p[0] < now_s] + [(now_s, inside_c, rate)]
        time_s, temp_c, rates = np.array(path).T
        record = conditions_record(time_s, temp_c, rates, angle_rad=angle_rad, head_deg=head_deg)
        output, self.memory = self.given.model.continue_simulation(
            record, self.given.values, self.memory
        )
        keep, sigma = self.given.noise.drift_step(now_s - self.last_s)
        self.drift_g = keep * self.drift_g + sigma * float(self.rng.standard_normal())
        self.last_s = now_s
        self.passed.clear()
        white_g = self.given.noise.white * float(self.rng.standard_normal())
        return float(output[-1]) + self.drift_g + self.turn_on_g + white_g


def conditions_record(
    time_s: FloatArray, temp_c: FloatArray, rates: FloatArray, *, angle_rad: float, head_deg: float
) -> Record:
    """Return what acts on an accelerometer at some temperatures; without force at no angle."""
    full = np.ones(time_s.size)
    still = np.isnan(angle_rad)
    a_i, a_p = (0.0, 0.0) if still else (np.sin(angle_rad), np.cos(angle_rad))
    at = Conditions(
        time_s=time_s,
        run=np.zeros(time_s.size, dtype=np.intp),
        temp_c=temp_c,
        position_deg=head_deg * full,
        force_g=(a_i * full, a_p * full, 0.0 * full),
        elapsed_h=time_s / 3600.0,
        t_ref_c=T_REF_C,
        known_slow=(temp_c, rates),
        known_mounting=0.0,
    )
    return Record(time_s=time_s, signals=signals_of(replace(at, columns=emulated_columns(at))))


def newly_assembled(
    given: EmulatedAccelerometer, serial: str, *, seed: int = 1
) -> EmulatedAccelerometer:
    """Return an accelerometer with the stress its assembly left in it."""
    stress = assembly_stress(serial, seed=seed)
    return replace(
        given,
        model=given.model.with_terms(*stress.terms()),
        values={**given.values, **stress.values()},
    )
