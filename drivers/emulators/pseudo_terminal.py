"""A serial line with two ends in this machine, that can be hung up and come back."""

import os
import tempfile
import tty
from contextlib import suppress
from pathlib import Path


class PseudoTerminal:
    """A serial line whose far end is a path, as a USB adapter's link in /dev/serial is.

    Parameters
    ----------
    path : Path or None
        The symbolic link to make; None: "chamber" in a new temporary directory.

    Raises
    ------
    ValueError
        If something other than a symbolic link stands there, a real port above all.
    """

    def __init__(self, path: Path | None = None) -> None:
        if path is not None and path.exists() and not path.is_symlink():
            raise ValueError(f"{path} is there already and no symbolic link, expected a free path")
        self._directory = None if path else tempfile.TemporaryDirectory(prefix="accelbench-")
        self.path = path or Path(self._directory.name if self._directory else ".") / "chamber"
        self._ends: tuple[int, int] | None = None
        self.replace()

    def replace(self) -> None:
        """Hang up and put a new line under the same path."""
        old = self._ends
        ours, theirs = os.openpty()
        tty.setraw(theirs)
        os.set_blocking(ours, False)
        self._ends = (ours, theirs)
        fresh = self.path.with_name(self.path.name + ".new")
        fresh.unlink(missing_ok=True)
        fresh.symlink_to(os.ttyname(theirs))
        fresh.replace(self.path)  # in one move: the path leads somewhere at every moment
        for end in old or ():
            os.close(end)

    def fileno(self) -> int:
        """Return what to wait on; it changes with `replace`."""
        if self._ends is None:
            raise OSError("the line was hung up")
        return self._ends[0]

    def read(self) -> bytes:
        """Return what came."""
        with suppress(BlockingIOError):
            return os.read(self.fileno(), 4096)
        return b""

    def write(self, data: bytes) -> None:
        """Send; what a full line does not take is lost, as it is on a wire without a listener."""
        if self._ends is not None:
            with suppress(BlockingIOError):
                os.write(self._ends[0], data)

    def close(self) -> None:
        """Hang up for good; harmless when done twice."""
        ends, self._ends = self._ends, None
        for end in ends or ():
            os.close(end)
        with suppress(OSError):
            self.path.unlink()
        if self._directory is not None:
            self._directory.cleanup()
