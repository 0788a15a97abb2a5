"""K0 and K1 while the ramp is still running: the recursive filter as an observer of a test."""

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.noise import NoiseModel
from errormodel.recursive import RecursiveFit, start_recursive
from thermo.station_types import Event, Progress
from thermo.store_records import ReadingRow

T_REF_C = 25.0
# Unknowns: the output's scale and bias, each quadratic in (T − 25 °C)/50 °C, and the misalignment.
ORDER = 2
SCALE_C = 50.0
# Wider than any accelerometer: 10 % of scale, 50 mg of bias, 50 mrad, 5 % over temperature.
PRIOR = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
PRIOR_SIGMA = np.array([0.1, 0.05, 0.05, 0.05, 0.05, 0.05, 0.05])
# What a quartz-flexure accelerometer and its meter show together; the batch fit estimates it.
ASSUMED_NOISE = NoiseModel(white=5e-6, drift=3e-6, drift_tau_s=3600.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveValue:
    """K0 and K1 of one accelerometer at the temperature it has now.

    `k1` is relative to the nominal scale factor.
    """

    serial: str
    temp_c: float
    k0_ug: float
    k0_sigma_ug: float
    k1: float
    k1_sigma_ppm: float
    n: int


def live_columns(temp_c: float, position_deg: float) -> FloatArray:
    """Return what the live unknowns are multiplied by in one reading, shape (7,)."""
    powers = ((temp_c - T_REF_C) / SCALE_C) ** np.arange(ORDER + 1)
    angle = np.deg2rad(position_deg)
    return np.concatenate([np.sin(angle) * powers, powers, [np.cos(angle)]])


class LiveEstimate:
    """Follows a test (`thermo.station_types.Observer`) and always has the latest K0 and K1.

    The output is linear in the unknowns (scale and bias as measured), so the filter is exact;
    K0 is the bias over the scale. Flagged readings are left out. Thread-safe.

    Parameters
    ----------
    nominal_scales : mapping of str to float
        Output unit per g, by serial number.
    noise : NoiseModel
    mount_deg : mapping of str to float, optional
        How far accelerometers are mounted turned on the head, °.
    """

    def __init__(
        self,
        nominal_scales: Mapping[str, float],
        noise: NoiseModel = ASSUMED_NOISE,
        mount_deg: Mapping[str, float] | None = None,
    ) -> None:
        self._scales = dict(nominal_scales)
        self._mounts = dict(mount_deg or {})
        self._fits: dict[str, RecursiveFit] = {
            s: start_recursive(noise, PRIOR, PRIOR_SIGMA) for s in self._scales
        }
        self._last_c = dict.fromkeys(self._scales, T_REF_C)
        self._counts = dict.fromkeys(self._scales, 0)
        self._run = 0
        self._lock = threading.Lock()

    def on_reading(self, run: int, rows: Sequence[ReadingRow]) -> None:
        """Take one scan into the estimate."""
        with self._lock:
            if run != self._run:
                self._run = run
                self._fits = {s: f.new_run() for s, f in self._fits.items()}
            for row in rows:
                self._take(row)

    def on_progress(self, progress: Progress) -> None:
        """Nothing to do."""

    def on_event(self, event: Event) -> None:
        """Nothing to do."""

    def fit_of(self, serial: str) -> RecursiveFit:
        """Return the filter of one accelerometer."""
        with self._lock:
            return self._fits[serial]

    def values(self) -> tuple[LiveValue, ...]:
        """Return the present estimate of every accelerometer that has been read."""
        with self._lock:
            return tuple(self._value(s) for s in self._scales if self._counts[s])

    def _take(self, row: ReadingRow) -> None:
        given = (row.temp_c, row.position_deg, row.output)
        if row.flag or row.serial not in self._scales or any(v is None for v in given):
            return
        temp_c, position_deg, output = (float(v) for v in given if v is not None)
        fit = self._fits[row.serial]
        if not np.isfinite(temp_c + position_deg + output):
            return
        if fit.time_s is not None and row.time_s <= fit.time_s:
            return
        columns = live_columns(temp_c, position_deg + self._mounts.get(row.serial, 0.0))
        self._fits[row.serial], _ = fit.step(row.time_s, columns, output / self._scales[row.serial])
        self._last_c[row.serial] = temp_c
        self._counts[row.serial] += 1

    def _value(self, serial: str) -> LiveValue:
        fit, temp_c = self._fits[serial], self._last_c[serial]
        powers = ((temp_c - T_REF_C) / SCALE_C) ** np.arange(ORDER + 1)
        scale_row = np.concatenate([powers, 0.0 * powers, [0.0]])
        bias_row = np.concatenate([0.0 * powers, powers, [0.0]])
        k1, bias = float(scale_row @ fit.values), float(bias_row @ fit.values)
        k0_row = (bias_row - bias / k1 * scale_row) / k1
        cov = fit.cov
        return LiveValue(
            serial=serial,
            temp_c=temp_c,
            k0_ug=1e6 * bias / k1,
            k0_sigma_ug=1e6 * float(np.sqrt(k0_row @ cov @ k0_row)),
            k1=k1,
            k1_sigma_ppm=1e6 * float(np.sqrt(scale_row @ cov @ scale_row)),
            n=self._counts[serial],
        )
