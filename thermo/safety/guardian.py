"""A small process that makes the chamber safe when the controller is dead or silent.

The controller starts it before it tells the chamber anything and keeps the other end of a socket.
Through it the controller beats, and the guardian answers every beat. "done" means an orderly end.
The end of the socket without it (kill -9, the out-of-memory killer), or silence for longer than the
controller's longest legal step and a margin (hung, stopped, blocked in a call), make the guardian
take over: it says so to the controller, which commands nothing from then on, opens the chamber
itself, makes it safe, verifies, and tells its file. It never gives up. It is in a session of its
own, deaf to the terminal's signals, and holds the chamber's lock with its controller.
"""

import contextlib
import json
import logging
import os
import select
import signal
import socket
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drivers.chambers.open import open_chamber
from drivers.devices import Chamber, SafeResult
from drivers.errors import InstrumentError
from drivers.station import ChamberConfig
from thermo.safety.chamber_lock import ChamberLock
from thermo.safety.commanded_note import forget_commanded
from thermo.safety.guardian_record import Phase, RecordFile

log = logging.getLogger(__name__)

# what the two say to each other; a beat and its answer carry a number
BEAT, DONE, LEFT, FENCE_SEEN = b"beat", b"done", b"left to you", b"fence seen"
READY, ALIVE, FENCED, CANNOT = b"ready", b"alive", b"fenced", b"cannot"
MESSAGE_BYTES = 65536

