"""The controller's side of the guardian: start it, dismiss it, read what it left."""

import fcntl
import json
import logging
import os
import select
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import TracebackType

import sqlalchemy as sa

from drivers.errors import LinkError
from drivers.station import ChamberConfig
from thermo import guardian
from thermo.store import Store

log = logging.getLogger(__name__)

START_S = 30.0  # a loaded machine may take its time to import
LEAVE_S = 10.0


class Guardian:
    """A running guardian; left without `dismiss`, or by dying, it makes the chamber safe.

    Parameters
    ----------
    chamber : ChamberConfig
    result_path : Path
        Where it leaves its result.
    retry_s : float
        Real seconds for which it tries a chamber that does not answer.

    Raises
    ------
    LinkError
        If it does not report itself ready.
    """

    def __init__(
        self, chamber: ChamberConfig, result_path: Path, *, retry_s: float = guardian.RETRY_S
    ) -> None:
        charge = guardian.Charge(
            chamber=chamber,
            safe_temp_c=chamber.safe_temp_c,
            result_path=result_path.resolve(),
            retry_s=retry_s,
        )
        self.result_path = charge.result_path
        self._process = subprocess.Popen(
            [sys.executable, "-m", "thermo.guardian"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            cwd="/",
            env=os.environ | {"PYTHONPATH": str(Path(guardian.__file__).parents[1])},
        )
        try:
            self._say(charge.line().encode() + b"\n")
            self._wait_until_ready()
        except BaseException:
            self._process.kill()
            self._leave()
            raise

    @property
    def pid(self) -> int:
        """The guardian's process id."""
        return self._process.pid

    def dismiss(self) -> None:
        """Tell it that there is nothing left to do; harmless when it is gone or done twice."""
        if self._process.returncode is not None:
            return
        try:
            self._say(guardian.DONE)
        except OSError:
            log.warning("the guardian was gone before it was dismissed")
        self._leave()

    def leave_to_it(self) -> None:
        """Hand the chamber over: it makes it safe now, also after this process has ended."""
        pipe, output = self._process.stdin, self._process.stdout
        for end in (pipe, output):
            if end is not None:
                end.close()
        # it outlives us on purpose; without this Popen complains of it when collected
        self._process.returncode = 0

    def __enter__(self) -> "Guardian":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._process.returncode is None:
            self.leave_to_it()

    def _say(self, text: bytes) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(text)
        self._process.stdin.flush()

    def _wait_until_ready(self) -> None:
        assert self._process.stdout is not None
        ready, _, _ = select.select([self._process.stdout], [], [], START_S)
        said = self._process.stdout.readline().decode().strip() if ready else "nothing"
        if said != guardian.READY:
            raise LinkError(
                f"guardian: said {said or 'nothing'!r}, {guardian.READY!r} was expected in "
                f"{START_S:g} s; without it the chamber is not commanded"
            )

    def _leave(self) -> None:
        for end in (self._process.stdin, self._process.stdout):
            if end is not None:
                try:
                    end.close()
                except OSError:
                    log.debug("the guardian's pipe was broken already")
        try:
            self._process.wait(LEAVE_S)
        except subprocess.TimeoutExpired:
            log.warning("the guardian does not leave; it is ended")
            self._process.kill()
            self._process.wait()


def result_file(store_url: str | Path, test_id: str) -> Path:
    """Return where the guardian of a test leaves its result.

    Beside an SQLite store; for a store on a server in the user's state directory.
    """
    text = str(store_url)
    if "://" in text and not text.startswith("sqlite"):
        state = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local/state")
        folder = Path(state) / "accelbench"
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            folder = Path(tempfile.gettempdir())
        return folder / f"{test_id}.guardian.json"
    database = sa.make_url(text).database if text.startswith("sqlite") else text
    path = Path(database or "store")
    return path.with_name(f"{path.name}.{test_id}.guardian.json")


def collect_result(store: Store, test_id: str, path: Path) -> bool | None:
    """Enter what a guardian has left into the store's events, once.

    Parameters
    ----------
    store : Store
    test_id : str
    path : Path
        As `result_file` gives it.

    Returns
    -------
    bool or None
        Whether the guardian verified the safe condition; None when it has left nothing.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return None
    try:
        data = json.loads(text)
        verified, steps = bool(data["verified"]), "; ".join(str(step) for step in data["steps"])
        told = f"{data['utc']}: {data['why']}; {steps}"
    except (ValueError, KeyError, TypeError):
        verified, told = False, f"its result file {path} is damaged"
    store.log_event(test_id, None, None, "guardian" if verified else "guardian: not safe", told)
    path.unlink(missing_ok=True)
    return verified


def wait_for_guardian(chamber: ChamberConfig, patience_s: float = 60.0) -> None:
    """Wait until no guardian works on a chamber any more: two masters would fight for it.

    Raises
    ------
    LinkError
        If one still does after `patience_s` real seconds.
    """
    lock = guardian.open_lock(chamber.url)
    give_up_s = time.monotonic() + patience_s
    try:
        while True:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                if time.monotonic() > give_up_s:
                    raise LinkError(
                        f"chamber {chamber.url}: another test runs on it, or a guardian still "
                        f"tries to make it safe; see to the chamber first"
                    ) from None
                time.sleep(0.1)
            else:
                return
    finally:
        os.close(lock)
