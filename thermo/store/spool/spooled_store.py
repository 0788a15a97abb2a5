"""The store of a running test: never waited for longer than a moment, and nothing lost by that.

How: `thermo.store.spool.bypass`.
"""

import logging
from collections.abc import Sequence
from dataclasses import asdict
from datetime import datetime
from functools import partial
from pathlib import Path

import pandas as pd

from drivers.clock import Clock
from errormodel.errors import StoreError
from thermo.planning.silence import READ_PATIENCE_S
from thermo.store.claims import HeldClaim
from thermo.store.database import display_url, open_engine, parse_store_url
from thermo.store.records import (
    EventRecord,
    NewTest,
    ReadingRow,
    ScheduleMark,
    TestRecord,
    TestSummary,
    check_status,
    number_or_null,
    reading_values,
)
from thermo.store.spool.bypass import BypassedStore, result_of
from thermo.store.spool.log import Operation, default_folder, prove_spool_writable
from thermo.store.spool.recover import recover
from thermo.store.spool.worker import StoreWorker

log = logging.getLogger(__name__)

# all in real seconds
PATIENCE_S = 2.0  # for a write
LEAST_PATIENCE_S = 0.5  # a disk that is busy for a moment is not away
OPEN_PATIENCE_S = 300.0  # for an old spool to flow in, before anything is commanded
END_PATIENCE_S = 30.0  # for the spool to flow in at the end
END_TRIES = 10  # of a checkpoint


def write_patience_s(period_s: float, clock: Clock) -> float:
    """Return for how many real seconds a write may keep a test waiting: one sampling period.

    Parameters
    ----------
    period_s : float
        Between two readings, s on the clock.
    clock : Clock
    """
    real_s = period_s / getattr(clock, "speed", 1.0)
    return min(PATIENCE_S, max(LEAST_PATIENCE_S, real_s))


def open_spooled_store(
    url: str | Path, *, spool_folder: Path | None = None, patience_s: float = PATIENCE_S
) -> "SpooledStore":
    """Open a store for a test that must not wait for it.

    What an earlier test could not bring into it flows in first.

    Parameters
    ----------
    url : str or path
    spool_folder : Path, optional
        Where the spool goes when one is needed; `thermo.store.spool.log.default_folder` if not
        given.
    patience_s : float
        Real seconds for which a write may keep the caller waiting.

    Raises
    ------
    StoreError
        If it cannot be opened, does not answer, or the spool's folder cannot be written.
    """
    parsed = parse_store_url(url)
    folder = spool_folder or default_folder()
    prove_spool_writable(folder)
    worker = StoreWorker("store")
    try:
        opening = worker.submit(partial(open_engine, parsed))
        engine = result_of(opening, OPEN_PATIENCE_S, display_url(parsed))
    except BaseException:
        worker.stop()
        raise
    store = SpooledStore(engine, parsed, worker, folder, patience_s)
    try:
        store.recover()
    except BaseException:
        store.close()
        raise
    return store


