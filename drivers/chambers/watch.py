"""Watch over the set point in force, and over commands of anybody else.

What was written is verified by another register, the set point in force; what somebody sets at
the panel or over the network is told by comparing what was commanded with what is held.
"""

import time
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence

from drivers.chambers.recognition import RecognisedController
from drivers.errors import DeviceError

FOLLOW_S = 1.5  # real: a few control cycles, in which the loop takes up a new set point
CYCLE_S = 0.05  # real: between two looks at it
_WORDS = {"setpoint": ("set point", " °C"), "ramp_rate": ("ramp rate", " °C/min")}


class WatchedController(RecognisedController, ABC):
    """A controller whose set point in force and whose other masters are looked after."""

    def read_occupation(self) -> tuple[str, ...]:
        """Read why the chamber is not free to be taken over; empty when it is."""
        return tuple(self._occupation())

    def read_foreign_changes(self) -> tuple[str, ...]:
        """Read what the controller holds otherwise than this driver last commanded, in words.

        Only what was written and read back is compared, with what was read back then: nothing
        changes it but somebody else.
        """
        with self._commanding:
            return tuple(self._foreign_changes()) if self._commanded else ()

    # ---- what a model says about itself

    @abstractmethod
    def _working_setpoint(self) -> float | None:
        """Return the set point in force, °C; None where no register tells it."""

    @abstractmethod
    def _occupation(self) -> Sequence[str]:
        """Return why the chamber is not free, in words."""

    def _foreign_program(self) -> Sequence[str]:
        """Return what runs that this driver did not start, in words."""
        return ()

    def _governed_elsewhere(self) -> bool:
        """Tell whether something may keep the set point in force from the static one."""
        return True

    # ---- who commands

    def _foreign_changes(self) -> list[str]:
        """Return in words what runs, and what is set otherwise than it was commanded."""
        changes = [*self._foreign_program()]
        for name, commanded in self._commanded.items():
            register, held = self._map[name], self._get_optional(name)
            if held is not None and not self._same(register, held, commanded):
                changes.append(f"{self._phrase(name, held)}, {self._told(name, commanded)}")
        return changes

    def _phrase(self, name: str, value: float) -> str:
        """Return what a register holds, in words."""
        label, unit = _WORDS.get(name, (name.replace("_", " "), ""))
        return f"{label} {self._text(self._map[name], value)}{unit}"

    def _told(self, name: str, value: float) -> str:
        """Return what it was told, in words."""
        return f"commanded {self._text(self._map[name], value)}{_WORDS.get(name, ('', ''))[1]}"

    # ---- which set point is in force

    def _await_setpoint(self, temp_c: float) -> str:
        """Wait until the loop goes by a set point, which no ramp, program or remote one overrides.

        A controller takes up what was written in its next cycle, some tenths of a second later.

        Returns
        -------
        str
            The set point in force, in words.

        Raises
        ------
        DeviceError
            If it is still another after 1.5 s.
        """
        give_up_s = time.monotonic() + FOLLOW_S
        while (force_c := self._working_setpoint()) is not None:
            if abs(force_c - temp_c) <= self._near_c:
                return f"goes by {force_c:g} °C"
            if time.monotonic() > give_up_s:
                raise DeviceError(
                    f"{self._name}: the loop goes by {force_c:g} °C, expected {temp_c:g} °C"
                )
            time.sleep(CYCLE_S)
        return "not told here"

    def _check_under_way(self, start_c: float, temp_c: float) -> None:
        """Raise DeviceError when the set point in force is not on the way of the ramp."""
        force_c = self._working_setpoint()
        lo, hi = min(start_c, temp_c) - self._near_c, max(start_c, temp_c) + self._near_c
        if force_c is not None and not lo <= force_c <= hi:
            raise DeviceError(
                f"{self._name}: the loop goes by {force_c:g} °C, not between {start_c:g} and "
                f"{temp_c:g} °C"
            )

    def _check_setpoints(self, shown: Mapping[str, float]) -> None:
        """Raise RecognitionError when the loop goes by another set point for no reason shown."""
        force_c, static_c = shown.get("working set point"), shown["set point"]
        if force_c is None or abs(force_c - static_c) <= self._near_c:
            return
        if not self._governed_elsewhere():
            raise self._not_recognised(
                f"the loop goes by {force_c:g} °C, its set point is {static_c:g} °C, "
                "and neither ramp nor profile is on"
            )

    @property
    def _near_c(self) -> float:
        """Tolerance between two registers of the same set point, °C."""
        return 2 * self._map["setpoint"].tolerance(self._config.decimals)
