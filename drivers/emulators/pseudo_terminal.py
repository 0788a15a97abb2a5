"""A serial line with two ends in this machine, that can be hung up and come back."""

import contextlib
import errno
import os
import tempfile
import threading
import time
import tty
from pathlib import Path

WRITE_LIMIT_S = 2.0  # real: a reader that takes nothing for so long loses the rest


class PseudoTerminal:
    """A serial line whose far end is a path, as a USB adapter's link in /dev/serial is.

    Parameters
    ----------
    path : Path or None
        The symbolic link to make; one left by an emulator that was killed is replaced. None:
        in a directory of its own.

    Raises
    ------
    OSError
        If the link cannot be made, above all because something else, a real port perhaps, is
        there.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._directory = None if path else tempfile.TemporaryDirectory(prefix="accelbench-")
        self.path = path or Path(self._directory.name if self._directory else ".") / "tty"
        self._ends: tuple[int, int] | None = None
        self._device = ""
        self.replace()

    def replace(self) -> None:
        """Hang up and put a new line under the same path."""
        old = self._ends
        ours, theirs = os.openpty()
        # the other end stays open here too, else ours reads an error while nobody is there
        tty.setraw(theirs)
        os.set_blocking(ours, False)
        self._ends, self._device = (ours, theirs), os.ttyname(theirs)
        try:
            _place_link(self.path, self._device)
        except OSError:
            self.hang_up()
            raise
        finally:
            # only now: whoever finds the old line dead and opens the path again finds the new one
            _close(old)

    def fileno(self) -> int:
        """Return what to wait on; it changes with `replace`."""
        if self._ends is None:
            raise OSError("the line was hung up")
        return self._ends[0]

    def read(self) -> bytes:
        """Return what came; BlockingIOError when there is nothing."""
        return os.read(self.fileno(), 4096)

    def write(self, data: bytes) -> None:
        """Send; what a reader does not take in time is lost, as it is on a wire."""
        deadline_s = time.monotonic() + WRITE_LIMIT_S
        while data and time.monotonic() < deadline_s:
            try:
                data = data[os.write(self.fileno(), data) :]
            except BlockingIOError:
                time.sleep(0.001)

    def hang_up(self) -> None:
        """Let whoever has the far end find it dead; the link stays."""
        # forgotten before they are closed: the numbers may soon be somebody else's
        ends, self._ends = self._ends, None
        _close(ends)

    def close(self) -> None:
        """Hang up and remove the link, unless it is somebody else's by now; harmless twice."""
        with contextlib.suppress(OSError):
            if os.readlink(self.path) == self._device:
                self.path.unlink()
        self.hang_up()
        if self._directory is not None:
            self._directory.cleanup()


def _close(ends: tuple[int, int] | None) -> None:
    for end in ends or ():
        os.close(end)


def _place_link(path: Path, device: str) -> None:
    """Make or move the link in one step: the path leads somewhere at every moment."""
    if path.exists() and not path.is_symlink():
        raise FileExistsError(errno.EEXIST, "is no link left by an emulator", str(path))
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_name(f".{path.name}.{os.getpid()}.{threading.get_ident()}")
    fresh.symlink_to(device)
    fresh.replace(path)
