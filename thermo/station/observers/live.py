"""Live estimates of K0 and K1: recursive filters as an observer of a test.

The parameters are those of terms of the library. An effect outside these terms (a loop, a lag)
changes slowly and resembles drift. The size of the drift is therefore not assumed: filters with
little and with much drift run in parallel, weighted by their predictions of the readings (multiple
models;
Magill 1965, IEEE Trans. Autom. Control 10, 434).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.filter.kalman import Innovation
from errormodel.filter.recursive import RecursiveFit, start_recursive
from errormodel.noise.model import NoiseModel
from thermo.planning.foresight import ASSUMED_NOISE
from thermo.station.observers.live_model import LIVE_TERMS, LiveModel, LiveReading
from thermo.station.outcome import Event, Progress
from thermo.store.records import ReadingRow

MORE_DRIFT = (1.0, 3.0, 10.0)  # times that assumed


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveValue:
    """K0 and K1 of one accelerometer at the temperature it has now, and at `t_ref_c`.

    `k1` is relative to the nominal scale factor. The values at `t_ref_c` (`…_ref…`) can be
    compared over a test; until the temperature has been reached they are extrapolated, and so are
    their sigmas.
    """

    serial: str
    temp_c: float
    k0_ug: float
    k0_sigma_ug: float
    k1: float
    k1_sigma_ppm: float
    t_ref_c: float
    k0_ref_ug: float
    k0_ref_sigma_ug: float
    k1_ref: float
    k1_ref_sigma_ppm: float
    n: int


@dataclass(frozen=True, slots=True, eq=False)
class _Bank:
    """Filters that differ in their drift, and the logarithm of each one's likelihood."""

    fits: tuple[RecursiveFit, ...]
    log_like: FloatArray

    @property
    def shares(self) -> FloatArray:
        """Probability of each."""
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
    """One accelerometer's filters, its last reading and the number of its readings."""

    bank: _Bank
    model: LiveModel
    last: LiveReading | None = None
    n: int = 0


class LiveEstimate:
    """Observer (`thermo.station.outcome.Observer`) with the latest K0 and K1."""

    def __init__(
        self,
        nominal_scales: Mapping[str, float],
        noise: NoiseModel = ASSUMED_NOISE,
        mount_deg: Mapping[str, float] | None = None,
        *,
        terms: Sequence[str] = LIVE_TERMS,
        start: Mapping[str, float] | None = None,
        t_ref_c: float = 25.0,
    ) -> None:
        self._scales = dict(nominal_scales)
        self._mounts = dict(mount_deg or {})
        model = LiveModel.of(terms, start=start or {}, t_ref_c=t_ref_c)
        noises = [replace(noise, drift=factor * noise.drift) for factor in MORE_DRIFT]
        fits = tuple(start_recursive(n, model.prior, np.ones(model.prior.size)) for n in noises)
        fresh = _Bank(fits, np.zeros(len(fits)))
        _compile(fresh, model)
        # replaced as a whole after each scan, so a reader gets consistent values without a lock
        self._state: Mapping[str, _Follower] = {
            s: _Follower(bank=fresh, model=model) for s in self._scales
        }
        self._run = 0

    def on_reading(self, run: int, rows: Sequence[ReadingRow]) -> None:
        """Take one scan into the estimate."""
        state = dict(self._state)
        if run != self._run:
            self._run = run
            state = {
                s: replace(f, bank=f.bank.new_run(), model=f.model.new_run())
                for s, f in state.items()
            }
        for row in rows:
            if row.serial in state:
                state[row.serial] = self._followed(state[row.serial], row)
        self._state = state

    def on_progress(self, progress: Progress) -> None:
        """Nothing to do."""

    def on_event(self, event: Event) -> None:
        """Nothing to do."""

    def fit_of(self, serial: str) -> RecursiveFit:
        """Return the likeliest filter of one accelerometer, in units of prior sigmas."""
        bank = self._state[serial].bank
        return bank.fits[int(np.argmax(bank.log_like))]

    def values(self) -> tuple[LiveValue, ...]:
        """Return the present estimate of every accelerometer that has been read."""
        return tuple(_value(s, f, f.last) for s, f in self._state.items() if f.last is not None)

    def parameters(self, serial: str) -> dict[str, tuple[float, float]]:
        """Return the likeliest filter's coefficients and sigmas by name, in the model's unit."""
        fit, follower = self.fit_of(serial), self._state[serial]
        return follower.model.parameters(fit.values, fit.cov)

    def _followed(self, follower: _Follower, row: ReadingRow) -> _Follower:
        reading = LiveReading.of(row, self._mounts.get(row.serial, 0.0))
        last_s = follower.bank.fits[0].time_s
        if reading is None or row.output is None or not np.isfinite(row.output):
            return follower
        if not follower.model.knows(reading) or (last_s is not None and row.time_s <= last_s):
            return follower
        columns, model = follower.model.step(reading)
        bank = follower.bank.step(row.time_s, columns, row.output / self._scales[row.serial])
        return _Follower(bank=bank, model=model, last=reading, n=follower.n + 1)


def _compile(bank: _Bank, model: LiveModel) -> None:
    """Run every step of the filter once, because it is compiled at the first call."""
    for time_s in (0.0, 1.0, 2.0):
        columns, model = model.step(model.trial(time_s))
        bank = bank.step(time_s, columns, 0.0)
    bank.new_run().step(0.0, columns, 0.0)


def _value(serial: str, follower: _Follower, last: LiveReading) -> LiveValue:
    """Return the mean of the filters, with the variance within and between them."""
    bank, model = follower.bank, follower.model
    mean, sigma = _mixed(bank, model.k0_k1_rows(last))
    at_ref, ref_sigma = _mixed(bank, model.k0_k1_rows(replace(last, temp_c=model.t_ref_c)))
    return LiveValue(
        serial=serial,
        temp_c=last.temp_c,
        k0_ug=1e6 * float(mean[0]),
        k0_sigma_ug=1e6 * float(sigma[0]),
        k1=float(mean[1]),
        k1_sigma_ppm=1e6 * float(sigma[1]),
        t_ref_c=model.t_ref_c,
        k0_ref_ug=1e6 * float(at_ref[0]),
        k0_ref_sigma_ug=1e6 * float(ref_sigma[0]),
        k1_ref=float(at_ref[1]),
        k1_ref_sigma_ppm=1e6 * float(ref_sigma[1]),
        n=follower.n,
    )


def _mixed(bank: _Bank, rows: tuple[FloatArray, FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Return K0 and K1 over all filters, and their sigmas, each (2,), by rows of bias and scale."""
    found = np.array([_k0_k1(fit, *rows) for fit in bank.fits])
    values, variances = found[:, :2], found[:, 2:]
    mean = np.asarray(bank.shares @ values)
    return mean, np.sqrt(bank.shares @ (variances + (values - mean) ** 2))


def _k0_k1(fit: RecursiveFit, bias_row: FloatArray, scale_row: FloatArray) -> FloatArray:
    """Return K0 and K1 at a temperature, and their variances, shape (4,)."""
    k1, bias = float(scale_row @ fit.values), float(bias_row @ fit.values)
    k0_row = (bias_row - bias / k1 * scale_row) / k1
    return np.array(
        [bias / k1, k1, k0_row @ fit.cov @ k0_row, scale_row @ fit.cov @ scale_row], dtype=float
    )
