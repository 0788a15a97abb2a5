"""The physical twin: what emulated instruments measure.

Chamber air follows the controller's set point, the accelerometer's case follows the air and its
inside (where the thermistor sits) the case; the head's true angle differs from its encoder's; the
output is that of an `ErrorModel`, the same object that fits. Air, case and inside are first-order
lags; the air's rate is limited by the power of heater and compressor.
"""

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import ArrayLike

from drivers.digitisers.thermistor import ohm_from_temp_c
from drivers.station import InputConfig, StationConfig
from errormodel.arrays import FloatArray
from thermo.twin.accelerometer import (
    MEMORY_STEP_S,
    AccelerometerState,
    EmulatedAccelerometer,
    conditions_record,
    emulated_accelerometer,
    newly_assembled,
)
from thermo.uncertainty.head_accuracy import ARCSEC


@dataclass(frozen=True, slots=True, kw_only=True)
class TwinSettings:
    """The rest of the physics; assumed values of a bench chamber and a good head."""

    start_c: float = 25.0
    air_tau_s: float = 60.0
    case_tau_s: float = 180.0
    inside_tau_s: float = 60.0
    max_rate_c_per_min: float = 6.0
    thermistor_noise_c: float = 0.002
    head_offset_arcsec: float = 1.0
    head_harmonic_arcsec: float = 0.2
    remount_arcsec: float = 20.0  # sigma of the angle at which a turned mounting is missed


@numba.njit(cache=True)
def _warm(
    state: FloatArray,
    duration_s: float,
    setpoint: FloatArray,
    taus: FloatArray,
    max_rate: float,
    runaway: float,
) -> float:
    """Move [air, case…, inside…] on in place; `setpoint` is [now, target, rate per s]."""
    m = (state.size - 1) // 2
    sp, target, rate = setpoint
    left = duration_s
    while left > 1e-9:
        step = min(1.0, left)
        left -= step
        if sp < target:
            sp = min(target, sp + rate * step)
        elif sp > target:
            sp = max(target, sp - rate * step)
        if np.isnan(runaway):
            slope = (sp - state[0]) * (1.0 - np.exp(-step / taus[0])) / step
            slope = min(max(slope, -max_rate), max_rate)
        else:
            slope = runaway
        state[0] += slope * step
        follow_case, follow_inside = 1.0 - np.exp(-step / taus[1]), 1.0 - np.exp(-step / taus[2])
        for i in range(m):
            state[1 + i] += (state[0] - state[1 + i]) * follow_case
            state[1 + m + i] += (state[1 + i] - state[1 + m + i]) * follow_inside
    return sp


