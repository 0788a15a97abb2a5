"""The description of noise: white plus slow drift of one family.

Every part of the program describes noise by `NoiseModel`: the fit and the live filter of a chamber
test, the search of missing effects, and the gyros and accelerometers on a rig, in navigation, in a
simulator and in flight. What each makes of it differs: a whitener (`errormodel.noise.whitening`), a
state of a filter, or random numbers.

Slow drift is an Ornstein-Uhlenbeck process (first-order Gauss-Markov): bias instability. A random
walk is one whose correlation time is many times a run and that starts from zero (the level a run
begins at is then an offset of its own, which is an effect with a name). Flicker noise is five of
them of one variance, evenly spaced in the logarithm of the correlation time.
"""

from dataclasses import dataclass, replace
from typing import Literal, TypeVar, cast

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.noise.whitening import BlockWhitener, SlowProcesses, TimeBase, Whitener
from errormodel.record import Record

Steps = TypeVar("Steps", float, FloatArray)
Family = Literal["white", "drift", "walk", "flicker"]

# A walk is a process this many times slower than the longest run, begun from zero.
WALK_SPANS = 50.0
FLICKER_POLES = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseModel:
    """White noise of sigma `white` per sample plus slow drift, correlated in time.

    Parameters
    ----------
    white : float
        Sigma of the part that is new in each sample, in the unit of what is measured; of a sensor
        whose samples differ in length, the sigma of a mean over one second (the square root of the
        density).
    drift : float
        Stationary sigma of the slow part, of flicker noise that of each of its poles; 0 for white
        noise alone.
    drift_tau_s : float
        Correlation time of the slow part, of flicker noise the shortest, s.
    slow : {"drift", "walk", "flicker"}
        Family of the slow part.
    longest_tau_s : float
        Longest correlation time of flicker noise, s.
    continued : bool
        Whether a walk goes on between the runs; otherwise it begins from zero with each.
    """

    white: float = 1.0
    drift: float = 0.0
    drift_tau_s: float = 3600.0
    slow: Literal["drift", "walk", "flicker"] = "drift"
    longest_tau_s: float = 0.0
    continued: bool = False

    @property
    def family(self) -> Family:
        """The slow part's family, "white" where there is none."""
        return self.slow if self.drift > 0.0 else "white"

    @property
    def shape(self) -> "NoiseModel":
        """Noise of the same shape with a white sigma of one."""
        return replace(self, white=1.0, drift=self.drift / self.white)

    def scaled(self, factor: float) -> "NoiseModel":
        """Return the same shape of noise, `factor` times as large."""
        return replace(self, white=self.white * factor, drift=self.drift * factor)

    @property
    def slow_tau_s(self) -> tuple[float, ...]:
        """Correlation time of each slow process, s; none in white noise."""
        if self.family == "white":
            return ()
        if self.family != "flicker":
            return (self.drift_tau_s,)
        return tuple(np.geomspace(self.drift_tau_s, self.longest_tau_s, FLICKER_POLES).tolist())

    @property
    def processes(self) -> SlowProcesses:
        """The slow processes, relative to the white variance."""
        tau_s = np.array(self.slow_tau_s, dtype=float)
        ratio2 = (self.drift / self.white) ** 2 if tau_s.size else 0.0
        return SlowProcesses(
            np.full(tau_s.size, ratio2), tau_s, self.family != "walk", self.continued
        )

    def slow_share(self, span_s: float) -> float:
        """Return the mean square of the slow part over a run of `span_s`, relative to the white.

        A process slower than the run counts with what it moves within the run, from its start:
        the level it starts from is the run's own.
        """
        slow, total = self.processes, 0.0
        for variance, tau_s in zip(slow.variance.tolist(), slow.tau_s.tolist(), strict=True):
            ratio = span_s / tau_s
            kept = (1.0 - np.exp(-ratio)) / ratio
            total += variance * min(1.0, 2.0 * (1.0 - kept))
        return float(total)

    def drift_step(self, step_s: Steps) -> tuple[Steps, Steps]:
        """Return what drift keeps over a step, or steps, and the sigma of what comes to it.

        The state form of a single drift: d(t + step) = keep · d(t) + sigma · w with w of unit
        variance.
        """
        keep = np.exp(-step_s / self.drift_tau_s)
        return cast(Steps, keep), cast(Steps, self.drift * np.sqrt(1.0 - keep * keep))

    def whitener(self, times: TimeBase) -> Whitener:
        """Return what decorrelates whole columns on a time base, in units of `white`."""
        return Whitener(self.processes, times)

    def block_whitener(self, width: int) -> BlockWhitener:
        """Return what decorrelates columns block by block, in units of `white`."""
        return BlockWhitener(self.processes, width)

    def whiten(self, record: Record, columns: FloatArray) -> FloatArray:
        """Return `columns` decorrelated and scaled to unit variance, shape as given (n, m)."""
        return self.block_whitener(columns.shape[1]).whiten(record, columns) / self.white


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseFit:
    """The noise that a set of residuals shows.

    Attributes
    ----------
    noise : NoiseModel
        The likeliest.
    support : tuple of (float, NoiseModel)
        The noise models that the data allow, each with its share of the likelihood: sigmas that
        ignored how roughly drift is known from a few runs would be too small.
    """

    noise: NoiseModel
    support: tuple[tuple[float, NoiseModel], ...]


def given_noise(noise: NoiseModel) -> NoiseFit:
    """Return the fit of a noise that is known."""
    return NoiseFit(noise=noise, support=((1.0, noise),))


def drifting(ratio2: float, tau_s: float) -> NoiseModel:
    """Return white noise of unit sigma with one slow process of `ratio2` times its variance."""
    return NoiseModel(drift=float(np.sqrt(ratio2)), drift_tau_s=tau_s)


def walking(ratio2: float, times: TimeBase, *, continued: bool) -> NoiseModel:
    """Return white noise with a random walk that has `ratio2` of variance after the longest run.

    It begins from zero with every run, or goes on through the rests between them.
    """
    return NoiseModel(
        drift=float(np.sqrt(0.5 * WALK_SPANS * ratio2)),
        drift_tau_s=WALK_SPANS * times.span_s,
        slow="walk",
        continued=continued,
    )


def flicker(ratio2: float, times: TimeBase) -> NoiseModel:
    """Return white noise with flicker noise; `ratio2` is the variance of each of its poles."""
    return NoiseModel(
        drift=float(np.sqrt(ratio2)),
        drift_tau_s=times.step_s,
        slow="flicker",
        longest_tau_s=10.0 * times.span_s,
    )
