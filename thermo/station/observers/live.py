"""K0 and K1 while the ramp is still running: recursive filters as an observer of a test.

The unknowns are the terms that the fit of the night finds in almost every accelerometer. What they
do not hold (a loop, a lag, a term more) moves slowly and passes for drift, so how much drift there
is is not assumed: filters with little and with much of it run side by side, weighed by how well
each has predicted the readings (multiple models; Magill 1965, IEEE Trans. Autom. Control 10, 434).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.filter.kalman import Innovation
from errormodel.filter.recursive import RecursiveFit, start_recursive
from errormodel.noise.drift import NoiseModel
from thermo.planning.foresight import ASSUMED_NOISE
from thermo.station.outcome import Event, Progress
from thermo.store.records import ReadingRow

T_REF_C = 25.0
# Unknowns: the output's scale and bias, quadratic and cubic in (T − 25 °C)/50 °C, the misalignment,
# and what is proportional to a_i² and a_i·a_p.
SCALE_ORDER, BIAS_ORDER = 2, 3
SCALE_C = 50.0
# Wider than any accelerometer: 10 % of scale, 50 mg of bias, 50 mrad, 5 % over temperature, and
# 1 mg/g² of K2 and K_ip.
PRIOR = np.array([1.0] + [0.0] * 9)
PRIOR_SIGMA = np.array([0.1, 0.05, 0.05, 0.05, 0.05, 0.05, 0.05, 0.05, 1e-3, 1e-3])
MORE_DRIFT = (1.0, 3.0, 10.0)  # times that assumed


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveValue:
    """K0 and K1 of one accelerometer at the temperature it has now, and at `T_REF_C`.

    `k1` is relative to the nominal scale factor. The values at `T_REF_C` (`…_ref…`) can be
    compared over a test; as long as it has not been there they are extrapolated, and so are their
    sigmas.
    """

    serial: str
    temp_c: float
    k0_ug: float
    k0_sigma_ug: float
    k1: float
    k1_sigma_ppm: float
    k0_ref_ug: float
    k0_ref_sigma_ug: float
    k1_ref: float
    k1_ref_sigma_ppm: float
    n: int


def live_columns(temp_c: float, position_deg: float) -> FloatArray:
    """Return what the live unknowns are multiplied by in one reading, shape (10,)."""
    x = (temp_c - T_REF_C) / SCALE_C
    a_i, a_p = np.sin(np.deg2rad(position_deg)), np.cos(np.deg2rad(position_deg))
    scale, bias = x ** np.arange(SCALE_ORDER + 1), x ** np.arange(BIAS_ORDER + 1)
    return np.concatenate([a_i * scale, bias, [a_p, a_i**2, a_i * a_p]])


@dataclass(frozen=True, slots=True, eq=False)
class _Bank:
    """Filters that differ in their drift, and the logarithm of each one's likelihood."""

    fits: tuple[RecursiveFit, ...]
    log_like: FloatArray

    @property
    def shares(self) -> FloatArray:
        """How likely each is."""
        share = np.exp(self.log_like - self.log_like.max())
        return np.asarray(share / share.sum())

    def new_run(self) -> "_Bank":
        return _Bank(tuple(f.new_run() for f in self.fits), self.log_like)

    def step(self, time_s: float, columns: FloatArray, reading: float) -> "_Bank":
        done = [f.step(time_s, columns, reading) for f in self.fits]
        gained = np.array([_log_like(i) for _, i in done])
        return _Bank(tuple(f for f, _ in done), self.log_like + gained)


def _log_like(one: Innovation) -> float:
    return -0.5 * (one.nis + float(np.log(one.variance)))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Follower:
    """One accelerometer's filters, its last temperature and the number of its readings."""

    bank: _Bank
    temp_c: float = T_REF_C
    n: int = 0


