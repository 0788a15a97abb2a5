"""Supervision of a running test: limits of the readings and of instrument failures."""

import logging
import math
from dataclasses import dataclass, field

from drivers.errors import InstrumentError
from thermo.planning.plan import Plan
from thermo.station.checks.quality import STEP_C, Repetition
from thermo.station.outcome import (
    ChamberAlarmError,
    InstrumentLostError,
    LimitTrippedError,
    ThermistorLostError,
    TooHotError,
)

log = logging.getLogger(__name__)

MOVED_C = 0.05  # a reading with a smaller change counts as stuck
OVERSHOOT_C = 5.0  # an ordinary overshoot is smaller; a runaway soon exceeds it
CONFIRM = 2  # consecutive readings of an accelerometer's thermistor before the test ends


@dataclass(slots=True)
class FailureBudget:
    """Counts the consecutive failures of one instrument and raises after too many."""

    name: str
    max_failures: int
    max_failure_s: float
    total: int = 0
    _in_row: int = 0
    _since_s: float = 0.0

    def succeeded(self) -> None:
        """Forget the failures before."""
        self._in_row = 0

    def failed(self, now_s: float, err: InstrumentError) -> None:
        """Count a failure.

        Raises
        ------
        InstrumentLostError
            After too many failures, or if the first of them is too long ago.
        """
        self.total += 1
        self._in_row += 1
        if self._in_row == 1:
            self._since_s = now_s
        for_s = now_s - self._since_s
        log.warning("%s failed, %d in a row: %s", self.name, self._in_row, err)
        if self._in_row >= self.max_failures or for_s > self.max_failure_s:
            raise InstrumentLostError(
                f"{self.name} lost: {self._in_row} failures in a row over {for_s:.0f} s, "
                f"the last: {err}"
            )


@dataclass(slots=True)
class LimitWatch:
    """Checks readings against the limits of the sequence; every check raises `LimitTrippedError`.

    Deviation and a stuck reading are checked against the programme, so `expect` must be called when
    the programme jumps (a step, the return after a gap).
    """

    plan: Plan
    _deviant_since_s: float | None = None
    _patient_until_s: float = -math.inf
    _anchor: tuple[float, float] | None = None
    _hot: dict[str, int] = field(default_factory=dict[str, int])
    _lost: dict[str, int] = field(default_factory=dict[str, int])
    _repeated: dict[str, Repetition] = field(default_factory=dict[str, Repetition])

    def expect(self, now_s: float, step_c: float) -> None:
        """Allow the chamber its usual time for a step of `step_c`."""
        rate = self.plan.sequence.temperature.approach_c_per_min
        self._patient_until_s = now_s + 60 * abs(step_c) / rate
        self._deviant_since_s = None
        self._anchor = None

    def chamber(self, temp_c: float) -> None:
        """Check the chamber's reading against the absolute limits."""
        low, high = self.plan.chamber_limits_c
        # a chamber at a limit of the sequence overshoots it slightly
        margin = min(self.plan.sequence.limits.max_deviation_c, OVERSHOOT_C)
        if not low - margin <= temp_c <= high + margin:
            kind = TooHotError if temp_c > high else LimitTrippedError
            raise kind(
                f"chamber at {temp_c:.1f} °C, more than {margin:g} °C outside {low:g}…{high:g} °C"
            )

    def programme(self, now_s: float, temp_c: float, commanded_c: float) -> None:
        """Check the chamber's reading against the programme."""
        limits = self.plan.sequence.limits
        self._check_stuck(temp_c, commanded_c)
        off_c = temp_c - commanded_c
        if abs(off_c) <= limits.max_deviation_c or now_s < self._patient_until_s:
            self._deviant_since_s = None
            return
        if self._deviant_since_s is None:
            self._deviant_since_s = now_s
        for_s = now_s - self._deviant_since_s
        if for_s >= 60 * limits.max_deviation_min:
            raise LimitTrippedError(
                f"chamber at {temp_c:.1f} °C, {abs(off_c):.1f} °C from the programme's "
                f"{commanded_c:.1f} °C for {for_s / 60:.1f} min; {limits.max_deviation_c:g} °C for "
                f"{limits.max_deviation_min:g} min are allowed"
            )

    def _check_stuck(self, temp_c: float, commanded_c: float) -> None:
        if self._anchor is None or abs(temp_c - self._anchor[0]) > MOVED_C:
            self._anchor = (temp_c, commanded_c)
            return
        moved_c = abs(commanded_c - self._anchor[1])
        if moved_c > self.plan.sequence.limits.stuck_c:
            raise LimitTrippedError(
                f"chamber's reading stuck at {temp_c:.2f} °C while the programme moved by "
                f"{moved_c:.1f} °C; {self.plan.sequence.limits.stuck_c:g} °C are allowed"
            )

    def accelerometer(self, serial: str, temp_c: float, chamber_c: float) -> None:
        """Check an accelerometer's own temperature against its limits.

        Parameters
        ----------
        serial : str
        temp_c : float
            Of its thermistor, °C; nan when there was no reading.
        chamber_c : float
            Of the chamber, °C; nan when there was no reading.

        Raises
        ------
        LimitTrippedError
            When it is outside for the second time in a row.
        ThermistorLostError
            After too many consecutive missing readings, or if the thermistor repeats its last digit
            while the chamber changes: the limits then do not protect. The count is then reset.
        """
        self._check_lost(serial, temp_c, chamber_c)
        low, high = self.plan.accelerometer_limits_c
        if math.isnan(temp_c) or low <= temp_c <= high:
            self._hot.pop(serial, None)
            return
        self._hot[serial] = self._hot.get(serial, 0) + 1
        if self._hot[serial] >= CONFIRM:
            kind = TooHotError if temp_c > high else LimitTrippedError
            raise kind(f"accelerometer {serial} at {temp_c:.1f} °C, outside {low:g}…{high:g} °C")

    def _check_lost(self, serial: str, temp_c: float, chamber_c: float) -> None:
        self._lost[serial] = self._lost.get(serial, 0) + 1 if math.isnan(temp_c) else 0
        repeated = self._repeated.setdefault(serial, Repetition(STEP_C)).see(temp_c, chamber_c)
        times = self._lost[serial]
        if times < self.plan.sequence.limits.max_thermistor_losses and not repeated:
            return
        self._lost.pop(serial)
        self._repeated.pop(serial)
        why = f"repeats {temp_c:.4f} °C while the chamber moves" if repeated else "gave no reading"
        raise ThermistorLostError(
            f"accelerometer {serial}: its thermistor {why}"
            + ("" if repeated else f", {times} times in a row")
            + "; its temperature limit no longer protects"
        )

    def alarms(self, alarms: tuple[str, ...]) -> None:
        """End the test on any alarm of the chamber."""
        if alarms:
            raise ChamberAlarmError(f"chamber alarm: {'; '.join(alarms)}")