class SpooledStore(BypassedStore):
    """A store whose writes come back within `patience_s`, and whose readings within ten seconds.

    A write that has returned is durable in the store or in the spool. Made by
    `open_spooled_store`. A reading back shows everything that was written, or raises
    `StoreAwayError`.
    """

    # ---- writing ----

    def begin_test(self, new: NewTest) -> str:
        """Do the same as `Store.begin_test`; a store that does not answer begins no test."""
        return self.ask(partial(super().begin_test, new))

    def begin_run(
        self,
        test_id: str,
        number: int,
        start_utc: datetime | str,
        start_clock_s: float | None = None,
    ) -> None:
        """Do the same as `Store.begin_run`."""
        start = start_utc if isinstance(start_utc, str) else start_utc.isoformat()
        arguments = {"test_id": test_id, "number": int(number), "start_utc": start}
        arguments |= {"start_clock_s": start_clock_s}
        self.do_write(Operation(call="begin_run", arguments=arguments))

    def append(self, test_id: str, run: int, rows: Sequence[ReadingRow]) -> None:
        """Do the same as `Store.append`."""
        if not rows:
            return
        values = [reading_values(test_id, run, row) for row in rows]
        arguments = {"test_id": test_id, "run": int(run), "values": values}
        self.do_write(Operation(call="append", arguments=arguments))
        self._attempts |= {(test_id, int(run), v["segment"], v["attempt"]) for v in values}

    def log_event(
        self,
        test_id: str,
        run: int | None,
        time_s: float | None,
        kind: str,
        text: str,
        logged_utc: str | None = None,
    ) -> None:
        """Do the same as `Store.log_event`; the moment tells events of the same words apart."""
        arguments = {"test_id": test_id, "run": run, "time_s": number_or_null(time_s)}
        arguments |= {"kind": kind, "text": text, "logged_utc": logged_utc or self.next_stamp()}
        self.do_write(Operation(call="log_event", arguments=arguments))

    def mark_schedule(
        self, test_id: str, run: int, mark: ScheduleMark, logged_utc: str | None = None
    ) -> None:
        """Do the same as `Store.mark_schedule`."""
        arguments = {"test_id": test_id, "run": int(run), "mark": asdict(mark)}
        arguments |= {"logged_utc": logged_utc or self.next_stamp()}
        self.do_write(Operation(call="mark_schedule", arguments=arguments))

    def mark_attempt(
        self,
        test_id: str,
        run: int,
        segment: int,
        flag: str = "superseded",
        attempt: int | None = None,
    ) -> int:
        """Do the same as `Store.mark_attempt`; the number is counted here if the store is away."""
        arguments = {"test_id": test_id, "run": int(run), "segment": int(segment)}
        number = self.do_write(
            Operation(
                call="mark_attempt", arguments={**arguments, "flag": flag, "attempt": attempt}
            )
        )
        if attempt is not None:
            self._attempts.add((test_id, int(run), int(segment), attempt))
        if number is not None:
            return int(number)
        place = (test_id, int(run), int(segment))
        return max((a for *here, a in self._attempts if tuple(here) == place), default=0) + 1

    def finish_run(self, test_id: str, run: int, status: str) -> None:
        """Do the same as `Store.finish_run`."""
        arguments = {"test_id": test_id, "run": int(run), "status": check_status(status)}
        self.do_write(Operation(call="finish_run", arguments=arguments))

    def finish_test(
        self, test_id: str, status: str, outcome: str, safe_result_json: str = ""
    ) -> None:
        """Do the same as `Store.finish_test`; the claim is kept until the store has the end."""
        arguments = {"test_id": test_id, "status": check_status(status), "outcome": outcome}
        arguments["safe_result_json"] = safe_result_json
        self.do_write(Operation(call="finish_test", arguments=arguments))

    def reopen_test(self, test_id: str) -> None:
        """Do the same as `Store.reopen_test`; a store that does not answer resumes no test."""
        self.ask(partial(super().reopen_test, test_id))

    # ---- claims and reading: in the worker, within a bounded time ----

    def claim(self, test_id: str) -> HeldClaim:
        """Do the same as `Store.claim`."""
        held = self.ask(partial(super().claim, test_id))
        if not self._worker.is_current:
            known = self.ask(partial(super().attempts, test_id))
            self._attempts |= {(test_id, *one) for one in known}
        return held

    def is_claimed(self, test_id: str) -> bool:
        """Do the same as `Store.is_claimed`."""
        return self.ask(partial(super().is_claimed, test_id))

    def _release(self, test_id: str) -> None:
        self.ask(partial(super()._release, test_id))

    def test(self, test_id: str) -> TestRecord:
        """Do the same as `Store.test`."""
        return self.ask(partial(super().test, test_id))

    def tests(self) -> tuple[TestSummary, ...]:
        """Do the same as `Store.tests`."""
        return self.ask(partial(super().tests))

    def events(self, test_id: str) -> tuple[EventRecord, ...]:
        """Do the same as `Store.events`."""
        return self.ask(partial(super().events, test_id))

    def last_schedule_mark(self, test_id: str, run: int) -> ScheduleMark | None:
        """Do the same as `Store.last_schedule_mark`."""
        return self.ask(partial(super().last_schedule_mark, test_id, run))

    def last_reading(self, test_id: str, run: int) -> ReadingRow | None:
        """Do the same as `Store.last_reading`."""
        return self.ask(partial(super().last_reading, test_id, run))

    def readings(self, test_id: str, run: int | None = None) -> pd.DataFrame:
        """Do the same as `Store.readings`."""
        return self.ask(partial(super().readings, test_id, run))

    def checkpoint(self, tries: int = 1) -> bool:
        """Do the same as `Store.checkpoint`."""
        return self.ask(partial(super().checkpoint, tries))

    # ---- the ends ----

    def recover(self) -> None:
        """Let flow in what earlier tests left, and mend what they could not end."""
        self.ask(partial(recover, self, self._folder), OPEN_PATIENCE_S)

    def settle(self, patience_s: float = END_PATIENCE_S) -> str:
        """Wait until the store has everything and its file holds it; return `note`."""
        self._settled = True
        if not self._through.wait(patience_s):
            return self.note()
        try:
            self.ask(self._follow_file)
            whole = self.ask(partial(super().checkpoint, END_TRIES))
        except StoreError as err:
            log.warning("%s", err)
        else:
            self._log_left = "" if whole else (
                f"{self.path}-wal holds the last readings, another program reads the store: "
                "the two files belong together"
            )  # fmt: skip
        return self.note()

    @property
    def trouble(self) -> str:
        """Reason why writes do not reach the store now; empty if they do. Never waits."""
        return "" if self._through.is_set() else self._why

    def note(self) -> str:
        """Return where readings are that are not in this store, a line; empty: nowhere else."""
        spooled = ""
        with self._gate:
            if self._spool is not None:
                spooled = (
                    f"the store does not answer: {self._spool.count()[0]} entries wait in "
                    f"{self._spool.path}; `accelbench runs --store {self._where}` stores them"
                )
        return "; ".join(s for s in (self._moved, spooled, self._refused, self._log_left) if s)

    def close(self) -> None:
        """Close it; with a store that does not answer now, when it does, while this process lives.

        Nothing is lost by the process ending before that.
        """
        if self._closed:
            return
        if not self._settled and (note := self.settle()):
            log.warning("%s", note)
        self._closed = True
        if self._through.is_set():
            closing = self._worker.submit(partial(super().close))
            self._worker.stop(READ_PATIENCE_S)
            if closing.done():
                closing.result()