LOOK_S = 1.0  # between two looks whether the parent still lives
FIRST_PAUSE_S, LONGEST_PAUSE_S = 2.0, 60.0  # between two attempts; each pause is half as long again
WATCH_S = 5.0  # between two looks at a chamber made safe beside a controller that may yet wake up
NEAR_C = 0.5  # coarser than any controller shows its set point
DEAF_TO = (
    signal.SIGINT,
    signal.SIGTERM,
    signal.SIGHUP,
    signal.SIGQUIT,
    signal.SIGPIPE,
    signal.SIGTSTP,
    signal.SIGTTIN,
    signal.SIGTTOU,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Charge:
    """Charge of a guardian: the first message it is given, as JSON.

    Attributes
    ----------
    chamber : ChamberConfig
    result_path : Path
        Where it tells what it did.
    limit_s : float
        How long the controller may be silent, real s.
    test_id : str
    recognition : mapping
        By what the controller was recognised, so that it is again when its sensor has failed.
    lock_fds : tuple of int
        Descriptors of the chamber's lock, inherited.
    """

    chamber: ChamberConfig
    result_path: Path
    limit_s: float
    test_id: str = ""
    recognition: Mapping[str, float | str] = field(default_factory=dict[str, float | str])
    lock_fds: tuple[int, ...] = ()

    def message(self) -> bytes:
        """Write the charge."""
        return json.dumps(
            {
                "chamber": self.chamber.model_dump(mode="json"),
                "result_path": str(self.result_path),
                "limit_s": self.limit_s,
                "test_id": self.test_id,
                "recognition": dict(self.recognition),
                "lock_fds": self.lock_fds,
            }
        ).encode()

    @classmethod
    def parse(cls, message: bytes) -> "Charge":
        """Read what `message` wrote."""
        data: Mapping[str, Any] = json.loads(message)
        return cls(
            chamber=ChamberConfig.model_validate(data["chamber"]),
            result_path=Path(data["result_path"]),
            limit_s=float(data["limit_s"]),
            test_id=str(data["test_id"]),
            recognition=dict(data["recognition"]),
            lock_fds=tuple(data["lock_fds"]),
        )


class GuardianWatch:
    """The guardian at work: one controller, one chamber, one file.

    Parameters
    ----------
    charge : Charge
    channel : socket
        To the controller.
    parent : int
        The controller's process id. It is looked at as well: should another process have
        inherited the channel's other end, the channel would outlive the controller.
    """

    def __init__(self, charge: Charge, channel: socket.socket, parent: int) -> None:
        self._charge = charge
        self._channel = channel
        self._parent = parent
        self._lock = ChamberLock.inherit(charge.lock_fds)
        self._heard_s = time.monotonic()
        self._done = self._left = self._gone = self._fence_seen = False
        self._phase: Phase = "watching"
        self._why = ""
        self._record = RecordFile(
            charge.result_path,
            {
                "chamber": charge.chamber.url,
                "safe_temp_c": charge.chamber.safe_temp_c,
                "test_id": charge.test_id,
                "controller_pid": parent,
            },
        )

    def run(self) -> int:
        """Watch until there is nothing left to do.

        Returns
        -------
        int
            0; it does not end before the chamber is safe.
        """
        self._say(READY)
        why = self.wait_for_end()
        if why is None:
            self._record.remove()
            return 0
        self._why = why
        # before the first byte to the chamber: from here on the controller commands nothing
        self._say(FENCED + b" " + why.encode())
        self._tell("taking over")
        self._make_safe()
        self._stay_until_let_go()
        forget_commanded(self._charge.chamber)
        return 0

    def wait_for_end(self) -> str | None:
        """Wait until the controller is done (None), or return why it has to be relieved."""
        limit_s = self._charge.limit_s
        while True:
            self._listen(min(LOOK_S, max(0.0, self._heard_s + limit_s - time.monotonic())))
            if self._done:
                return None
            if self._left:
                return "the controller could not make the chamber safe and left it to the guardian"
            if self._gone:
                return "the controller ended without making the chamber safe"
            silent_s = time.monotonic() - self._heard_s
            if silent_s >= limit_s:
                self._listen(0.0)  # it may have spoken while this process was not let run
                if self._done or time.monotonic() - self._heard_s < limit_s:
                    continue
                return f"the controller was silent for {silent_s:.1f} s, more than {limit_s:g} s"

    # ---- the chamber

    def _make_safe(self) -> None:
        """Make the chamber safe, again and again until it is."""
        pause_s, attempt = FIRST_PAUSE_S, 0
        while True:
            attempt += 1
            result = self._attempt()
            if result.verified:
                self._tell("safe", verified=True, steps=result.steps)
                return
            self._tell("trying", steps=(f"attempt {attempt}", *result.steps))
            self._idle(pause_s)
            pause_s = min(LONGEST_PAUSE_S, 1.5 * pause_s)

    def _attempt(self) -> SafeResult:
        try:
            with self._opened() as chamber:
                return chamber.make_safe(self._charge.chamber.safe_temp_c)
        except Exception as err:
            line = " ".join(str(err).split()) or type(err).__name__
            return SafeResult(verified=False, steps=(line,), commanded=False)

    def _opened(self) -> contextlib.closing[Chamber]:
        charge = self._charge
        return contextlib.closing(
            open_chamber(charge.chamber, recognition=charge.recognition or None)
        )

    def _stay_until_let_go(self) -> None:
        """Keep the chamber safe until the controller is gone or has seen the fence.

        It may have been stopped between asking for leave and writing; what it then writes on
        waking up is taken back here.
        """
        if self._gone or self._left:
            return
        while True:
            self._idle(WATCH_S)
            let_go = self._gone or self._fence_seen
            # a single register that slipped through may not show in the set point yet
            if let_go or self._touched():
                self._make_safe()
            if let_go:
                return

    def _touched(self) -> bool:
        """Return True if the chamber's set point is not, or cannot be seen to be, the safe one."""
        safe_c = self._charge.chamber.safe_temp_c
        try:
            with self._opened() as chamber:
                return abs(chamber.read_setpoint_c() - safe_c) > NEAR_C
        except InstrumentError as err:
            log.info("%s", err)
            return True

    # ---- the controller, and whoever asks

    def _idle(self, wait_s: float) -> None:
        """Wait, answering; cut short when the controller has let go."""
        end_s = time.monotonic() + wait_s
        before = self._gone or self._fence_seen
        while (left_s := end_s - time.monotonic()) > 0:
            self._listen(min(left_s, LOOK_S))
            if not before and (self._gone or self._fence_seen):
                return

    def _listen(self, wait_s: float) -> None:
        """Hear the controller and answer it, and tell who asks for the chamber."""
        heard = [] if self._gone else [self._channel]
        ready, _, _ = select.select([*heard, *self._lock.fds], [], [], wait_s)
        if self._channel in ready:
            self._hear()
        if len(ready) > (self._channel in ready):
            self._lock.tell(
                {
                    "test_id": self._charge.test_id,
                    "guardian_pid": os.getpid(),
                    "phase": self._phase,
                }
            )
        if os.getppid() != self._parent:
            self._gone = True

    def _hear(self) -> None:
        """Take every message that is there."""
        while True:
            try:
                message = self._channel.recv(MESSAGE_BYTES, socket.MSG_DONTWAIT)
            except BlockingIOError:
                return
            except OSError:
                message = b""
            if not message:
                self._gone = True
                return
            self._heard_s = time.monotonic()
            self._done = self._done or message == DONE
            self._left = self._left or message == LEFT
            # whatever it says when it ends, it commands nothing after it
            self._fence_seen = self._fence_seen or message in (FENCE_SEEN, DONE, LEFT)
            if message.startswith(BEAT):
                self._say(ALIVE + message[len(BEAT) :])

    def _say(self, message: bytes) -> None:
        """Say something; a controller that does not listen is not waited for."""
        with contextlib.suppress(OSError):
            self._channel.send(message, socket.MSG_DONTWAIT)

    def _tell(self, phase: Phase, *, verified: bool = False, steps: tuple[str, ...] = ()) -> None:
        self._phase = phase
        try:
            self._record.write(phase, why=self._why, verified=verified, steps=steps)
        except OSError as err:  # the chamber is more urgent than its file
            log.error("%s: %s", self._charge.result_path, err)


def run_guardian() -> int:
    """Watch over one controller; the channel to it is standard input.

    Returns
    -------
    int
        0 when nothing was left to do or the chamber is safe, 1 when it could not begin.
    """
    for number in DEAF_TO:
        signal.signal(number, signal.SIG_IGN)
    logging.basicConfig(level=logging.ERROR)
    parent = os.getppid()
    channel = socket.socket(fileno=os.dup(0))
    message = channel.recv(MESSAGE_BYTES)
    if not message:
        return 0  # the controller went before it had begun anything
    try:
        watch = GuardianWatch(Charge.parse(message), channel, parent)
    except (OSError, ValueError) as err:
        with contextlib.suppress(OSError):
            channel.send(CANNOT + b" " + str(err).encode())
        return 1
    return watch.run()


if __name__ == "__main__":
    sys.exit(run_guardian())
