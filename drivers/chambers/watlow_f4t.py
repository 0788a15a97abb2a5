"""Watlow F4T: floats over Modbus TCP or RTU, and a ramp of the set point of its own."""

from collections.abc import Mapping, Sequence

from drivers.chambers.modbus_chamber import ModbusChamber, SafeStep
from drivers.chambers.recognition import Evidence, find_problem, swap_words
from drivers.errors import DeviceError

NOT_SHOWN = "not shown"
_VERBS = {"running": "runs", "paused": "is paused", "timed_start": "waits for its start"}
_RUNNING = tuple(_VERBS)


class WatlowF4T(ModbusChamber):
    """A chamber under a Watlow F4T, control loop 1.

    With the ramp action "set point" the closed-loop set point moves from where it stands to a new
    static set point at the ramp rate. It stands at the static set point when there is no ramp.
    """

    # ---- recognising it

    def _read_scale(self) -> dict[str, float | str]:
        """Read the unit of the port this link is on, or of the display where it is not told."""
        port = "tcp_units" if self._config.url.startswith("modbus+tcp:") else "rtu_units"
        units = self._units(port)
        if units == "fahrenheit":
            raise self._not_recognised(
                f"its Modbus port works in °F ({port} at {self._map[port].address}), set it to °C"
            )
        if units != "celsius" and self._units("display_units") != "celsius":
            return {"units": NOT_SHOWN, "word_order": self._config.word_order}
        return {"units": "celsius", "word_order": self._config.word_order}

    def _units(self, name: str) -> str:
        code = self._get_optional(name)
        return NOT_SHOWN if code is None else self._map[name].name_of(code)

    def _check_confirmed(self, scale: Evidence) -> None:
        if scale["units"] == NOT_SHOWN:
            in_f = self._units("display_units") == "fahrenheit"
            display = ", and its display is in °F" if in_f else ""
            self._require_confirmation("Modbus in °C", f"the unit on the wire{display}")

    def _check_words(self, limits: tuple[float, float] | None, shown: Mapping[str, float]) -> None:
        """Hold what was read against what it would be with the halves of each float swapped."""
        mine, other = self._config.word_order, "high" if self._config.word_order == "low" else "low"
        swapped = None if limits is None else (swap_words(limits[0]), swap_words(limits[1]))
        if find_problem(swapped, {name: swap_words(value) for name, value in shown.items()}):
            return  # what there is to say about the order of the file is said next
        if find_problem(limits, shown):
            why = f'its floats come {other} word first, the station file has word_order = "{mine}"'
        else:
            why = "its floats make sense in either word order"
        raise self._not_recognised(why)

    def _governed_elsewhere(self) -> bool:
        ramps = self._state("ramp_action") not in ("off", "startup")
        automatic = self._state("control_mode") == "auto"
        return ramps or not automatic or self._profile_state() in _RUNNING

    # ---- driving it

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
        if "control_mode" in self._commanded and self._state("control_mode") == "off":
            raise DeviceError(
                f"{self._name}: the loop was switched off at the controller since it was "
                "commanded; it is left off"
            )
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

    def _occupation(self) -> Sequence[str]:
        found, state, mode = list[str](), self._profile_state(), self._state("control_mode")
        if state in _RUNNING:
            force_c = self._working_setpoint()
            to = "" if force_c is None else f", set point {force_c:g} °C"
            found.append(f"profile {_VERBS[state]}{to}")
        if mode != "auto":
            found.append("loop is off" if mode == "off" else f"loop is in {mode}")
        return found

    def _foreign_program(self) -> Sequence[str]:
        state = self._profile_state()
        return (f"profile {_VERBS[state]}, none commanded",) if state in _RUNNING else ()

    def _safe_steps(self, temp_c: float) -> Sequence[SafeStep]:
        # the set point goes in also where the loop is off: who switches it on is not run away with
        return (
            ("end profile", self._end_profile),
            ("set point", lambda: self._set_safe_temp(temp_c)),
            ("ramp off", lambda: self._set("ramp_action", "off")),
            ("loop", lambda: self._close_loop(temp_c)),
        )

    def _close_loop(self, temp_c: float) -> str:
        """Have the loop go by the safe set point, unless somebody switched it off."""
        if self._state("control_mode") == "off":
            return "off, left off"
        # in manual a fixed power heats, whatever the temperature: that is not left alone
        return f"{self._set('control_mode', 'auto')}, {self._await_setpoint(temp_c)}"
