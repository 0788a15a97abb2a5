"""Base of the chamber controllers on Modbus.

A model is a register map and a class of a few lines that says in which order its registers are
set. Here stand the limits, the reading back of everything written, and the way to a safe state.
"""

import logging
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence

from drivers.chambers.watch import WatchedController
from drivers.devices import CHAMBER_C, LinkCounters, Range, SafeResult
from drivers.errors import DeviceError, FencedError, InstrumentError, LimitError, RecognitionError

log = logging.getLogger(__name__)

OVER_TEMPERATURE_MARGIN_C = 5.0  # an overshoot is less than this, a runaway soon more
SafeStep = tuple[str, Callable[[], str]]


class ModbusChamber(WatchedController, ABC):
    """A chamber with one temperature loop behind Modbus; the models derive from it.

    It is made as `drivers.chambers.recognition.RecognisedController` is.
    """

    # ---- what a Device is

    @property
    def name(self) -> str:
        """The instrument's name in the station file, for messages."""
        return self._name

    @property
    def counters(self) -> LinkCounters:
        """Exchanges, retries and faults so far."""
        return self._link.counters

    @property
    def limits_c(self) -> Range:
        """Set points outside are refused; `identify` adds the controller's own limits."""
        return self._limits.temp_c

    @property
    def rate_limits_c_per_min(self) -> Range:
        """Ramp rates the controller can express and the station allows."""
        return self._limits.rate_c_per_min

    def identify(self) -> str:
        """Recognise the chamber of the station file; until then nothing is written to it.

        No register common to these controllers names the model, so it is judged by what it
        shows: scale, unit and word order, set point limits and temperatures that a chamber can
        have. The limits are kept: the tighter of the controller's and the station's apply from
        here on.

        Returns
        -------
        str
            The model, the temperature and the limits in force.

        Raises
        ------
        RecognitionError
            If it is not shown to be the chamber of the station file.
        DeviceError
            If it is, and its temperature cannot be read.
        """
        with self._commanding:
            self._recognise()
        temp_c, limits = self._plausible("temperature", self._get("temperature")), self.limits_c
        return f"{self._map.title}, {temp_c:g} °C, set points {limits.lo:g} to {limits.hi:g} °C"

    def read_settings(self) -> Mapping[str, str | float]:
        """Read the settings worth keeping with a run; enumerated ones by name."""
        settings: dict[str, str | float] = {
            "model": self._map.title,
            "decimals_configured": float(self._config.decimals),
        }
        for name, register in self._map.registers.items():
            value = self._get_optional(name) if register.setting else None
            if value is not None:
                settings[name] = register.name_of(value) if register.values else value
        return settings

    def close(self) -> None:
        """Release the port; harmless when done twice. Changes nothing in the controller."""
        self._link.close()

    # ---- what a Chamber is

    def read_temp_c(self) -> float:
        """Read the chamber's own temperature, °C.

        Once the controller has been recognised, scale, unit and word order are read again after
        the temperature: somebody may have changed them at the panel, and the number alone does
        not show it.

        Raises
        ------
        RecognitionError
            If they are not what they were.
        DeviceError
            On a broken sensor, or a number that no chamber has.
        """
        number = self._get("temperature")
        if self._evidence:
            self._check_scale()
        return self._trusted(number)

    def read_setpoint_c(self) -> float:
        """Read the set point the loop follows now, °C."""
        value_c = self._working_setpoint()
        if value_c is None:
            raise DeviceError(f"{self._name}: no register here tells the set point in force")
        return self._plausible("set point", value_c)

    def hold_temp_c(self, temp_c: float) -> None:
        """Go to `temp_c` as fast as the chamber does, and hold; what is written is read back.

        Parameters
        ----------
        temp_c : float
            Set point, °C.

        Raises
        ------
        LimitError
            If it is outside the limits; nothing was sent.
        DeviceError
            If the controller refused, holds another value than was written, or goes by another.
        RecognitionError
            If the controller is not recognised, or no more; nothing was sent.
        """
        self._check_temp(temp_c)
        with self._commanding:
            self._still_recognised()
            self._leave_profile(temp_c)
            self._hold(temp_c)
            self._await_setpoint(temp_c)

    def ramp_to_c(self, temp_c: float, rate_c_per_min: float) -> None:
        """Move the set point from where the chamber is to `temp_c` uniformly, and hold there.

        Parameters
        ----------
        temp_c : float
            Where to, °C.
        rate_c_per_min : float
            How fast, °C/min, positive in both directions.

        Raises
        ------
        LimitError
            If either is outside its limits; nothing was sent.
        DeviceError
            If the controller refused, or holds another value than was written. The chamber then
            holds the temperature it was at, or its last set point.
        RecognitionError
            If the controller is not recognised, or no more; nothing was sent.
        """
        self._check_temp(temp_c)
        self._limits.check_rate(rate_c_per_min)
        with self._commanding:
            self._still_recognised()
            # the controllers ramp from the set point in force: first put it where the chamber is
            present_c = self._trusted(self._get("temperature"))  # its scale was just seen
            start_c = min(max(present_c, self.limits_c.lo), self.limits_c.hi)
            self._leave_profile(start_c)
            self._hold(start_c)
            try:
                self._await_setpoint(start_c)
            except DeviceError as failure:
                log.warning("%s; the ramp may begin elsewhere than at %g °C", failure, start_c)
            self._ramp(start_c, temp_c, rate_c_per_min)
            self._check_under_way(start_c, temp_c)

    def read_alarms(self) -> tuple[str, ...]:
        """Read the faults the chamber reports of itself, in words; empty when there are none."""
        alarms = [*self._own_alarms()]
        broken = self._sensor_fault()
        if broken and broken not in alarms:
            alarms.append(broken)
        temp_c = self._get("temperature")
        if temp_c not in CHAMBER_C:
            alarms.append(f"temperature {temp_c:g} °C is not plausible")
        elif temp_c > self.limits_c.hi + OVER_TEMPERATURE_MARGIN_C:
            alarms.append(f"over-temperature: {temp_c:g} °C, limit {self.limits_c.hi:g} °C")
        return tuple(alarms)

    def make_safe(self, temp_c: float) -> SafeResult:
        """End any ramp or profile, hold `temp_c`, and verify both by reading back.

        A controller that was not recognised yet is recognised first; failing that nothing is
        written. Every step is tried even when one before it failed; a pass in which something
        failed but something worked is done once more. Where the controller tells the set point in
        force, it is given 1.5 s to become the one written. Safe to repeat, and needs nothing from
        an earlier link. Never raises an InstrumentError.

        Parameters
        ----------
        temp_c : float
            The temperature to hold, °C.

        Returns
        -------
        SafeResult
        """
        log.info("%s: making safe at %g °C", self._name, temp_c)
        with self._commanding:
            before = self._link.writes
            self._forget_missing()  # nothing believed to be missing is passed over here
            lines = list[str]()
            try:
                if not self._evidence:
                    self._recognise_at_last()
                verified = self._make_safe(temp_c, lines)
                commanded = True
            except InstrumentError as failure:  # not recognised, or the permit was withdrawn
                verified, commanded = False, self._link.writes > before
                lines.append(f"not commanded{' further' if commanded else ''}: {failure}")
        if not verified:
            log.error("%s: not verified to be safe: %s", self._name, "; ".join(lines))
        return SafeResult(verified=verified, steps=tuple(lines), commanded=commanded)

    # ---- what a model says about itself

    @abstractmethod
    def _hold(self, temp_c: float) -> None:
        """Put the loop in automatic at `temp_c` without any ramp."""

    @abstractmethod
    def _ramp(self, start_c: float, temp_c: float, rate_c_per_min: float) -> None:
        """Start a ramp to `temp_c`; the set point in force is `start_c`."""

    @abstractmethod
    def _leave_profile(self, next_c: float) -> None:
        """End a profile or program that somebody started; `next_c` is where the loop goes then."""

    @abstractmethod
    def _sensor_fault(self) -> str:
        """Return what is wrong with the sensor, or an empty string."""

    @abstractmethod
    def _own_alarms(self) -> Sequence[str]:
        """Return the alarms the controller shows."""

    @abstractmethod
    def _safe_steps(self, temp_c: float) -> Sequence[SafeStep]:
        """Return the steps to a safe state, each verifying itself and saying what it read back."""

    # ---- parts of the above

    def _trusted(self, temp_c: float) -> float:
        """Return a temperature that was read; DeviceError if its sensor is broken."""
        self._plausible("temperature", temp_c)
        broken = self._sensor_fault()
        if broken:
            raise DeviceError(f"{self._name}: {broken}, the temperature is not to be trusted")
        return temp_c

    def _check_temp(self, temp_c: float) -> None:
        self._limits.check_temp(temp_c)
        self._encode("setpoint", temp_c)

    def _recognise_at_last(self) -> None:
        """Recognise the controller, once more when a question went wrong."""
        try:
            self._recognise()
        except RecognitionError:
            raise
        except InstrumentError as failure:
            log.warning("%s; trying to recognise it once more", failure)
            self._recognise()

    def _make_safe(self, temp_c: float, lines: list[str]) -> bool:
        """Go through the safe steps, a second time if it helps; tell whether all held."""
        verified, worked = self._safe_pass(temp_c, lines)
        if not verified and worked:
            lines.append("once more:")
            verified, _ = self._safe_pass(temp_c, lines)
        return verified

    def _safe_pass(self, temp_c: float, lines: list[str]) -> tuple[bool, bool]:
        """Go through the steps once, a line each: all held, any held."""
        held = list[bool]()
        for label, step in (("recognised", self._still_recognised), *self._safe_steps(temp_c)):
            try:
                lines.append(f"{label}: {step()}")
                held.append(True)
            except (RecognitionError, FencedError):
                raise
            except InstrumentError as error:
                lines.append(f"{label}: failed: {error}")
                held.append(False)
        return all(held), any(held)

    def _set_safe_temp(self, temp_c: float) -> str:
        """Write the safe set point, which must be inside the limits like any other."""
        try:
            self._check_temp(temp_c)
        except LimitError:
            # with the ramp off the loop would jump to the ramp's target: let it stay where it is
            force_c = self._working_setpoint()
            if force_c is not None and force_c in self.limits_c:
                self._set("setpoint", force_c)
            raise
        return self._set("setpoint", temp_c)
