"""Eurotherm 3504: scaled integers over Modbus RTU or TCP, and a set point rate limit."""

from collections.abc import Sequence

from drivers.chambers.modbus_chamber import ModbusChamber, SafeStep
from drivers.chambers.recognition import Evidence
from drivers.errors import DeviceError

_VERBS = {
    "running": "runs",
    "holding": "is held",
    "holdback": "waits for the temperature",
    "ended": "has ended and still governs",
}
_RUNNING = tuple(_VERBS)
# In the whole numbers' own units: the two are read one after the other, and a wrong power of ten
# makes of 20 units at least 180 too many or 18 too few.
LEAST_UNITS, ROUNDING_UNITS = 20.0, 2.0


class Eurotherm3504(ModbusChamber):
    """A chamber under a Eurotherm 3504, loop 1.

    With the rate limit in force the working set point moves from where it stands to the target.
    With the limit disabled, or 0, it jumps to the target at once.
    """

    _scale_shown = False

    # ---- recognising it

    def _read_scale(self) -> dict[str, float | str]:
        self._scale_shown = self._compare_floats()
        return {"decimals": float(self._config.decimals)}

    def _compare_floats(self) -> bool:
        """Compare whole numbers with the same ones as floats; tell whether that showed the scale.

        Raises
        ------
        RecognitionError
            If they are not the same.
        """
        shown, units = False, 10**self._config.decimals
        for name in ("setpoint", "temperature"):
            exact = self._get_optional(f"{name}_float")
            whole = None if exact is None else self._get(name)
            # of a small number a wrong power of ten is hidden in the rounding
            if exact is None or whole is None or abs(whole * units) < LEAST_UNITS:
                continue
            if not abs(whole - exact) * units <= ROUNDING_UNITS:
                raise self._not_recognised(
                    f"{name} reads {whole:g} with decimals = {self._config.decimals} and "
                    f"{exact:g} as a float, so decimals is another"
                )
            shown = True
        return shown

    def _check_confirmed(self, scale: Evidence) -> None:
        if not self._scale_shown:
            wanted = f"decimals = {self._config.decimals}, °C"
            self._require_confirmation(wanted, f"the scale, decimals = {self._config.decimals}")

    def _governed_elsewhere(self) -> bool:
        disabled = self._get_optional("ramp_disable")
        ramps = self._get("ramp_rate") != 0.0 and disabled != 1.0
        elsewhere = self._get_optional("remote_select") or self._get_optional("control_mode")
        return ramps or bool(elsewhere) or self._program_state() in _RUNNING

    # ---- driving it

    def _working_setpoint(self) -> float | None:
        return self._get("working_setpoint")

    def _hold(self, temp_c: float) -> None:
        self._local()
        # the set point first: without the rate limit it would jump to the target of the old ramp
        self._set("setpoint", temp_c)
        self._ramp_off()
        self._set("control_mode", "auto")

    def _ramp_off(self) -> str:
        """Take the rate limit away both ways there are: a rate of 0, and the switch if fitted."""
        return f"{self._set('ramp_rate', 0.0)}, {self._set('ramp_disable', 'no_ramp')}"

    def _ramp(self, start_c: float, temp_c: float, rate_c_per_min: float) -> None:
        self._set("ramp_rate", rate_c_per_min)
        self._set("ramp_disable", "ramp")
        self._set("setpoint", temp_c)

    def _local(self) -> str:
        """Follow the set point of this link, not a remote one."""
        if self._get_optional("remote_select") in (None, 0.0):
            return "set point is local"
        return self._set("remote_select", "local")

    def _leave_profile(self, next_c: float) -> None:
        self._end_program()

    def _end_program(self) -> str:
        """Reset a running program and check that it ended."""
        state = self._program_state()
        if state in _RUNNING:
            self._command("program_reset", "reset", repeatable=True)
            state = self._program_state()
            if state in _RUNNING:
                raise DeviceError(f"{self._name}: the program is still {state} after reset")
        return f"program {state}"

    def _program_state(self) -> str:
        code = self._get_optional("program_state")
        if code is None:
            return "not fitted"
        name = self._map["program_state"].name_of(code)
        return name if name in _RUNNING else "not running"

    def _status(self) -> list[str]:
        """Return the names of the status bits that are set."""
        bits = int(self._get_optional("status") or 0)
        return [name for name, bit in self._map["status"].values.items() if bits & bit]

    def _sensor_fault(self) -> str:
        status = self._status()
        broken = [s for s in ("sensor_break", "pv_out_of_range") if s in status]
        return ", ".join(broken).replace("_", " ")

    def _own_alarms(self) -> Sequence[str]:
        sensor = ("sensor_break", "pv_out_of_range")
        return [name.replace("_", " ") for name in self._status() if name not in sensor]

    def _occupation(self) -> Sequence[str]:
        found, state = list[str](), self._program_state()
        force = f"set point {self._working_setpoint():g} °C"
        if state in _RUNNING:
            found.append(f"program {_VERBS[state]}, {force}")
        if self._get_optional("remote_select"):
            found.append(f"set point is remote, {force}")
        if self._get_optional("control_mode"):
            found.append("loop is in manual")
        return found

    def _foreign_program(self) -> Sequence[str]:
        state = self._program_state()
        return (f"program {_VERBS[state]}, none commanded",) if state in _RUNNING else ()

    def _safe_steps(self, temp_c: float) -> Sequence[SafeStep]:
        return (
            ("end program", self._end_program),
            ("local set point", self._local),
            ("set point", lambda: self._set_safe_temp(temp_c)),
            ("ramp off", self._ramp_off),
            # in manual a fixed power heats, whatever the temperature: that is not left alone
            ("automatic", lambda: self._set("control_mode", "auto")),
            ("loop", lambda: self._await_setpoint(temp_c)),
        )
