"""Consistency of a calibration: its innovations against the sigmas it gives.

Processed one scalar at a time, the normalised innovations of a filter whose model and noise are
right are independent and of unit sigma. So their mean square (NIS) has a χ² interval, they are
white, and the sums over long stretches are no larger than chance lets them. The rows of the rig's
axis across itself are judged apart: the wobble assumed for them is a bound, not a noise.

References
----------
Bar-Shalom, Y., Li, X. R. and Kirubarajan, T. (2001), Estimation with Applications to Tracking and
Navigation, sec. 5.4, for NIS and the whiteness of innovations.
Ljung, G. M. and Box, G. E. P. (1978), On a measure of lack of fit in time series models,
Biometrika 65.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from errormodel.arrays import FloatArray, IntArray
from errormodel.filter.steps import Filtered
from sinscal.calibration.effect_tests import EffectTests
from sinscal.calibration.hold_out import HoldOut, Shift

FORCES = ("force_e", "force_n", "force_u")
ALONG, ACROSS = "rig_angle", ("rig_axis_1", "rig_axis_2")
# A calibration of right models fails each of its six tests (NIS, whiteness, slow drift, bound,
# hold-out, prior) so seldom; all together at most six times as often, and five times more by the
# tests of missing effects.
FALSE_ALARM = 1e-3
LAGS = 20
SLOW_INTERVALS = 50  # whose sum shows drift


@dataclass(frozen=True, slots=True, kw_only=True)
class Nis:
    """Mean of normalised innovations squared, and where it lies when all is right."""

    mean: float
    interval: tuple[float, float]
    n: int

    @property
    def passed(self) -> bool:
        """True when the mean lies inside."""
        return self.interval[0] <= self.mean <= self.interval[1]


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelConsistency:
    """One row of measurements: its NIS, and the p-values of whiteness and of slow drift."""

    name: str
    nis: Nis
    white_p: float
    slow_p: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Refused:
    """A measurement beyond the gate: where, when (from the cycle's start), how many sigmas."""

    cycle: int
    time_s: float
    channel: str
    sigmas: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Consistency:
    """The verdict and what it rests on.

    Attributes
    ----------
    nis : Nis
        Over forces and the rig's angle along its axis.
    channels : tuple of ChannelConsistency
    bounded : Nis, optional
        Of the rows whose assumed noise is a bound (the rig's axis across itself; positions): at
        most the upper end of its interval when it is.
    held_out : tuple of HoldOut
        One for each cycle held out.
    prior : Shift
        Of the estimates from what was expected beforehand: errors larger than the prior allows
        spoil NIS and the cycle held out as well.
    noise_known : bool
        False when the noise was taken from the same data: then NIS says nothing.
    converged : bool
    effects : EffectTests, optional
        Of the effects that the model lacks; None where raw sensors were not recorded.
    contradictions : tuple of str
        Names of the warnings by which the run contradicts physics or what is stated beside it.
    """

    nis: Nis
    channels: tuple[ChannelConsistency, ...]
    bounded: Nis | None
    held_out: tuple[HoldOut, ...]
    prior: Shift
    noise_known: bool
    converged: bool
    effects: EffectTests | None = None
    contradictions: tuple[str, ...] = ()

    @property
    def white(self) -> bool:
        """True when no channel's innovations are correlated over lags 1 … 20."""
        return self._least("white_p") >= FALSE_ALARM / len(self.channels)

    @property
    def steady(self) -> bool:
        """True when no channel shows slow drift."""
        return self._least("slow_p") >= FALSE_ALARM / len(self.channels)

    @property
    def within_bound(self) -> bool:
        """True when what was bounded (the wobble of the rig's axis) is within its bound."""
        return self.bounded is None or self.bounded.mean <= self.bounded.interval[1]

    @property
    def repeats(self) -> bool:
        """True when every cycle held out agrees with the others."""
        least = FALSE_ALARM / max(1, len(self.held_out))
        return all(held.shift.p_value >= least for held in self.held_out)

    @property
    def expected(self) -> bool:
        """True when the errors are no larger than was expected beforehand."""
        return self.prior.p_value >= FALSE_ALARM

    @property
    def complete(self) -> bool:
        """True when no effect of the library is missing."""
        return self.effects is None or self.effects.passed

    @property
    def tests(self) -> dict[str, bool | None]:
        """Result of each test by name; None where it was not made."""
        return {
            "converged": self.converged,
            "nis": self.nis.passed if self.noise_known else None,
            "white": self.white,
            "no_slow_drift": self.steady,
            "within_bound": self.within_bound if self.bounded else None,
            "held_out": self.repeats if self.held_out else None,
            "prior": self.expected,
            "complete": self.complete if self.effects else None,
            "no_contradiction": not self.contradictions,
        }

    @property
    def passed(self) -> bool:
        """True when every test is passed."""
        return False not in self.tests.values()

    def _least(self, name: str) -> float:
        return min(float(getattr(c, name)) for c in self.channels)


def nis_of(normalised: FloatArray) -> Nis:
    """Return the mean square of normalised innovations and its interval."""
    n = max(normalised.size, 1)
    lo, hi = (float(chi2.ppf(p, n)) / n for p in (0.5 * FALSE_ALARM, 1.0 - 0.5 * FALSE_ALARM))
    return Nis(
        mean=float(np.sum(normalised**2)) / n,
        interval=(lo, hi),
        n=normalised.size,
    )


def normalised_rows(filtered: Filtered) -> FloatArray:
    """Return normalised innovations, NaN where none was used, shape (K, m)."""
    sigma = np.sqrt(np.where(filtered.used, filtered.variance, 1.0))
    return np.where(filtered.used, filtered.innovation / sigma, np.nan)


def ljung_box(series: Sequence[FloatArray], lags: int = LAGS) -> float:
    """Return the p-value of whiteness of a signal in several stretches, with gaps (NaN).

    Each lag's correlation is over the pairs there are, none across stretches; unit variance is not
    presumed.
    """
    flat = np.concatenate(series)
    power = float(np.nanmean(flat**2)) if np.isfinite(flat).any() else 1.0
    total, dof = 0.0, 0
    for lag in range(1, lags + 1):
        products = np.concatenate(
            [s[lag:] * s[:-lag] for s in series if s.size > lag] or [flat[:0]]
        )
        products = products[np.isfinite(products)]
        if products.size > lags:
            total += float(np.sum(products)) ** 2 / products.size / power**2
            dof += 1
    return float(chi2.sf(total, dof)) if dof else 1.0


def slow_drift(series: Sequence[FloatArray], length: int = SLOW_INTERVALS) -> float:
    """Return the p-value of sums over `length` intervals being no larger than white noise makes.

    One-sided: drift makes them larger.
    """
    flat = np.concatenate(series)
    power = float(np.nanmean(flat**2)) if np.isfinite(flat).any() else 1.0
    total, count = 0.0, 0
    for s in series:
        for first in range(0, s.size - length + 1, length):
            part = s[first : first + length]
            part = part[np.isfinite(part)]
            if part.size > length // 2:
                total += float(np.sum(part)) ** 2 / part.size / power
                count += 1
    return float(chi2.sf(total, count)) if count else 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasurementRows:
    """The rows of a filter's measurements: their names, and which are white when all is right.

    The noise assumed for the others is a bound.
    """

    names: tuple[str, ...]
    white: tuple[int, ...]


def rows_of_rig(count: int) -> MeasurementRows:
    """Return the rows of the rig filter, three (coarse) or six (precise)."""
    names = FORCES if count == 3 else (*FORCES, ALONG, *ACROSS)
    return MeasurementRows(
        names=names, white=tuple(k for k, name in enumerate(names) if name not in ACROSS)
    )


def judge_innovations(
    normalised: FloatArray, cycle_of_step: IntArray, rows: MeasurementRows
) -> tuple[Nis, tuple[ChannelConsistency, ...], Nis | None]:
    """Judge normalised innovations (K, m): all white ones, each of them, and the bounded ones."""
    cycles = [normalised[cycle_of_step == k] for k in range(int(cycle_of_step.max()) + 1)]
    channels: list[ChannelConsistency] = []
    for k in rows.white:
        series = [c[:, k] for c in cycles]
        channels.append(
            ChannelConsistency(
                name=rows.names[k],
                nis=nis_of(_seen(normalised[:, k])),
                white_p=ljung_box(series),
                slow_p=slow_drift(series),
            )
        )
    others = [k for k in range(len(rows.names)) if k not in rows.white]
    bounded = nis_of(_seen(normalised[:, others])) if others else None
    return nis_of(_seen(normalised[:, list(rows.white)])), tuple(channels), bounded


def _seen(values: FloatArray) -> FloatArray:
    return values[np.isfinite(values)]


def refused_of(
    filtered: Filtered, cycle_of_step: IntArray, time_s: FloatArray, rows: MeasurementRows
) -> tuple[Refused, ...]:
    """Return the measurements that the gate refused, in order of time."""
    out = np.isfinite(filtered.innovation) & ~filtered.used
    sigmas = filtered.innovation / np.sqrt(filtered.variance)
    return tuple(
        Refused(
            cycle=int(cycle_of_step[k]),
            time_s=float(time_s[k]),
            channel=rows.names[j],
            sigmas=float(sigmas[k, j]),
        )
        for k, j in np.argwhere(out).tolist()
    )
