"""Limits of what a chamber may be told to do: the station's and the controller's own."""

import logging
import math

from drivers.chambers.maps import RegisterMap
from drivers.devices import Range
from drivers.errors import LimitError, RecognitionError
from drivers.station import ChamberConfig

log = logging.getLogger(__name__)


class ChamberLimits:
    """Limits of set points and rates; what lies outside is refused, never clipped.

    Parameters
    ----------
    config : ChamberConfig
        The station's limits.
    register_map : RegisterMap
        What rates the controller can express.
    name : str
        The instrument's name, for messages.
    """

    def __init__(self, config: ChamberConfig, register_map: RegisterMap, *, name: str) -> None:
        self._name = name
        self._wanted = config.limits_c
        self._safe_temp_c = config.safe_temp_c
        self._step = register_map.ramp_rate_step_c_per_min
        lo, hi = config.rate_limits_c_per_min
        self.temp_c = Range(lo=self._wanted[0], hi=self._wanted[1])
        self.rate_c_per_min = Range(
            lo=max(lo, self._step or lo), hi=min(hi, register_map.ramp_rate_max_c_per_min)
        )

    def check_temp(self, temp_c: float) -> None:
        """Raise LimitError for a set point (°C) outside, or no number."""
        limits = self.temp_c
        if not (math.isfinite(temp_c) and temp_c in limits):
            raise LimitError(
                f"{self._name}: set point {temp_c:g} °C is outside "
                f"{limits.lo:g} to {limits.hi:g} °C, nothing was sent"
            )

    def check_rate(self, rate_c_per_min: float) -> None:
        """Raise LimitError for a rate outside, not expressible, or no number."""
        limits, step = self.rate_c_per_min, self._step
        if not (math.isfinite(rate_c_per_min) and rate_c_per_min in limits):
            raise LimitError(
                f"{self._name}: rate {rate_c_per_min:g} °C/min is outside "
                f"{limits.lo:g} to {limits.hi:g} °C/min, nothing was sent"
            )
        if step is not None and abs(rate_c_per_min / step - round(rate_c_per_min / step)) > 1e-6:
            raise LimitError(
                f"{self._name}: rate {rate_c_per_min:g} °C/min cannot be set, "
                f"expected a multiple of {step:g} °C/min, nothing was sent"
            )

    def narrow(self, lo: float, hi: float) -> None:
        """Let the tighter of the station's limits and the controller's (lo, hi; °C) apply.

        Raises
        ------
        RecognitionError
            If they have nothing in common.
        """
        narrowed = Range(lo=max(lo, self._wanted[0]), hi=min(hi, self._wanted[1]))
        if not narrowed.lo < narrowed.hi:
            raise RecognitionError(
                f"{self._name}: the controller takes set points {lo:g} to {hi:g} °C, "
                f"the station file says {self._wanted[0]:g} to {self._wanted[1]:g} °C"
            )
        if (narrowed.lo, narrowed.hi) != self._wanted:
            log.warning(
                "%s: set points limited to %g to %g °C by the controller",
                self._name,
                narrowed.lo,
                narrowed.hi,
            )
        self.temp_c = narrowed

    def check_safe_temp(self) -> None:
        """Raise RecognitionError when the safe temperature cannot be commanded here."""
        limits = self.temp_c
        if self._safe_temp_c not in limits:
            raise RecognitionError(
                f"{self._name}: the safe temperature {self._safe_temp_c:g} °C is outside "
                f"{limits.lo:g} to {limits.hi:g} °C, the range that the controller accepts"
            )
