"""The process that works on the queue, started by the page and outliving it.

What it has to be told comes through its standard input, so that no password of a store stands in a
command line.
"""

import json
import logging
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from errormodel.errors import StoreError
from thermo.launch.runner import CLAIM
from thermo.store.store import open_store

log = logging.getLogger(__name__)


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
    """Work on the queue as `accelbench control serve` does."""
    from accelbench.commands.control.queue_work import serve

    order = json.load(sys.stdin)
    notify = order["notify"]
    with suppress(StoreError):
        with open_store(order["store"]) as store:
            if store.is_claimed(CLAIM):
                return
        serve(order["store"], Path(notify) if notify else None, as_json=False)


if __name__ == "__main__":
    main()
