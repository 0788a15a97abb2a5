"""From the store to a recorded run's file without the readings ever standing in memory whole.

The readings are gone through twice, as of one moment: by accelerometer, to check them and to make
the digests, and in order of time, to write them. Nothing is written before all are checked.
"""

import itertools
import logging
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import sqlalchemy as sa

from errormodel.errors import InputError, StoreError
from errormodel.io.table_write import write_with_sidecar
from thermo.recording.digest import RunDigest
from thermo.recording.output_scale import OutputScale
from thermo.recording.runs import COLUMNS, FORCES, REQUIRED, RecordedRuns
from thermo.recording.signals import recorded_signals
from thermo.recording.summary import RecordingSummary
from thermo.recording.write import sidecar_of
from thermo.store import queries, reading_queries
from thermo.store.export import ExportedMeaning, run_starts

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from thermo.store.store import Store

log = logging.getLogger(__name__)


def export_in_pieces(
    store: "Store",
    test_id: str,
    path: Path,
    *,
    scale: OutputScale,
    serials: "Sequence[str]",
    mount_deg: "Mapping[str, float]",
) -> RecordingSummary:
    """Write a test's readings as recorded runs, the same file as `export_test` writes.

    Parameters
    ----------
    store : Store
    test_id : str
    path : Path
        A ``.csv`` or ``.parquet`` file.
    scale : OutputScale
        What goes into the sidecar.
    serials : sequence of str
        These accelerometers.
    mount_deg : mapping
        How far accelerometers are mounted turned on the head, °, by serial number.

    Raises
    ------
    StoreError
        If there is no such test or it has no readings.
    InputError
        If a reading is not what it should be or the file cannot be written.
    """
    starts = run_starts(store.test(test_id).runs)
    with store.snapshot() as connection:
        _tell_unknown_signals(queries.signal_names(connection, test_id), test_id)
        counts = reading_queries.reading_counts(connection, test_id, serials)
        if not counts:
            raise StoreError(f"test {test_id}: has no readings to export")
        meaning = ExportedMeaning(
            test_id=test_id,
            scale=scale,
            mount_deg={s: float(angle) for s, angle in mount_deg.items() if angle},
            run_start_utc={n: t for n, t in starts.items() if n in {c.run for c in counts}},
            positioned=frozenset((c.run, c.serial) for c in counts if c.positions),
        )
        return _Export(connection, meaning, counts).write(path)


def _tell_unknown_signals(stored: "Sequence[str]", test_id: str) -> None:
    """Warn of stored signals that are left out, as no signal in use has their name."""
    known = [one.name for one in recorded_signals()]
    if unknown := [name for name in stored if name not in known]:
        log.warning(
            "test %s: %s is left out of the recorded run; --library FILE of the signal keeps it",
            test_id,
            ", ".join(unknown),
        )


class _Export:
    """One file of an export: what is known of its readings beforehand, and what is seen of them."""

    def __init__(
        self,
        connection: sa.Connection,
        meaning: ExportedMeaning,
        counts: list[reading_queries.ReadingCount],
    ) -> None:
        self._connection, self._meaning = connection, meaning
        self._counts = {(meaning.run_id(c.run), c.serial.strip()): c for c in counts}
        self._asked = tuple(dict.fromkeys(c.serial for c in counts))
        self._serials: dict[str, None] = {}  # in the order in which they are written
        self._signals: dict[str, None] = {}
        self._flagged, self._has_input = 0, True

    def write(self, path: Path) -> RecordingSummary:
        digests = self._checked_digests()
        meaning = self._meaning
        starts = {meaning.run_id(n): t for n, t in meaning.run_start_utc.items()}
        mounts = {
            (run, serial): angle
            for run in dict.fromkeys(r for r, _ in self._counts)
            for serial, angle in meaning.mount_deg.items()
            if (run, serial) in self._counts
        }
        write_with_sidecar(self._frames(), sidecar_of(meaning.scale, starts, mounts), path)
        return RecordingSummary(
            run_ids=tuple(digests),
            serials=tuple(self._serials),
            readings=sum(c.readings for c in self._counts.values()),
            flagged=self._flagged,
            has_input=self._has_input,
            digests=digests,
        )

    def _pieces(self, *, by_serial: bool) -> Iterator[RecordedRuns]:
        for frame in reading_queries.reading_pieces(
            self._connection, self._meaning.test_id, self._asked, by_serial=by_serial
        ):
            yield self._meaning.record_of(frame)

    def _checked_digests(self) -> dict[str, str]:
        """Check all readings, and return the digest of each run."""
        digests: dict[str, RunDigest] = {}
        last: tuple[tuple[str, str], float] | None = None
        for record in self._pieces(by_serial=True):
            self._flagged += int((~record.good).sum())
            self._has_input = self._has_input and record.has_input
            for rows in _stretches(record):
                key = (record.run.at(rows.start), record.serial.at(rows.start))
                digest = digests.setdefault(key[0], RunDigest())
                if last is None or last[0] != key:
                    turned = record.mount_deg.get(key, 0.0)
                    digest.begin(key[1], self._meaning.scale, turned, self._counts[key].readings)
                elif not record.time_s[rows.start] > last[1]:
                    self._refuse_same_time(key, last[1])
                flags = record.flag.texts_of(rows)
                digest.add([n[rows] for n in record.digested()], flags)
                self._signals |= dict.fromkeys(record.more)
                last = key, float(record.time_s[rows.stop - 1])
        return {run: digest.hexdigest() for run, digest in digests.items()}

    def _refuse_same_time(self, key: tuple[str, str], time_s: float) -> None:
        place = f"run {key[0]} serial {key[1]} time_s {time_s!s}"
        raise InputError(f"test {self._meaning.test_id}", place, "stands twice")

    def _frames(self) -> Iterator[pd.DataFrame]:
        names = self._columns()
        for record in self._pieces(by_serial=False):
            self._serials |= dict.fromkeys(record.serials)
            yield record.frame_of(slice(None), names)

    def _columns(self) -> tuple[str, ...]:
        counts = self._counts.values()
        used = {"run", "serial", *REQUIRED}
        used |= {"position_deg"} if any(c.positions for c in counts) else set()
        used |= {"chamber_c"} if any(c.chamber_temperatures for c in counts) else set()
        turned = any(c.positions and c.serial in self._meaning.mount_deg for c in counts)
        used |= set(FORCES) if turned else set()
        used |= {"flag"} if self._flagged else set()
        return tuple(n for n in (*COLUMNS, *self._signals, "flag") if n in {*used, *self._signals})


def _stretches(record: RecordedRuns) -> Iterator[slice]:
    """Yield the rows of each accelerometer's run, which stand together."""
    changed = (np.diff(record.run.codes) != 0) | (np.diff(record.serial.codes) != 0)
    edges = [0, *(np.flatnonzero(changed) + 1).tolist(), len(record)]
    for begin, end in itertools.pairwise(edges):
        yield slice(begin, end)