class Twin:
    """A station's physics, for the emulated instruments to ask (`drivers.emulators.plant.Plant`).

    Parameters
    ----------
    inputs : sequence of InputConfig
        How the accelerometers are wired.
    accelerometers : mapping of str to EmulatedAccelerometer
        By serial number; one for each input.
    settings : TwinSettings
    seed : int
        Of all noise.
    mount_deg : mapping, optional
        How far accelerometers are mounted turned on the head, °, by serial number.
    signals : mapping, optional
        Digitiser channels of recorded signals, by the signal's name.

    Raises
    ------
    ValueError
        If an input has no accelerometer.
    """

    def __init__(
        self,
        inputs: Sequence[InputConfig],
        accelerometers: Mapping[str, EmulatedAccelerometer],
        settings: TwinSettings | None = None,
        seed: int = 1,
        mount_deg: Mapping[str, float] | None = None,
        signals: Mapping[str, int] | None = None,
    ) -> None:
        missing = [i.serial for i in inputs if i.serial not in accelerometers]
        if missing:
            raise ValueError(f"no emulated accelerometer for {', '.join(missing)}")
        self._set = settings or TwinSettings()
        seeds = np.random.SeedSequence(seed).spawn(len(inputs) + 1)
        self._rng = np.random.default_rng(seeds[0])
        self._units = [
            AccelerometerState(accelerometers[i.serial], np.random.default_rng(s))
            for i, s in zip(inputs, seeds[1:], strict=True)
        ]
        turned = [(mount_deg or {}).get(i.serial, 0.0) for i in inputs]
        self._mount_rad = [
            np.deg2rad(m)
            + (ARCSEC * self._set.remount_arcsec * self._rng.standard_normal() if m else 0.0)
            for m in turned
        ]
        self._outputs = {i.output_channel: (k, i) for k, i in enumerate(inputs)}
        self._thermistors = {i.thermistor_channel: (k, i) for k, i in enumerate(inputs)}
        self._signals = {channel: name for name, channel in (signals or {}).items()}
        self._taus = np.array([self._set.air_tau_s, self._set.case_tau_s, self._set.inside_tau_s])
        self._state = np.full(1 + 2 * len(inputs), self._set.start_c)
        self._setpoint = np.array([self._set.start_c, self._set.start_c, np.inf])
        self._runaway = np.nan
        self._now_s: float | None = None
        self._move = (0.0, 0.0, 0.0, 1.0)  # started at, from, to, ° and °/s
        self._lock = threading.RLock()

    def drive_chamber(
        self, now_s: float, start_c: float, target_c: float, rate_c_per_s: float
    ) -> None:
        """Take over a set point that moves uniformly from `start_c` to `target_c`."""
        with self._lock:
            self._advance(now_s)
            self._setpoint = np.array([start_c, target_c, rate_c_per_s])

    def break_away(self, now_s: float, rate_c_per_s: float | None) -> None:
        """Let the air run away at a rate; None: back to the set point."""
        with self._lock:
            self._advance(now_s)
            self._runaway = np.nan if rate_c_per_s is None else rate_c_per_s

    def air_temp_c(self, now_s: float) -> float:
        """Return the temperature at the controller's sensor, °C."""
        with self._lock:
            self._advance(now_s)
            return float(self._state[0])

    def inside_temp_c(self, now_s: float, index: int) -> float:
        """Return the true temperature inside an accelerometer, °C."""
        with self._lock:
            self._advance(now_s)
            return float(self._state[1 + len(self._units) + index])

    def power_cycle(self, now_s: float) -> None:
        """Switch the accelerometers off and on: their drift starts anew, a thermal loop stays."""
        with self._lock:
            self._advance(now_s)
            for unit in self._units:
                unit.restart()

    def relive(self, serial: str, time_s: ArrayLike, inside_c: ArrayLike) -> None:
        """Give an accelerometer a past, before its first reading.

        Parameters
        ----------
        serial : str
        time_s, inside_c : array_like, shape (n,)
            The temperatures it has been through, °C, in increasing time, s.
        """
        with self._lock:
            k = next(k for k, wired in self._outputs.values() if wired.serial == serial)
            self._units[k].relive(np.asarray(time_s, float), np.asarray(inside_c, float))

    def turn_head(self, now_s: float, target_deg: float, speed_deg_per_s: float) -> None:
        """Start turning from wherever the head is."""
        with self._lock:
            self._move = (now_s, self.head_deg(now_s), target_deg, speed_deg_per_s)

    def stop_head(self, now_s: float) -> None:
        """Stop the head where it is."""
        with self._lock:
            here = self.head_deg(now_s)
            self._move = (now_s, here, here, 1.0)

    def head_deg(self, now_s: float) -> float:
        """Return the angle by the encoder, °."""
        with self._lock:
            begun_s, start, target, speed = self._move
            turned = min(max(now_s - begun_s, 0.0) * speed, abs(target - start))
            return start + turned * (1.0 if target >= start else -1.0)

    def head_is_moving(self, now_s: float) -> bool:
        """Tell whether the head turns."""
        with self._lock:
            return abs(self.head_deg(now_s) - self._move[2]) > 1e-9

    def channel_value(self, now_s: float, channel: int) -> float:
        """Return what the digitiser measures: V or ohm; 0 on a channel with nothing wired."""
        with self._lock:
            self._advance(now_s)
            if channel in self._thermistors:
                k, wired = self._thermistors[channel]
                noise_c = self._set.thermistor_noise_c * float(self._rng.standard_normal())
                return float(ohm_from_temp_c(self._inside(k) + noise_c, wired.thermistor))
            if channel in self._outputs:
                k, wired = self._outputs[channel]
                output = self._units[k].output_g(
                    now_s,
                    self._inside(k),
                    self._rate(k),
                    self._true_angle_rad(now_s) + float(self._mount_rad[k]),
                    self.head_deg(now_s),
                )
                volts_per_unit = wired.load_ohm / 1000.0 if wired.output_unit == "mA" else 1.0
                return output * self._units[k].given.nominal_scale * volts_per_unit
            if channel in self._signals:
                return self._signal(now_s, self._signals[channel])
            return 0.0

    def _signal(self, now_s: float, name: str) -> float:
        """Return a signal of the whole station as the air makes it; 0 where it is not known."""
        air_c, now = self._state[:1].copy(), np.array([now_s])
        record = conditions_record(
            now, air_c, np.zeros(1), angle_rad=np.nan, head_deg=self.head_deg(now_s)
        )
        known = record.signals.get(name)
        return 0.0 if known is None else float(known[0])

    def _inside(self, index: int) -> float:
        return float(self._state[1 + len(self._units) + index])

    def _rate(self, index: int) -> float:
        case_c = self._state[1 + index]
        return float((case_c - self._inside(index)) / self._taus[2] * 60.0)

    def _true_angle_rad(self, now_s: float) -> float:
        angle = np.deg2rad(self.head_deg(now_s))
        error = self._set.head_offset_arcsec + self._set.head_harmonic_arcsec * np.sin(2 * angle)
        return float(angle + error * ARCSEC)

    def _advance(self, now_s: float) -> None:
        if self._now_s is None:
            self._now_s = now_s
        while self._now_s < now_s:
            step_s = min(now_s - self._now_s, MEMORY_STEP_S)
            self._setpoint[0] = _warm(
                self._state,
                step_s,
                self._setpoint,
                self._taus,
                self._set.max_rate_c_per_min / 60.0,
                self._runaway,
            )
            self._now_s = now_s if step_s < MEMORY_STEP_S else self._now_s + step_s
            for k, unit in enumerate(self._units):
                unit.pass_by(self._now_s, self._inside(k), self._rate(k))


