"""Estimates of a SINS calibration by a filter, whatever was recorded."""

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray, IntArray, freeze, readonly
from errormodel.filter.kalman import State
from errormodel.filter.steps import Filtered, Steps
from errormodel.terms import Description
from sinscal.filter.data import Nominal
from sinscal.filter.layout import RigLayout
from sinscal.library import rig_library
from sinscal.model.priors import RigPrior
from sinscal.model.sensors import SensorModel


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FilterCalibration:
    """Estimates with their covariance, and the last pass of the filter that they come from.

    Attributes
    ----------
    sensors : SensorModel
    names, values, cov
        Of all constants: the sensors' unknowns first, then the rig's; SI.
    layout : RigLayout
    nominal : Nominal
        Where the filter ended.
    start : State
        What the last pass started from.
    steps : Steps
        Of the last pass.
    filtered : Filtered
        What it made of them.
    cycle_of_step : ndarray of int, shape (K,)
        −1 for the steps that begin a cycle.
    time_s : ndarray, shape (K,)
        End of each step from the start of its cycle.
    prior : RigPrior
    iterations : int
    converged : bool
    warnings : tuple of str
    """

    sensors: SensorModel
    names: tuple[str, ...]
    values: FloatArray
    cov: FloatArray
    layout: RigLayout
    nominal: Nominal
    start: State
    steps: Steps
    filtered: Filtered
    cycle_of_step: IntArray
    time_s: FloatArray
    prior: RigPrior
    iterations: int
    converged: bool
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        freeze(self, values=readonly(self.values), cov=readonly(self.cov))

    @property
    def sigmas(self) -> FloatArray:
        """Standard deviations, in the order of `names`."""
        return np.sqrt(np.diag(self.cov))

    def described(self, name: str) -> Description:
        """Return what a parameter of `names` is."""
        own = self.sensors.parameters
        return own[name] if name in own else rig_library().parameter(name)

    def value(self, name: str) -> float:
        """Return one estimate."""
        return float(self.values[self.names.index(name)])

    def sigma(self, name: str) -> float:
        """Return one standard deviation."""
        return float(self.sigmas[self.names.index(name)])
