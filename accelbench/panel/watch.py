"""The one reader of the store for all pages: it looks four times a second and tells what it saw."""

import logging
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from accelbench.panel.followed import FollowedTest
from errormodel.errors import InputError, StoreError, WorkbenchError
from thermo.launch.dead_controllers import is_gone, settle_dead_controllers
from thermo.launch.runner import CLAIM
from thermo.planning.sequence import parse_sequence
from thermo.store.operation.alarms import Alarm, list_alarms
from thermo.store.operation.commands import Command, list_commands
from thermo.store.operation.controllers import ControllerBeat, list_beats
from thermo.store.operation.notices import Notice, list_notices
from thermo.store.operation.planned import PlannedTest, list_planned
from thermo.store.records import TestSummary
from thermo.store.store import Store, open_store

log = logging.getLogger(__name__)

LOOK_S = 0.25
SETTLE_S = 1.0  # between two looks at whether controllers are gone
TESTS_S = 3.0  # between two looks at the list of all tests, which counts readings
FORGET_S = 60.0  # a test that no page has asked for so long is forgotten
NEWEST = 50  # commands shown


@dataclass(frozen=True, slots=True, kw_only=True)
class Snapshot:
    """Content of the store at the last look; replaced as a whole.

    Attributes
    ----------
    looked_s : float
        When, by `time.monotonic`.
    problem : str
        Why the store could not be read; empty when it could.
    beats : tuple of (ControllerBeat, bool)
        Every controller's last word, and whether its process is alive.
    alarms, notices : tuple
        Alarms that nobody has acknowledged; notices that have not been sent.
    serials : mapping of str to str
        The serial numbers of every test, in one text.
    runner : bool
        True if somebody works on the queue.
    """

    looked_s: float = 0.0
    problem: str = "the store has not been read yet"
    beats: tuple[tuple[ControllerBeat, bool], ...] = ()
    alarms: tuple[Alarm, ...] = ()
    planned: tuple[PlannedTest, ...] = ()
    commands: tuple[Command, ...] = ()
    notices: tuple[Notice, ...] = ()
    tests: tuple[TestSummary, ...] = ()
    serials: Mapping[str, str] = field(default_factory=dict[str, str])
    runner: bool = False

    @property
    def running(self) -> tuple[ControllerBeat, ...]:
        """The tests that run now."""
        return tuple(b for b, alive in self.beats if alive and b.state == "running")

    def beat(self, test_id: str) -> tuple[ControllerBeat | None, bool]:
        """Return the last word of a test's controller, and whether its process is alive."""
        for beat, alive in self.beats:
            if beat.test_id == test_id:
                return beat, alive
        return None, False


@dataclass(slots=True)
class StoreWatch:
    """Reads a store in a thread of its own; the pages never do.

    Parameters
    ----------
    url : str
    """

    url: str
    snapshot: Snapshot = field(default_factory=Snapshot)
    _wanted: dict[str, float] = field(default_factory=dict[str, float])
    _followed: dict[str, FollowedTest | str] = field(
        default_factory=dict[str, "FollowedTest | str"]
    )
    _tests: tuple[TestSummary, ...] = ()
    _serials: dict[str, str] = field(default_factory=dict[str, str])
    _tests_s: float = float("-inf")
    _settled_s: float = float("-inf")
    _stop: threading.Event = field(default_factory=threading.Event)
    _thread: threading.Thread | None = None

    def start(self) -> None:
        """Begin to look."""
        self._thread = threading.Thread(target=self._run, name="store-watch", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stop looking."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(5.0)

    def follow(self, test_id: str) -> FollowedTest | str | None:
        """Return a test as far as it has been read; why it cannot be; None: not read yet."""
        self._wanted[test_id] = time.monotonic()
        return self._followed.get(test_id)

    def _run(self) -> None:
        store: Store | None = None
        while not self._stop.is_set():
            more = False
            try:
                store = store or open_store(self.url)
                self.snapshot = self._look(store)
                more = self._read_on(store)
            except StoreError as err:
                self.snapshot = replace(self.snapshot, problem=str(err), looked_s=time.monotonic())
                if store is not None:
                    store.close()
                store = None
            except Exception as err:  # a fault of the page must not stop its looking
                log.error("the page's reader: %s: %s", type(err).__name__, err)
                self.snapshot = replace(self.snapshot, problem=f"error of the program: {err}")
            self._stop.wait(0.0 if more else LOOK_S)
        if store is not None:
            store.close()

    def _look(self, store: Store) -> Snapshot:
        now_s = time.monotonic()
        if now_s - self._settled_s > SETTLE_S:
            settle_dead_controllers(store, self.url)
            self._settled_s = now_s
        if now_s - self._tests_s > TESTS_S:
            self._tests, self._tests_s = store.tests(), now_s
            new = [t.id for t in self._tests if t.id not in self._serials]
            self._serials = self._serials | {t: _serials(store, t) for t in new}
        return Snapshot(
            looked_s=now_s,
            problem="",
            beats=tuple((b, not is_gone(b)) for b in list_beats(store)),
            alarms=list_alarms(store, open_only=True),
            planned=list_planned(store),
            commands=list_commands(store, newest=NEWEST),
            notices=list_notices(store, waiting_only=True),
            tests=self._tests,
            serials=self._serials,
            runner=store.is_claimed(CLAIM),
        )

    def _read_on(self, store: Store) -> bool:
        """Read on in every test that a page looks at; return True if there is more at once."""
        now_s = time.monotonic()
        for test_id in [t for t, s in dict(self._wanted).items() if now_s - s > FORGET_S]:
            self._wanted.pop(test_id, None)
            self._followed.pop(test_id, None)
        more = False
        for test_id in tuple(self._wanted):
            try:
                found = self._followed.get(test_id)
                if not isinstance(found, FollowedTest):
                    found = FollowedTest(store, test_id)
                more = found.update(store) or more
                self._followed[test_id] = found
            except StoreError:
                if store.has_test(test_id):
                    raise
                self._followed[test_id] = f"no test has the id {test_id!r}"
            except WorkbenchError as err:
                self._followed[test_id] = str(err)
        return more


def _serials(store: Store, test_id: str) -> str:
    """Return the serial numbers of a test; nothing where this program cannot read its sequence."""
    try:
        sequence = parse_sequence(store.test(test_id).sequence_toml)
    except InputError:
        return ""
    return " ".join(a.serial for a in sequence.accelerometers)
