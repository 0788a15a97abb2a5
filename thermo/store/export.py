"""From the store to a recorded run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from errormodel.errors import StoreError
from thermo.recording.files import RecordedRuns, make_runs, write_runs
from thermo.recording.output_scale import OutputScale, OutputUnit
from thermo.recording.runs import FORCES, head_force_g
from thermo.recording.signals import recorded_signals
from thermo.store.records import RunRecord

if TYPE_CHECKING:
    from thermo.store.store import Store

COLUMNS = ["run", "serial", "time_s", "temp_c", "position_deg", "output", "chamber_c", "flag"]


def export_test(
    store: "Store",
    test_id: str,
    path: Path | str | None,
    *,
    output_unit: OutputUnit,
    gravity_m_s2: float,
    nominal_scale: float,
    serials: Sequence[str] | None = None,
    mount_deg: Mapping[str, float] | None = None,
) -> RecordedRuns:
    """Write a test's readings as recorded runs, named ``TEST_ID-1`` and so on.

    Readings of attempts that were given up are left out; flagged ones are kept with their flag. A
    reading without a value that has no flag gets the flag "missing".

    Parameters
    ----------
    store : Store
    test_id : str
    path : path or None
        A ``.csv`` or ``.parquet`` file; None writes nothing.
    output_unit, gravity_m_s2, nominal_scale
        What goes into the sidecar; the scale in output units per g.
    serials : sequence of str, optional
        Only these accelerometers: a file holds those that share one nominal scale.
    mount_deg : mapping, optional
        How far accelerometers are mounted turned on the head, °, by serial number: theirs get the
        forces beside the head's angle, and the sidecar says it.

    Returns
    -------
    RecordedRuns
        What was written.

    Raises
    ------
    StoreError
        If there is no such test or it has no readings.
    InputError
        If the file cannot be written or the arguments make no recorded run.
    """
    frame = store.readings(test_id)
    frame = frame[frame["voided"] == ""]
    if serials is not None:
        frame = frame[frame["serial"].isin(list(serials))]
    if frame.empty:
        raise StoreError(f"test {test_id}: has no readings to export")
    positions = frame.groupby(["run", "serial"])["position_deg"].count()
    meaning = ExportedMeaning(
        test_id=test_id,
        scale=OutputScale(
            output_unit=output_unit, gravity_m_s2=gravity_m_s2, nominal_scale=nominal_scale
        ),
        mount_deg={s: float(angle) for s, angle in (mount_deg or {}).items() if angle},
        run_start_utc=run_starts(store.test(test_id).runs),
        positioned=frozenset(_positioned(positions)),
    )
    record = meaning.record_of(frame)
    if path is not None:
        write_runs(record, path)
    return record


def _positioned(counts: pd.Series) -> list[tuple[int, str]]:
    """Return the (run, serial) that have positions, of counts by run and serial."""
    return counts[counts > 0].index.tolist()


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedMeaning:
    """Meaning of a test's readings as recorded runs, whether they come whole or in pieces.

    Attributes
    ----------
    test_id : str
    scale : OutputScale
    mount_deg : mapping
        By serial number, of those that are mounted turned.
    run_start_utc : mapping
        By the run's number.
    positioned : set of (run, serial)
        Whose readings have positions: one without is then flagged.
    """

    test_id: str
    scale: OutputScale
    mount_deg: Mapping[str, float]
    run_start_utc: Mapping[int, datetime]
    positioned: frozenset[tuple[int, str]]

    def run_id(self, number: int) -> str:
        """Return what a run of the test is called in a recording."""
        return f"{self.test_id}-{number}"

    def record_of(self, stored: pd.DataFrame) -> RecordedRuns:
        """Return stored readings, checked, as recorded runs.

        Raises
        ------
        InputError
            If a reading is not what it should be.
        """
        recorded = [one.name for one in recorded_signals() if one.name in stored]
        frame = stored[[*COLUMNS, *recorded]].copy()
        lacking = frame["temp_c"].isna() | frame["output"].isna()
        pairs = zip(frame["run"], frame["serial"], strict=True)
        positioned = np.fromiter((p in self.positioned for p in pairs), bool, len(frame))
        lacking |= positioned & frame["position_deg"].isna()
        frame["flag"] = np.where(lacking & (frame["flag"] == ""), "missing", frame["flag"])
        turned = frame["serial"].map(dict(self.mount_deg)).astype(float).fillna(0.0)
        if (turned != 0.0).any():
            angle = np.where(turned != 0.0, frame["position_deg"] + turned, np.nan)
            frame[list(FORCES)] = head_force_g(angle)
        names = {number: self.run_id(number) for number in frame["run"].unique()}
        frame["run"] = frame["run"].map(names).astype(object)
        runs, serials, times = (stored[n].to_numpy() for n in ("run", "serial", "time_s"))

        def place(row: int) -> str:
            return f"run {runs[row]} serial {serials[row]} time_s {times[row]!s}"

        return make_runs(
            frame,
            output_unit=self.scale.output_unit,
            gravity_m_s2=self.scale.gravity_m_s2,
            nominal_scale=self.scale.nominal_scale,
            run_start_utc={self.run_id(n): start for n, start in self.run_start_utc.items()},
            mount_deg={r: self.mount_deg for r in names.values()} if self.mount_deg else None,
            source=f"test {self.test_id}",
            place=place,
        )


def run_starts(runs: Sequence[RunRecord]) -> dict[int, datetime]:
    """Return when each run of a test began.

    From one run to the next passes what the wall says, or what the station's clock says where
    that is more: an emulated station's clock runs ahead of the wall, and a clock that began anew
    with its machine lies behind.

    Parameters
    ----------
    runs : sequence of RunRecord
        In their order.
    """
    walls = [datetime.fromisoformat(r.start_utc) for r in runs]
    starts = walls[:1]
    for (a, b), (before, after) in zip(pairwise(runs), pairwise(walls), strict=True):
        passed = after - before
        if a.start_clock_s is not None and b.start_clock_s is not None:
            passed = max(passed, timedelta(seconds=b.start_clock_s - a.start_clock_s))
        starts.append(starts[-1] + passed)
    return {r.number: start for r, start in zip(runs, starts, strict=True)}
