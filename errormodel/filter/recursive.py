"""A linear model estimated reading by reading, under white noise and drift.

The unknowns are constants, the drift is one more state of the same filter; after n readings the
estimate is the generalised least-squares one of those readings and the prior, to rounding.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from errormodel.arrays import FloatArray
from errormodel.filter.kalman import Innovation, State, initial_state, propagate, update
from errormodel.noise.model import NoiseModel


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RecursiveFit:
    """The estimate so far: constants first, drift last.

    Attributes
    ----------
    noise : NoiseModel
    state : State
        Of p constants and the drift.
    time_s : float or None
        When the last reading was taken, since its run began.
    """

    noise: NoiseModel
    state: State
    time_s: float | None = None

    @property
    def values(self) -> FloatArray:
        """The constants, shape (p,)."""
        return self.state.x[:-1]

    @property
    def cov(self) -> FloatArray:
        """Their covariance, shape (p, p)."""
        return self.state.cov[:-1, :-1]

    def new_run(self) -> "RecursiveFit":
        """Return the estimate at the start of another run: the drift begins anew."""
        return RecursiveFit(
            noise=self.noise, state=self._drifted(0.0, self.noise.drift), time_s=None
        )

    def step(
        self, time_s: float, columns: ArrayLike, reading: float
    ) -> "tuple[RecursiveFit, Innovation]":
        """Return the estimate with one more reading, and what it brought.

        Parameters
        ----------
        time_s : float
            Since the run began; later than the last one.
        columns : array_like, shape (p,)
            What the constants are multiplied by in this reading.
        reading : float

        Raises
        ------
        ValueError
            If time runs backwards or the reading is not finite.
        """
        state = self.state
        if self.time_s is not None:
            if time_s <= self.time_s:
                raise ValueError(f"time {time_s} s does not follow {self.time_s} s")
            state = self._drifted(*self.noise.drift_step(time_s - self.time_s))
        row = np.append(np.asarray(columns, dtype=float), 1.0)
        state, innovation = update(state, row, self.noise.white**2, reading)
        return RecursiveFit(noise=self.noise, state=state, time_s=time_s), innovation

    def _drifted(self, keep: float, sigma: float) -> State:
        n = self.state.x.size
        phi, g = np.eye(n), np.zeros((n, 1))
        phi[-1, -1], g[-1, 0] = keep, 1.0
        return propagate(self.state, phi, g, [sigma**2])


def start_recursive(noise: NoiseModel, prior: ArrayLike, prior_sigma: ArrayLike) -> RecursiveFit:
    """Return the estimate before any reading.

    Parameters
    ----------
    noise : NoiseModel
    prior, prior_sigma : array_like, shape (p,)
        What is known of the constants beforehand, independent of one another.
    """
    x = np.append(np.asarray(prior, dtype=float), 0.0)
    variances = np.append(np.asarray(prior_sigma, dtype=float) ** 2, noise.drift**2)
    return RecursiveFit(noise=noise, state=initial_state(x, variances))
