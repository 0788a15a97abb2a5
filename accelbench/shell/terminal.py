"""Standard output and standard error, whatever becomes of whoever reads them.

A reader that goes away, a full disk and a closed stream never raise: what was written so far is
theirs, the rest is dropped and `OutputStream.lost` says why. A command that must not wait for
anybody detaches its terminal: from then on all text is written by a thread.
"""

import contextlib
import errno
import io
import os
import select
import signal
import sys
import threading
from collections.abc import Callable, Mapping
from typing import Any, TextIO

from thermo.station.observers.detached import Kind, ObserverWorker, counted

PIECE = 4096  # bytes written at a time: whoever reads slowly is seen to move
# a terminal that was hung up; of a file EIO is a fault of its disk
HUNG_UP = (errno.EIO, errno.ENXIO)


class OutputStream:
    """Destination of a stream's text.

    Parameters
    ----------
    stream : file or None
        None is a stream that was closed before the program began.
    name : str
        For messages.

    Attributes
    ----------
    lost : str
        Why text no longer arrives; empty as long as it does.
    complaint : str
        The same when it is nobody's wish, a full disk for instance.
    encoding : str
    is_terminal : bool
    """

    def __init__(self, stream: TextIO | None, name: str) -> None:
        self.lost = self.complaint = ""
        self.moved: Callable[[], None] = lambda: None
        self._stream = stream
        self._name = name
        self._fd = _descriptor(stream)
        self.encoding = getattr(stream, "encoding", None) or "utf-8"
        self.is_terminal = bool(stream is not None and stream.isatty())

    @property
    def fd(self) -> int | None:
        """The file descriptor; None when there is none."""
        return self._fd

    def write(self, text: str) -> None:
        """Write, waiting as long as it takes; nothing is raised."""
        if self._stream is None or self.lost:
            return
        try:
            if self._fd is None:
                self._stream.write(text)
                self._stream.flush()
            else:
                self._write_bytes(self._fd, text.encode(self.encoding, "backslashreplace"))
        except (OSError, ValueError) as err:
            self._lose(err)

    def same_place(self, other: "OutputStream") -> bool:
        """Return whether both go to one terminal, pipe or file."""
        if self._fd is None or other.fd is None:
            return False
        try:
            return os.path.samestat(os.fstat(self._fd), os.fstat(other.fd))
        except OSError:
            return False

    def _write_bytes(self, fd: int, data: bytes) -> None:
        while data:
            try:
                data = data[os.write(fd, data[:PIECE]) :]
            except BlockingIOError:  # somebody else made it so that it does not wait
                select.select([], [fd], [])
            self.moved()

    def _lose(self, err: Exception) -> None:
        why = getattr(err, "strerror", None) or str(err)
        self.lost = f"{self._name}: {why}"
        code = getattr(err, "errno", None)
        if code != errno.EPIPE and not (self.is_terminal and code in HUNG_UP):
            self.complaint = f"{self._name}: cannot be written: {why}"
        if self._fd is not None:
            # the interpreter finds nothing to complain of when it flushes at its end
            with contextlib.suppress(OSError):
                null = os.open(os.devnull, os.O_WRONLY)
                os.dup2(null, self._fd)
                os.close(null)


class Stream(io.TextIOBase):
    """Replacement of `sys.stdout` or `sys.stderr`; what it is given goes to its channel."""

    def __init__(self, channel: OutputStream, kind: Kind) -> None:
        self.channel = channel
        self._kind: Kind = kind
        self._worker: ObserverWorker | None = None
        self._show: Callable[[str], None] = channel.write
        self._begun = ""
        self._lock = threading.RLock()  # never held while anything is written

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """Return the value of the stream that it replaces."""
        return self.channel.encoding

    @property
    def errors(self) -> str:  # type: ignore[override]
        """No text is refused."""
        return "backslashreplace"

    def isatty(self) -> bool:
        """Return whether somebody looks at a terminal."""
        return self.channel.is_terminal

    def fileno(self) -> int:
        """Return the file descriptor."""
        if self.channel.fd is None:
            raise io.UnsupportedOperation("fileno")
        return self.channel.fd

    def writable(self) -> bool:
        """Return True."""
        return True

    def write(self, text: str, /) -> int:
        """Write, or hand whole lines over to the thread that does."""
        if self._worker is None:
            self.channel.write(text)
            return len(text)
        with self._lock:
            whole, newline, self._begun = (self._begun + text).rpartition("\n")
        self._post(whole + newline)
        return len(text)

    @property
    def buffer(self) -> "_Bytes":
        """Binary side of the stream: the shell's completion is written to it."""
        return _Bytes(self)

    def flush(self) -> None:
        """Hand over what has no end of line yet."""
        if self._worker is not None:
            with self._lock:
                rest, self._begun = self._begun, ""
            self._post(rest)

    def detach_to(self, worker: ObserverWorker) -> None:
        """Let a thread write from now on."""
        self._worker = worker
        self.channel.moved = worker.moved

    def show_by(self, show: Callable[[str], None] | None) -> None:
        """Let the thread's text go through a display that is being drawn; None ends that."""
        self._show = show or self.channel.write

    def show(self, text: str) -> None:
        """Write from within the thread that may wait."""
        self._show(text)

    def _post(self, text: str) -> None:
        if text and self._worker is not None:
            self._worker.post(lambda: self.show(text), self._kind)