def make_plant(
    station: StationConfig,
    *,
    nominal_scales: Mapping[str, float] | None = None,
    effects: Mapping[str, Mapping[str, float]] | None = None,
    settings: TwinSettings | None = None,
    new_from_assembly: bool = False,
    mount_deg: Mapping[str, float] | None = None,
    seed: int = 1,
) -> Twin:
    """Make the physics of a station file.

    Parameters
    ----------
    station : StationConfig
    nominal_scales : mapping, optional
        Output unit per g by serial number; 1.3 where not given.
    effects : mapping, optional
        Hidden effects by serial number, as `emulated_accelerometer` takes them.
    settings : TwinSettings, optional
    new_from_assembly : bool
        Whether the accelerometers still have the stress of their assembly (`run_in_state`).
    mount_deg : mapping, optional
        How far they are mounted turned on the head, °, by serial number.
    seed : int
    """
    scales, hidden = nominal_scales or {}, effects or {}
    made = {
        i.serial: emulated_accelerometer(
            i.serial,
            seed=seed,
            nominal_scale=scales.get(i.serial, 1.3),
            effects=hidden.get(i.serial),
        )
        for i in station.inputs
    }
    if new_from_assembly:
        made = {s: newly_assembled(one, s, seed=seed) for s, one in made.items()}
    return Twin(station.inputs, made, settings, seed, mount_deg, station.signal_channels)
