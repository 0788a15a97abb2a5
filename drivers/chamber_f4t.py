"""Watlow F4T: floats over Modbus TCP or RTU, and a ramp of the set point of its own."""

from collections.abc import Sequence

from drivers.chamber_modbus import ModbusChamber, SafeStep
from drivers.errors import DeviceError

_RUNNING = ("running", "paused", "timed_start")


class WatlowF4T(ModbusChamber):
    """A chamber under a Watlow F4T, control loop 1.

    With the ramp action "set point" the closed-loop set point moves from where it stands to a new
    static set point at the ramp rate. It stands at the static set point when there is no ramp.
    """

    def read_setpoint_c(self) -> float:
        """Read the set point the loop follows now, °C.

        Raises
        ------
        DeviceError
            Also where the register of it is missing and a ramp may be moving it.
        """
        if self._working_setpoint() is None and self._state("ramp_action") in ("off", "startup"):
            return self._plausible("set point", self._get("setpoint"))
        return super().read_setpoint_c()

    def _working_setpoint(self) -> float | None:
        return self._get_optional("working_setpoint")

    def _hold(self, temp_c: float) -> None:
        # the set point first: with the ramp off it would jump to the target of the old ramp
        self._set("setpoint", temp_c)
        self._set("ramp_action", "off")
        self._set("control_mode", "auto")

    def _ramp(self, start_c: float, temp_c: float, rate_c_per_min: float) -> None:
        self._set("ramp_scale", "per_minute")
        self._set("ramp_rate", rate_c_per_min)
        self._set("ramp_action", "setpoint")
        self._set("setpoint", temp_c)

    def _leave_profile(self, next_c: float) -> None:
        self._end_profile()

    def _end_profile(self) -> str:
        """Terminate a running profile and check that it ended."""
        state = self._profile_state()
        if state in _RUNNING:
            self._command("profile_action", "terminate", repeatable=True)
            state = self._profile_state()
            if state in _RUNNING:
                raise DeviceError(f"{self._name}: the profile is still {state} after terminate")
        return f"profile {state}"

    def _profile_state(self) -> str:
        code = self._get_optional("profile_state")
        if code is None:
            return "not fitted"
        name = self._map["profile_state"].name_of(code)
        return name if name in _RUNNING else "not running"

    def _sensor_fault(self) -> str:
        code = self._get_optional("limit_input")
        if code is None or code in self._map["limit_input"].values.values():
            return ""
        return f"sensor fault at the limit input (code {code:g})"

    def _own_alarms(self) -> Sequence[str]:
        alarms = list[str]()
        for name in ("alarm_1", "alarm_2", "alarm_3", "alarm_4"):
            code = self._get_optional(name)
            if code is not None and code not in self._map[name].values.values():
                alarms.append(f"{name.replace('_', ' ')} (code {code:g})")
        if self._get_optional("limit_state") == self._map["limit_state"].values["error"]:
            alarms.append("limit tripped")
        if self._get_optional("limit_status") == self._map["limit_status"].values["fail"]:
            alarms.append("limit controller failed")
        return alarms

    def _safe_steps(self, temp_c: float) -> Sequence[SafeStep]:
        return (
            ("end profile", self._end_profile),
            ("set point", lambda: self._set_safe_temp(temp_c)),
            ("ramp off", lambda: self._set("ramp_action", "off")),
            ("automatic", lambda: self._set("control_mode", "auto")),
            ("loop", lambda: self._await_setpoint(temp_c)),
        )