class _Bytes(io.RawIOBase):
    """The stream for whoever writes bytes."""

    def __init__(self, stream: Stream) -> None:
        self._stream = stream

    def writable(self) -> bool:
        """Return True."""
        return True

    def write(self, data: Any, /) -> int:
        """Write text that was encoded."""
        self._stream.write(bytes(data).decode(self._stream.encoding, "replace"))
        return len(data)


class Terminal:
    """Both standard streams while a command runs; a context manager that stands in for them."""

    def __init__(self) -> None:
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(AttributeError, OSError, ValueError):
                stream.flush()
        self._before = sys.stdout, sys.stderr
        self.out = Stream(OutputStream(sys.stdout, "standard output"), "result")
        self.err = Stream(OutputStream(sys.stderr, "standard error"), "line")
        self.worker: ObserverWorker | None = None
        self._workers: list[ObserverWorker] = []

    def __enter__(self) -> "Terminal":
        sys.stdout, sys.stderr = self.out, self.err
        return self

    def __exit__(self, *_: object) -> None:
        sys.stdout, sys.stderr = self._before

    def detach(self) -> ObserverWorker:
        """Let a thread write from now on, and return it; nothing that is printed waits any more.

        Results on standard output are all kept, lines on standard error up to a number. Each
        stream has its own thread unless both go to the same place: one that stands still does not
        keep the other's text back.
        """
        if self.worker is None:
            self._workers = [ObserverWorker("standard error", self._tell_dropped)]
            if not self.out.channel.same_place(self.err.channel):
                self._workers.append(ObserverWorker("standard output", self._tell_dropped))
            self.worker = self._workers[0]
            self.err.detach_to(self.worker)
            self.out.detach_to(self._workers[-1])
            if threading.current_thread() is threading.main_thread():
                # a job in the background of a terminal with `stty tostop` would be stopped by it
                signal.signal(signal.SIGTTOU, signal.SIG_IGN)
        return self.worker

    def drain(self, still_s: float) -> bool:
        """Write what is left, and return whether all of it was.

        Parameters
        ----------
        still_s : float
            A detached stream is given up when nothing has moved for so many real seconds.
        """
        self.out.flush()
        self.err.flush()
        return all([worker.drain(still_s) for worker in self._workers])

    def close(self, still_s: float) -> bool:
        """Write what is left as `drain` does, and end the threads."""
        self.drain(still_s)
        return all([worker.close(still_s) for worker in self._workers])

    def _tell_dropped(self, dropped: Mapping[Kind, int]) -> None:
        shown: tuple[Kind, ...] = ("line", "event")  # readings are shown to nobody here
        missed: dict[Kind, int] = {kind: dropped[kind] for kind in shown if kind in dropped}
        if missed:
            self.err.show(
                f"accelbench: the terminal did not accept output; not shown: {counted(missed)}\n"
            )


def open_closed_descriptors() -> None:
    """Give the three standard descriptors something to be when they were closed at the start.

    The next file that is opened would take a free one, and be written into by whatever prints.
    """
    for fd in (0, 1, 2):
        try:
            os.fstat(fd)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest that is free: this one


def _descriptor(stream: TextIO | None) -> int | None:
    try:
        return stream.fileno() if stream is not None else None
    except (OSError, ValueError, AttributeError):
        return None
