"""The process that works on the queue, started by the page and outliving it.

What it has to be told comes through its standard input, so that no password of a store stands in a
command line.
"""

import json
import signal
import subprocess
import sys
import threading
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType

from errormodel.errors import StoreError
from thermo.launch.notify import NoticeSender, read_notify
from thermo.launch.runner import Runner


@dataclass(slots=True)
class RunnerProcess:
    """Sees to it that somebody works on the queue.

    Parameters
    ----------
    store : str
    notify : Path, optional
        File that says who is told of alarms.
    """

    store: str
    notify: Path | None = None
    _process: subprocess.Popen[bytes] | None = field(default=None)

    def keep(self, *, there: bool) -> None:
        """Start a process if there is none; `there`: whether somebody works on the queue."""
        if self._process is not None and self._process.poll() is not None:
            self._process = None
        if there or self._process is not None:
            return
        order = {"store": self.store, "notify": str(self.notify) if self.notify else None}
        self._process = subprocess.Popen(
            [sys.executable, "-m", "accelbench.panel.runner_process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        assert self._process.stdin is not None
        with suppress(BrokenPipeError), self._process.stdin as pipe:
            pipe.write(json.dumps(order).encode())

    def stop(self) -> None:
        """End the process that was started here; tests that run go on."""
        if self._process is not None and self._process.poll() is None:
            self._process.terminate()
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(10.0)


def main() -> None:
    """Work on the queue, as `accelbench control serve` does, until SIGTERM."""
    order, stop = json.load(sys.stdin), threading.Event()
    notify = Path(order["notify"]) if order["notify"] else None

    def end(number: int, frame: FrameType | None) -> None:
        stop.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)
    # another one may have begun meanwhile: then this one is not needed
    with suppress(StoreError), NoticeSender(order["store"], read_notify(notify)):
        Runner(order["store"], notify=notify).run(stop)


if __name__ == "__main__":
    main()
