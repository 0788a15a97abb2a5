"""Watlow F4: 16-bit integers over Modbus; a ramp is a profile of one step.

The workbench keeps one profile of its own in the controller's memory, known by its name, and edits
it in place for each ramp: the memory of 40 profiles does not fill up, and nothing is written to
the EEPROM, whose writes are counted.
"""

import logging
from collections.abc import Callable, Sequence
from contextlib import suppress

from drivers.chambers.modbus_chamber import ModbusChamber, SafeStep
from drivers.errors import (
    DeviceError,
    InstrumentError,
    LimitError,
    LinkError,
    ProtocolError,
)

log = logging.getLogger(__name__)

PROFILES = 40
PROFILE_NAME = "ACCELBENCH"  # ten characters is what a name has room for
LONGEST_STEP_S = 99 * 3600 + 59 * 60 + 59
RATE_ERROR_WORTH_TELLING = 0.005
_VERBS = {"running": "runs", "paused": "is paused"}
_RUNNING = tuple(_VERBS)


class WatlowF4(ModbusChamber):
    """A chamber under a Watlow F4, channel 1.

    A profile's first step ramps from the set point in force, which `ramp_to_c` has put at the
    chamber's own temperature. The rate of a ramp-rate step comes in tenths of °C/min; other rates
    become a ramp-time step, whose time comes in whole seconds.
    """

    _profile_number = 0  # not looked for yet
    _ramp_to_c: float | None = None  # where the profile of the workbench goes, the last command

    # ---- recognising it

    def _read_scale(self) -> dict[str, float | str]:
        units, decimals = self._get_proof("units"), self._get_proof("decimals")
        if self._map["units"].name_of(units) != "celsius":
            works = "works in °F" if units == 0.0 else f"shows unit {units:g} at 901"
            raise self._not_recognised(f"the controller {works}, set it to °C")
        if decimals != self._config.decimals:
            raise self._not_recognised(
                f"the controller shows {decimals:g} decimals, "
                f"expected {self._config.decimals} as in the station file"
            )
        return {"units": "celsius", "decimals": decimals}

    # ---- driving it

    def read_setpoint_c(self) -> float:
        """Read the set point the loop follows now, °C: the profile's while one runs."""
        running = self._state("state") in _RUNNING
        value = self._get("profile_setpoint" if running else "setpoint")
        return self._plausible("set point", value)

    def _working_setpoint(self) -> float | None:
        return None  # outside of profiles the sources know the static set point only

    def _hold(self, temp_c: float) -> None:
        self._ramp_to_c = None
        self._set("setpoint", temp_c)

    def _ramp(self, start_c: float, temp_c: float, rate_c_per_min: float) -> None:
        resolution_c = 10.0**-self._config.decimals
        if abs(temp_c - start_c) < resolution_c:
            self._hold(temp_c)
            return
        hours, minutes, seconds, tenths = self._step_of(abs(temp_c - start_c), rate_c_per_min)
        self._select_own_profile()
        self._set("step_type", "ramp_rate" if tenths else "ramp_time")
        if tenths:
            self._set("step_rate", tenths / 10)
        else:
            self._set("step_hours", hours)
            self._set("step_minutes", minutes)
            self._set("step_seconds", seconds)
        self._set("step_target", temp_c)
        self._set("step_wait", "off")
        self._set("step_soak", "off")
        self._set("step", 2)
        self._set("end_mode", "hold")
        self._start()
        self._ramp_to_c = temp_c

    def _step_of(self, distance_c: float, rate_c_per_min: float) -> tuple[int, int, int, int]:
        """Return h, m, s of a ramp-time step, or 0, 0, 0 and the tenths of a ramp-rate step."""
        exact_s = 60 * distance_c / rate_c_per_min
        whole_s, tenths = max(1, round(exact_s)), round(10 * rate_c_per_min)
        error_by_time = abs(exact_s / whole_s - 1) if whole_s <= LONGEST_STEP_S else float("inf")
        error_by_rate = abs(tenths / (10 * rate_c_per_min) - 1) if tenths else float("inf")
        error = min(error_by_time, error_by_rate)
        if error > 0.5:
            raise LimitError(
                f"{self._name}: a ramp over {distance_c:g} °C at {rate_c_per_min:g} °C/min "
                "cannot be expressed, expected at most 100 h or tenths of °C/min"
            )
        if error > RATE_ERROR_WORTH_TELLING:
            log.warning("%s: ramp rate off by %.1f %%: steps are whole seconds or tenths of °C/min",
                        self._name, 100 * error)  # fmt: skip
        if error_by_rate <= max(error_by_time, 1e-9):
            return 0, 0, 0, tenths
        return whole_s // 3600, whole_s % 3600 // 60, whole_s % 60, 0

    # ---- the profile of the workbench

    def _select_own_profile(self) -> None:
        """Have the edit registers speak of step 1 of the workbench's profile, made if need be."""
        number = self._profile_number
        if not (number and self._name_of_profile(number) == PROFILE_NAME):
            number = self._find_profile() or self._create_profile()
            self._profile_number = number
        self._set("profile", number)
        self._set("step", 2)
        if self._state("step_type") != "end":
            raise DeviceError(
                f"{self._name}: profile {number} {PROFILE_NAME} was changed by somebody, "
                "expected one ramp and an end; delete it at the controller"
            )
        self._set("step", 1)

    def _find_profile(self) -> int:
        if self._get("free_profiles") >= PROFILES:
            return 0
        names = (n for n in range(1, PROFILES + 1) if self._name_of_profile(n) == PROFILE_NAME)
        return next(names, 0)

    def _create_profile(self) -> int:
        """Create a profile of one ramp and an end, under the workbench's name."""
        free = self._get("free_profiles")
        if free < 1:
            raise DeviceError(f"{self._name}: no free profile; a ramp needs one")
        self._once("create", lambda: self._get("free_profiles") < free)
        number = int(self._get("profile"))
        if not 1 <= number <= PROFILES:
            raise DeviceError(f"{self._name}: created profile {number}, expected 1 to {PROFILES}")
        try:
            self._fill_profile(number)
        except InstrumentError:
            with suppress(InstrumentError):  # what was half made should not take up memory
                self._set("profile", number)
                self._command("action", "delete", repeatable=False)
            raise
        return number

    def _fill_profile(self, number: int) -> None:
        self._set("step", 1)
        self._once("insert", self._has_ramp_step)
        # the name goes on last: a profile half made is never taken for a finished one
        address = self._map["name_of_profile_1"].address + 10 * (number - 1)
        self._link.write(address, [ord(c) for c in PROFILE_NAME], what="profile name")
        if self._name_of_profile(number) != PROFILE_NAME:
            raise DeviceError(f"{self._name}: profile {number} did not take its name")

    def _has_ramp_step(self) -> bool:
        self._set("step", 2)
        ends_at_2 = self._state("step_type") == "end"
        self._set("step", 1)
        return ends_at_2 and self._state("step_type") != "end"

    def _name_of_profile(self, number: int) -> str:
        address = self._map["name_of_profile_1"].address + 10 * (number - 1)
        return "".join(chr(w & 0x7F) for w in self._link.read(address, 10, what="profile name"))

    def _start(self) -> None:
        self._set("profile", self._profile_number)
        self._set("step", 1)
        self._once("start", lambda: self._state("state") == "running")

    def _once(self, action: str, done: Callable[[], bool]) -> None:
        """Give a command that must not be given twice; when in doubt look whether it was taken."""
        for _ in range(2):
            try:
                self._command("action", action, repeatable=False)
            except (LinkError, ProtocolError) as failure:
                log.warning("%s; looking whether it was taken", failure)
                if done():
                    return
                self.counters.retries += 1
                continue
            if done():
                return
            raise DeviceError(f"{self._name}: the profile action {action} had no effect")
        raise LinkError(f"{self._name}: the profile action {action} was not taken in two attempts")

    # ---- the rest of a chamber

    def _leave_profile(self, next_c: float) -> None:
        if self._state("state") in _RUNNING:
            # the end of a profile puts the static set point in force, which may be an old one
            with suppress(DeviceError):
                self._set("setpoint", next_c)
            self._end_profile()

    def _end_profile(self) -> str:
        """Terminate; harmless when no profile runs."""
        self._command("terminate", "terminate", repeatable=True)
        state = self._state("state")
        if state in _RUNNING:
            raise DeviceError(f"{self._name}: the profile is still {state} after terminate")
        return f"state {state}"

    def _sensor_fault(self) -> str:
        code = self._get("input_error")
        return f"sensor fault at input 1 (error {code:g})" if code else ""

    def _own_alarms(self) -> Sequence[str]:
        return ()  # the sources give no alarm registers; input error and temperature are judged

    def _occupation(self) -> Sequence[str]:
        state = self._state("state")
        if state not in _RUNNING or (self._is_own() and state == "running"):
            return ()
        setpoint_c = self._get("profile_setpoint")
        return (f"{self._running_profile()} {_VERBS[state]}, set point {setpoint_c:g} °C",)

    def _foreign_changes(self) -> list[str]:
        """Compare by what the ramp is doing: the static set point waits while its profile runs."""
        target_c, state = self._ramp_to_c, self._state("state")
        if state in _RUNNING:
            if target_c is None or not self._is_own():
                own = "none" if target_c is None else f"profile {self._profile_number}"
                return [f"{self._running_profile()} {_VERBS[state]}, {own} commanded"]
            return ["profile is paused, commanded running"] if state == "paused" else []
        if target_c is None:
            return super()._foreign_changes()
        held_c = self._get("setpoint")  # the end of the ramp has become the static set point
        if self._same(self._map["setpoint"], held_c, target_c):
            return []
        return [f"{self._phrase('setpoint', held_c)}, {self._told('setpoint', target_c)}"]

    def _is_own(self) -> bool:
        """Tell whether the profile that runs can be the one this driver started."""
        number = self._get_optional("current_profile")
        return self._ramp_to_c is not None and number in (None, self._profile_number)

    def _running_profile(self) -> str:
        number = self._get_optional("current_profile")
        return "profile" if number is None else f"profile {number:g}"

    def _safe_steps(self, temp_c: float) -> Sequence[SafeStep]:
        return (
            ("set point to come", lambda: self._set_safe_temp(temp_c)),
            ("end profile", self._end_profile),
            ("set point", lambda: self._hold_safe(temp_c)),
        )

    def _hold_safe(self, temp_c: float) -> str:
        self._ramp_to_c = None
        return self._set_safe_temp(temp_c)
