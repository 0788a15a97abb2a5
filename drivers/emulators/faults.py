"""Planned misbehaviour of an emulated instrument.

A fault spoils replies (the wire misbehaves for the next `count` answers), is a state of the
instrument that lasts for a while, or is something that somebody does at its panel, once. All are
due by the emulation's clock; the pauses of a late or a split reply are in real seconds, since the
asker's timeout is.
"""

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast, get_args

from drivers.clock import Clock
from drivers.station import FaultConfig, FaultKind, PanelAction

REPLY_KINDS: frozenset[FaultKind] = frozenset(
    ("silence", "late_reply", "exception", "broken_crc", "split_frame", "dropped_connection")
)
STATE_KINDS: frozenset[FaultKind] = frozenset(
    ("stuck_temperature", "sensor_break", "over_temperature")
)
PANEL_KINDS: frozenset[FaultKind] = frozenset(get_args(PanelAction))
DEVICES = ("chamber", "digitiser", "head")


@dataclass(slots=True)
class _Pending:
    """A fault with its due time and what is left of it."""

    kind: FaultKind
    begin_s: float
    end_s: float  # of a state; inf: it lasts
    left: int  # replies still to spoil
    temp_c: float | None  # of a panel action


class FaultPlan:
    """Planned faults of one emulated instrument. Thread-safe.

    Parameters
    ----------
    configs : sequence of FaultConfig
        The planned faults of the whole station; those of other devices are passed over.
    device : str
        "chamber", "digitiser" or "head".
    clock : Clock
        The emulation's clock; `at_s` of a fault counts from the construction of the plan.
    late_s : float
        How late a late reply is and how long a split frame pauses at most, real seconds. It must
        be longer than the asker's timeout to do its work.

    Raises
    ------
    ValueError
        If `device` is none of the three or `late_s` is not positive.
    """

    def __init__(
        self, configs: Sequence[FaultConfig], device: str, clock: Clock, *, late_s: float = 1.5
    ) -> None:
        if device not in DEVICES:
            raise ValueError(f"device {device!r}: expected one of {', '.join(DEVICES)}")
        if not late_s > 0:
            raise ValueError(f"late_s {late_s} must be positive")
        self.late_s = late_s
        self._clock = clock
        self._lock = threading.Lock()
        start_s = clock.now_s()
        self._pending = [
            _pending(c.kind, start_s + c.at_s, c.count, c.duration_s, c.temp_c)
            for c in sorted(configs, key=lambda c: c.at_s)
            if c.device == device
        ]

    def inject(
        self,
        kind: FaultKind,
        *,
        count: int = 1,
        duration_s: float | None = None,
        temp_c: float | None = None,
    ) -> None:
        """Let a fault begin now.

        Parameters
        ----------
        kind : FaultKind
            What goes wrong.
        count : int
            Replies it spoils, for the kinds that spoil replies.
        duration_s : float or None
            How long a state lasts, s of the emulation's clock; None: until the end.
        temp_c : float or None
            Set point of something done at the panel, °C; None: the emulator's choice.

        Raises
        ------
        ValueError
            If the kind is unknown, `count` below 1 or `duration_s` not positive.
        """
        if kind not in get_args(FaultKind):
            raise ValueError(f"fault {kind!r}: expected one of {', '.join(get_args(FaultKind))}")
        if count < 1 or (duration_s is not None and not duration_s > 0):
            raise ValueError(f"fault {kind}: count {count} and duration {duration_s} must be > 0")
        with self._lock:
            self._pending.append(_pending(kind, self._clock.now_s(), count, duration_s, temp_c))

    def clear(self) -> None:
        """End every fault, also those still to come."""
        with self._lock:
            self._pending.clear()

    def take_reply_fault(self) -> FaultKind | None:
        """Consume one spoiled reply.

        Returns
        -------
        FaultKind or None
            What to do to the reply about to be sent; None: send it as it is. The fault that has
            been due longest goes first.
        """
        now_s = self._clock.now_s()
        with self._lock:
            due = [p for p in self._pending if p.left > 0 and p.begin_s <= now_s]
            if not due:
                return None
            first = min(due, key=lambda p: p.begin_s)
            first.left -= 1
            if first.left == 0:
                self._pending.remove(first)
            return first.kind

    def take_panel_actions(self) -> list[tuple[PanelAction, float | None]]:
        """Consume what somebody has done at the panel by now: kind and set point (°C), in order."""
        now_s = self._clock.now_s()
        with self._lock:
            due = [p for p in self._pending if p.kind in PANEL_KINDS and p.begin_s <= now_s]
            for done in due:
                self._pending.remove(done)
        due.sort(key=lambda p: p.begin_s)
        return [(cast(PanelAction, p.kind), p.temp_c) for p in due]

    def active(self, kind: FaultKind) -> bool:
        """Tell whether a state fault is on now.

        Raises
        ------
        ValueError
            If `kind` spoils replies and is no state.
        """
        if kind not in STATE_KINDS:
            raise ValueError(f"fault {kind!r} is not a state, use take_reply_fault")
        now_s = self._clock.now_s()
        with self._lock:
            return any(p.kind == kind and p.begin_s <= now_s < p.end_s for p in self._pending)


def _pending(
    kind: FaultKind, begin_s: float, count: int, duration_s: float | None, temp_c: float | None
) -> _Pending:
    """Return a fault ready to wait for its time."""
    end_s = float("inf") if duration_s is None else begin_s + duration_s
    return _Pending(kind, begin_s, end_s, count if kind in REPLY_KINDS else 0, temp_c)