class LiveEstimate:
    """Follows a test (`thermo.station.outcome.Observer`) and always has the latest K0 and K1.

    The output is linear in the unknowns (scale and bias as measured), so the filters are exact;
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
        noises = [replace(noise, drift=factor * noise.drift) for factor in MORE_DRIFT]
        fits = tuple(start_recursive(n, PRIOR, PRIOR_SIGMA) for n in noises)
        fresh = _Bank(fits, np.zeros(len(fits)))
        _compile(fresh)
        # replaced as a whole after each scan, so that a reader has one moment's and needs no lock
        self._state: Mapping[str, _Follower] = {s: _Follower(bank=fresh) for s in self._scales}
        self._run = 0

    def on_reading(self, run: int, rows: Sequence[ReadingRow]) -> None:
        """Take one scan into the estimate."""
        state = dict(self._state)
        if run != self._run:
            self._run = run
            state = {s: replace(f, bank=f.bank.new_run()) for s, f in state.items()}
        for row in rows:
            if row.serial in state:
                state[row.serial] = self._followed(state[row.serial], row)
        self._state = state

    def on_progress(self, progress: Progress) -> None:
        """Nothing to do."""

    def on_event(self, event: Event) -> None:
        """Nothing to do."""

    def fit_of(self, serial: str) -> RecursiveFit:
        """Return the likeliest filter of one accelerometer."""
        bank = self._state[serial].bank
        return bank.fits[int(np.argmax(bank.log_like))]

    def values(self) -> tuple[LiveValue, ...]:
        """Return the present estimate of every accelerometer that has been read."""
        return tuple(_value(s, f) for s, f in self._state.items() if f.n)

    def _followed(self, follower: _Follower, row: ReadingRow) -> _Follower:
        given = (row.temp_c, row.position_deg, row.output)
        if row.flag or any(v is None for v in given):
            return follower
        temp_c, position_deg, output = (float(v) for v in given if v is not None)
        last_s = follower.bank.fits[0].time_s
        if not np.isfinite(temp_c + position_deg + output):
            return follower
        if last_s is not None and row.time_s <= last_s:
            return follower
        columns = live_columns(temp_c, position_deg + self._mounts.get(row.serial, 0.0))
        bank = follower.bank.step(row.time_s, columns, output / self._scales[row.serial])
        return _Follower(bank=bank, temp_c=temp_c, n=follower.n + 1)


def _compile(bank: _Bank) -> None:
    """Go through every step of the filter once: compiling takes seconds where it was never run."""
    columns = live_columns(T_REF_C, 0.0)
    for time_s in (0.0, 1.0):
        bank = bank.step(time_s, columns, 0.0)
    bank.new_run().step(0.0, columns, 0.0)


def _value(serial: str, follower: _Follower) -> LiveValue:
    """Return the mean of the filters, with the variance within and between them."""
    bank, temp_c = follower.bank, follower.temp_c
    mean, sigma = _mixed(bank, temp_c)
    at_ref, ref_sigma = _mixed(bank, T_REF_C)
    return LiveValue(
        serial=serial,
        temp_c=temp_c,
        k0_ug=1e6 * float(mean[0]),
        k0_sigma_ug=1e6 * float(sigma[0]),
        k1=float(mean[1]),
        k1_sigma_ppm=1e6 * float(sigma[1]),
        k0_ref_ug=1e6 * float(at_ref[0]),
        k0_ref_sigma_ug=1e6 * float(ref_sigma[0]),
        k1_ref=float(at_ref[1]),
        k1_ref_sigma_ppm=1e6 * float(ref_sigma[1]),
        n=follower.n,
    )


def _mixed(bank: _Bank, temp_c: float) -> tuple[FloatArray, FloatArray]:
    """Return K0 and K1 at a temperature over all filters, and their sigmas, each (2,)."""
    found = np.array([_k0_k1(fit, temp_c) for fit in bank.fits])
    values, variances = found[:, :2], found[:, 2:]
    mean = np.asarray(bank.shares @ values)
    return mean, np.sqrt(bank.shares @ (variances + (values - mean) ** 2))


def _k0_k1(fit: RecursiveFit, temp_c: float) -> FloatArray:
    """Return K0 and K1 at a temperature, and their variances, shape (4,)."""
    x = (temp_c - T_REF_C) / SCALE_C
    scale_row, bias_row = np.zeros(PRIOR.size), np.zeros(PRIOR.size)
    scale_row[: SCALE_ORDER + 1] = x ** np.arange(SCALE_ORDER + 1)
    bias_row[SCALE_ORDER + 1 : SCALE_ORDER + BIAS_ORDER + 2] = x ** np.arange(BIAS_ORDER + 1)
    k1, bias = float(scale_row @ fit.values), float(bias_row @ fit.values)
    k0_row = (bias_row - bias / k1 * scale_row) / k1
    return np.array(
        [bias / k1, k1, k0_row @ fit.cov @ k0_row, scale_row @ fit.cov @ scale_row], dtype=float
    )
