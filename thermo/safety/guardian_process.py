"""A guardian's process as its controller sees it: start it, beat, hear it, dismiss it."""

import contextlib
import logging
import os
import select
import socket
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

from drivers.errors import LinkError
from thermo.safety import guardian
from thermo.safety.chamber_lock import ChamberLock
from thermo.safety.guardian import Charge

log = logging.getLogger(__name__)

START_S = 30.0  # a loaded machine may take its time to import
LEAVE_S = 10.0
ANSWER_S = 10.0  # a guardian that answers no beat for so long is stopped or hung


def prove_startable() -> None:
    """See that a guardian's process can be started; it is given nothing to guard, and leaves.

    Raises
    ------
    LinkError
        If it cannot.
    """
    mine, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    try:
        process = _spawn(theirs, ())
    finally:
        theirs.close()
        mine.close()  # it finds nobody, and so nothing to do
    try:
        code = process.wait(START_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        raise LinkError(f"guardian: did not start in {START_S:g} s") from None
    if code:
        raise LinkError(f"guardian: its process ended with code {code} before it had begun")


def _spawn(channel: socket.socket, fds: tuple[int, ...]) -> subprocess.Popen[bytes]:
    """Start the process; `channel` becomes its standard input."""
    environment = os.environ | {"PYTHONPATH": str(Path(guardian.__file__).parents[2])}
    environment.pop("NOTIFY_SOCKET", None)  # only the controller speaks for the service
    try:
        return subprocess.Popen(
            [sys.executable, "-m", "thermo.safety.guardian"],
            stdin=channel.fileno(),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            cwd="/",
            env=environment,
            pass_fds=fds,
        )
    except OSError as err:
        raise LinkError(f"guardian: cannot be started: {err.strerror or err}") from None


class Guardian:
    """A running guardian; left without `dismiss`, or by dying, it makes the chamber safe.

    Parameters
    ----------
    charge : Charge
    lock : ChamberLock, optional
        The chamber's, which it then holds as well.

    Raises
    ------
    LinkError
        If it cannot be started.
    """

    def __init__(self, charge: Charge, lock: ChamberLock | None = None) -> None:
        fds = () if lock is None else lock.fds
        self.result_path = charge.result_path.resolve()
        self.ready = self.gone = False
        self.fence = ""  # why it took over
        self.refusal = ""
        self.began_s = time.monotonic()
        self._sent = self._answered = 0
        self._unanswered_s: float | None = None  # since when a beat waits for its answer
        self._channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            self._process = _spawn(theirs, fds)
        except LinkError:
            self._channel.close()
            raise
        finally:
            theirs.close()
        self._say(replace(charge, result_path=self.result_path, lock_fds=fds).message())

    @property
    def pid(self) -> int:
        """The guardian's process id."""
        return self._process.pid

    def wait_until_ready(self) -> None:
        """Wait until it has reported itself ready.

        Raises
        ------
        LinkError
            If it does not; it is ended.
        """
        give_up_s = self.began_s + START_S
        while not self.ready:
            left_s = give_up_s - time.monotonic()
            if self.gone or left_s <= 0:
                said = self.refusal or ("nothing" if self.gone else f"nothing in {START_S:g} s")
                self.kill()
                raise LinkError(
                    f"guardian: said {said}, {guardian.READY.decode()!r} was expected; without it "
                    "the chamber is not commanded"
                )
            select.select([self._channel], [], [], left_s)
            self.hear()

    def beat(self) -> None:
        """Send a beat that is to be answered; never waits."""
        self._sent += 1
        if self._unanswered_s is None:
            self._unanswered_s = time.monotonic()
        self._say(b"%s %d" % (guardian.BEAT, self._sent))

    def hear(self) -> None:
        """Take what it has said since; never waits."""
        while not self.gone:
            try:
                message = self._channel.recv(guardian.MESSAGE_BYTES, socket.MSG_DONTWAIT)
            except BlockingIOError:
                break
            except OSError:
                message = b""
            word, _, rest = message.partition(b" ")
            if word == guardian.READY:
                self.ready, self._unanswered_s = True, None
            elif word == guardian.ALIVE:
                self._answered = max(self._answered, int(rest))
            elif word == guardian.FENCED:
                self.fence = rest.decode(errors="replace")
            elif word == guardian.CANNOT:
                self.refusal = rest.decode(errors="replace")
            elif not message:
                self.gone = True
        if self._answered >= self._sent:
            self._unanswered_s = None
        self.gone = self.gone or self._process.poll() is not None

    @property
    def trouble(self) -> str:
        """Trouble with it as far as has been heard; empty when there is none."""
        now_s = time.monotonic()
        if self.gone:
            return f"the guardian, process {self.pid}, has ended" + (
                f": {self.refusal}" if self.refusal else ""
            )
        if not self.ready:
            return "a guardian did not start" if now_s - self.began_s > START_S else ""
        if self._unanswered_s is not None and now_s - self._unanswered_s > ANSWER_S:
            return (
                f"the guardian, process {self.pid}, does not answer the heartbeat (stopped or hung)"
            )
        return ""

    def see_fence(self) -> None:
        """Tell it that its fence was seen: nothing more is commanded from here."""
        self._say(guardian.FENCE_SEEN)

    def dismiss(self) -> None:
        """Tell it that there is nothing left to do; harmless when it is gone or done twice."""
        if self._process.returncode is not None:
            return
        self._say(guardian.DONE)
        try:
            self._process.wait(LEAVE_S)
        except subprocess.TimeoutExpired:
            log.warning("the guardian does not exit; it is killed")
            self.kill()
        self.hear()  # whether it took over before it could read that
        self._channel.close()

    def leave_to_it(self) -> None:
        """Hand the chamber over: it makes it safe now, also after this process has ended."""
        self._say(guardian.LEFT)
        self._channel.close()
        # it outlives us on purpose; without this Popen complains of it when collected
        if self._process.poll() is None:
            self._process.returncode = 0

    def has_died(self, patience_s: float) -> bool:
        """Wait for it to leave, real s; return True if it did not go of its own accord."""
        try:
            return self._process.wait(patience_s) != 0
        except subprocess.TimeoutExpired:
            return False

    def kill(self) -> None:
        """End it, also when it is stopped."""
        self._process.kill()
        self._process.wait()
        self.hear()  # what it said before is still there
        self.gone = True
        self._channel.close()

    def __enter__(self) -> "Guardian":
        return self

    def __exit__(self, *_: object) -> None:
        if self._process.returncode is None:
            self.leave_to_it()

    def _say(self, message: bytes) -> None:
        """Say something; one that does not read is found out by `trouble`, not waited for."""
        with contextlib.suppress(OSError):
            self._channel.send(message, socket.MSG_DONTWAIT)
