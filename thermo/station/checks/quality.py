"""Checks on a running test's readings that show faults of its instruments.

A head that does not turn, a meter that repeats itself, and missing or flagged readings do not end a
test. They are reported at once and again at its end.
"""

import math
from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from thermo.planning.plan import Plan
from thermo.store.records import ReadingRow
from thermo.store.store import Store

OFF_POSITION_DEG = 0.5  # a head this far from the commanded angle has not arrived
HEAD_STUCK = 3  # readings away from the commanded angle while it did not move

# Between two readings whose specific force differs by this, a working output differs by a
# hundredth of its scale factor: a misalignment of 1 mrad reduces this by a fifth at most, and the
# rest is a thousand steps of a 6½-digit meter. A repetition cannot be due to chance.
STEP_G = 0.01
# A chamber needs 12 s at least for 1 °C (5 °C/min). An inside that is two lags of 300 s behind it
# has then moved by 12²/(2·300²) °C = 0.8 m°C, thirty steps of a meter that reads 10 kΩ to 10 mΩ.
STEP_C = 1.0
REPEATED = 3  # repetitions: one may be an old answer taken for a new one

WINDOW = 50  # slots for the share while the test runs
ENOUGH = 20  # fewer slots do not determine a share of a tenth


@dataclass(slots=True)
class Repetition:
    """Counts repetitions of a value to the last digit although its cause has changed."""

    step: float
    _value: float = math.nan
    _cause: float = math.nan
    _times: int = 0

    def see(self, value: float, cause: float) -> bool:
        """Add a value and return True after too many repetitions; nan resets the count."""
        if value != self._value:
            self._value, self._cause, self._times = value, cause, 0
        elif math.isnan(self._cause):
            self._cause = cause
        elif abs(cause - self._cause) >= self.step:
            self._cause = cause
            self._times += 1
        return self._times >= REPEATED


@dataclass(slots=True)
class HeadWatch:
    """Notices a head that stays at one angle although it was sent elsewhere."""

    _stays_deg: float = math.nan
    _away: int = 0

    def see(self, position_deg: float, sent_deg: float) -> bool:
        """Add the next angle; return True if it stayed away from the commanded one."""
        if not abs(position_deg - self._stays_deg) <= OFF_POSITION_DEG:
            self._stays_deg, self._away = position_deg, 0
        if abs(position_deg - sent_deg) > OFF_POSITION_DEG:
            self._away += 1
        return self._away >= HEAD_STUCK


@dataclass(slots=True)
class Quality:
    """Checks the readings of one session; every method returns each fault once."""

    serials: tuple[str, ...]
    mount_deg: dict[str, float]
    max_bad_share: float
    _head: HeadWatch = field(default_factory=HeadWatch)
    _outputs: dict[str, Repetition] = field(default_factory=dict[str, Repetition])
    _windows: dict[str, deque[bool]] = field(default_factory=dict[str, deque[bool]])
    _told: set[str] = field(default_factory=set[str])

    def see_head(self, position_deg: float, sent_deg: float) -> list[str]:
        """Compare the angle of the head with the commanded one, °."""
        if not self._head.see(position_deg, sent_deg):
            return []
        return self._once(
            "head", f"head stays at {position_deg:.3f}° although it was sent elsewhere"
        )

    def see_rows(self, rows: Sequence[ReadingRow]) -> list[str]:
        """Compare each output with the preceding one at another position."""
        found: list[str] = []
        for row in rows:
            repetition = self._outputs.setdefault(row.serial, Repetition(STEP_G))
            output = math.nan if row.output is None else row.output
            angle_deg = math.nan if row.position_deg is None else row.position_deg
            force_g = math.sin(math.radians(angle_deg + self.mount_deg[row.serial]))
            if repetition.see(output, force_g):
                found += self._once(
                    f"output {row.serial}",
                    f"accelerometer {row.serial}: output {output:.9g} is repeated to the last "
                    f"digit at positions that differ by {STEP_G:g} g and more",
                )
        return found

    def see_shares(self, rows: Sequence[ReadingRow]) -> list[str]:
        """Count one slot as read."""
        flagged = {row.serial: bool(row.flag) for row in rows}
        return self._count([flagged.get(serial, True) for serial in self.serials])

    def see_missed(self, slots: int) -> list[str]:
        """Count slots as missed."""
        found: list[str] = []
        for _ in range(min(slots, WINDOW)):
            found += self._count([True] * len(self.serials))
        return found

    def _count(self, bad: Sequence[bool]) -> list[str]:
        found: list[str] = []
        for serial, one in zip(self.serials, bad, strict=True):
            window = self._windows.setdefault(serial, deque(maxlen=WINDOW))
            window.append(one)
            if len(window) >= ENOUGH and sum(window) > self.max_bad_share * len(window):
                text = f"{sum(window)} of the last {len(window)} slots missed or flagged"
                found += self._once(f"share {serial}", f"accelerometer {serial}: {text}")
        return found

    def _once(self, key: str, text: str) -> list[str]:
        if key in self._told:
            return []
        self._told.add(key)
        return [text]


def find_bad_shares(
    store: Store, test_id: str, plan: Plan, heartbeat: Callable[[], None]
) -> list[str]:
    """Return every accelerometer with too few usable readings in the completed runs.

    Parameters
    ----------
    store : Store
        Contains the readings, including those of earlier sessions.
    test_id : str
    plan : Plan
        Plan of the test; `limits.max_bad_share` of its sequence is the limit.
    heartbeat : callable
        Called before each run is read.

    Returns
    -------
    list of str
        One line each.
    """
    done = [run.number for run in store.test(test_id).runs if run.status == "finished"]
    good: Counter[str] = Counter()
    for number in done:
        heartbeat()
        readings = store.readings(test_id, number)
        good.update(readings.serial[(readings.flag == "") & (readings.voided == "")])
    slots = plan.slots * len(done)
    limit = plan.sequence.limits.max_bad_share
    return [
        f"accelerometer {a.serial}: {slots - good[a.serial]} of {slots} slots missed or flagged, "
        f"{limit:.0%} are allowed"
        for a in plan.sequence.accelerometers
        if slots - good[a.serial] > limit * slots
    ]
