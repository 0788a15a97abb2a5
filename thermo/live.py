"""K0 and K1 while the ramp is still running: the recursive filter as an observer of a test."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

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


@dataclass(frozen=True, slots=True, kw_only=True)
class _Follower:
    """One accelerometer's filter, its last temperature and the number of its readings."""

    fit: RecursiveFit
    temp_c: float = T_REF_C
    n: int = 0


def live_columns(temp_c: float, position_deg: float) -> FloatArray:
    """Return what the live unknowns are multiplied by in one reading, shape (7,)."""
    powers = ((temp_c - T_REF_C) / SCALE_C) ** np.arange(ORDER + 1)
    angle = np.deg2rad(position_deg)
    return np.concatenate([np.sin(angle) * powers, powers, [np.cos(angle)]])


class LiveEstimate:
    """Follows a test (`thermo.station_types.Observer`) and always has the latest K0 and K1.

    The output is linear in the unknowns (scale and bias as measured), so the filter is exact;
    K0 is the bias over the scale. Flagged readings are left out. Another thread may ask for the
    values at any time; neither ever waits for the other, and what is slow at its first use is
    done when this is made: it stands in the control loop.

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
        fresh = start_recursive(noise, PRIOR, PRIOR_SIGMA)
        _compile(fresh)
        # replaced as a whole after each scan, so that a reader has one moment's and needs no lock
        self._state: Mapping[str, _Follower] = {s: _Follower(fit=fresh) for s in self._scales}
        self._run = 0

    def on_reading(self, run: int, rows: Sequence[ReadingRow]) -> None:
        """Take one scan into the estimate."""
        state = dict(self._state)
        if run != self._run:
            self._run = run
            state = {s: replace(f, fit=f.fit.new_run()) for s, f in state.items()}
        for row in rows:
            if row.serial in state:
                state[row.serial] = self._followed(state[row.serial], row)
        self._state = state

    def on_progress(self, progress: Progress) -> None:
        """Nothing to do."""

    def on_event(self, event: Event) -> None:
        """Nothing to do."""

    def fit_of(self, serial: str) -> RecursiveFit:
        """Return the filter of one accelerometer."""
        return self._state[serial].fit

    def values(self) -> tuple[LiveValue, ...]:
        """Return the present estimate of every accelerometer that has been read."""
        return tuple(_value(s, f) for s, f in self._state.items() if f.n)

    def _followed(self, follower: "_Follower", row: ReadingRow) -> "_Follower":
        given = (row.temp_c, row.position_deg, row.output)
        if row.flag or any(v is None for v in given):
            return follower
        temp_c, position_deg, output = (float(v) for v in given if v is not None)
        fit = follower.fit
        if not np.isfinite(temp_c + position_deg + output):
            return follower
        if fit.time_s is not None and row.time_s <= fit.time_s:
            return follower
        columns = live_columns(temp_c, position_deg + self._mounts.get(row.serial, 0.0))
        fit, _ = fit.step(row.time_s, columns, output / self._scales[row.serial])
        return _Follower(fit=fit, temp_c=temp_c, n=follower.n + 1)


def _compile(fit: RecursiveFit) -> None:
    """Go through every step of the filter once: compiling takes seconds where it was never run."""
    columns = live_columns(T_REF_C, 0.0)
    for time_s in (0.0, 1.0):
        fit, _ = fit.step(time_s, columns, 0.0)
    fit.new_run().step(0.0, columns, 0.0)


def _value(serial: str, follower: "_Follower") -> LiveValue:
    fit, temp_c = follower.fit, follower.temp_c
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
        n=follower.n,
    )
