"""Start of a test in a process of its own, which outlives whoever started it.

The process is in a session of its own, away from any terminal, and nobody's child. What it has to
be told goes through its standard input, so that no password stands in a command line.
"""

import contextlib
import json
import os
import select
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from drivers.station import StationConfig
from errormodel.errors import WorkbenchError
from thermo.planning.sequence import parse_sequence, sequence_toml
from thermo.station.job import Job, make_job, make_resumed_job
from thermo.store.database import parse_store_url

# real seconds: instruments that do not answer at once, a guardian that is still making safe
START_S = 180.0


class NotStartedError(WorkbenchError):
    """The test did not begin; nothing was commanded."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Started:
    """A test that has begun: its id, and the process that runs it."""

    test_id: str
    pid: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """Order to a detached controller.

    Attributes
    ----------
    store_url : str
        A file's with its whole path.
    sequence_toml, station_json : str or None
        None: that of the store (of a resumed test), or the emulated station.
    resume : str or None
    speed : float or None
    take_over : bool
    planned : int or None
        The planned test that it is.
    notify : str or None
        The file that says who is told of its end.
    """

    store_url: str
    sequence_toml: str | None = None
    station_json: str | None = None
    resume: str | None = None
    speed: float | None = None
    take_over: bool = False
    planned: int | None = None
    notify: str | None = None

    def message(self) -> bytes:
        """Write the order."""
        return json.dumps(asdict(self)).encode()

    @classmethod
    def parse(cls, message: bytes) -> "Order":
        """Read what `message` wrote."""
        return cls(**json.loads(message))

    def job(self) -> Job:
        """Return the job.

        Raises
        ------
        InputError, StoreError
            As `make_job` and `make_resumed_job`.
        """
        given, text = self.station_json, self.sequence_toml
        station = None if given is None else StationConfig.model_validate_json(given)
        if self.resume is not None:
            return make_resumed_job(self.resume, self.store_url, station)
        return make_job(parse_sequence(text or ""), self.store_url, station)


def start_detached(
    job: Job,
    *,
    speed: float | None = None,
    take_over: bool = False,
    planned: int | None = None,
    notify: Path | None = None,
    patience_s: float = START_S,
) -> Started:
    """Start a test in a process of its own and wait until the store has it.

    Parameters
    ----------
    job : Job
    speed : float, optional
        Of emulated instruments, as for `thermo.launch.clocks.clock_of`.
    take_over : bool
        As for `thermo.launch.real.run_on_station`.
    planned : int, optional
        The planned test that it is; its row is kept up by the process itself.
    notify : Path, optional
        The file that says who is told of its end (`thermo.launch.notify`).
    patience_s : float
        Real seconds to wait; a test that begins later goes on all the same.

    Returns
    -------
    Started

    Raises
    ------
    NotStartedError
        With the reason why it did not begin, or that it has not said so in time.
    """
    order = Order(
        store_url=absolute_store(job.store_url),
        sequence_toml=None if job.resume else sequence_toml(job.sequence),
        station_json=None if job.emulated else job.station.model_dump_json(),
        resume=job.resume,
        speed=speed,
        take_over=take_over,
        planned=planned,
        notify=None if notify is None else str(notify.resolve()),
    )
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    environment.pop("NOTIFY_SOCKET", None)  # only the service's own process speaks for it
    reading, writing = os.pipe()
    try:
        with subprocess.Popen(
            [sys.executable, "-m", "thermo.launch.detached_controller"],
            stdin=subprocess.PIPE,
            stdout=writing,
            stderr=writing,
            start_new_session=True,
            cwd="/",
            env=environment,
        ) as process:
            os.close(writing)
            writing = -1
            with contextlib.suppress(BrokenPipeError):  # what it says tells why
                process.communicate(order.message())  # it leaves at once; its child goes on
        said = _hear(reading, patience_s)
    except OSError as err:
        raise NotStartedError(f"the controller cannot be started: {err.strerror}") from None
    finally:
        os.close(reading)
        if writing >= 0:
            os.close(writing)
    return _understood(said, patience_s)


def absolute_store(url: str) -> str:
    """Return a store's URL that means the same in whatever folder."""
    parsed = parse_store_url(url)
    if parsed.get_backend_name() != "sqlite":
        return url
    path = Path(str(parsed.database)).resolve()
    return str(path)


def _hear(pipe: int, patience_s: float) -> str | None:
    """Return what is said until the pipe is closed; None when that takes too long."""
    said, give_up_s = b"", time.monotonic() + patience_s
    while (left_s := give_up_s - time.monotonic()) > 0:
        if not select.select([pipe], [], [], left_s)[0]:
            break
        piece = os.read(pipe, 65536)
        if not piece:
            return said.decode(errors="replace")
        said += piece
    return None


def _understood(said: str | None, patience_s: float) -> Started:
    if said is None:
        raise NotStartedError(
            f"the controller has not said in {patience_s:g} s that the test has begun; it may "
            "still begin: see `accelbench control list`"
        )
    lines = said.strip().splitlines() or ["it said nothing"]
    answer: dict[str, Any] = {}
    with contextlib.suppress(ValueError):
        answer = dict(json.loads(lines[-1]))
    if "test_id" in answer:
        return Started(test_id=str(answer["test_id"]), pid=int(answer["pid"]))
    raise NotStartedError(str(answer.get("error") or f"the controller did not start: {lines[-1]}"))
