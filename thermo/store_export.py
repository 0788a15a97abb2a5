"""From the store to a recorded run."""

from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from errormodel.errors import StoreError
from thermo.recording import OutputUnit, RecordedRuns, make_runs, write_runs
from thermo.recording_model import FORCES, head_force_g
from thermo.store_records import RunRecord

if TYPE_CHECKING:
    from thermo.store import Store

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
    test = store.test(test_id)
    frame = store.readings(test_id)
    frame = frame[frame["voided"] == ""]
    if serials is not None:
        frame = frame[frame["serial"].isin(list(serials))]
    if frame.empty:
        raise StoreError(f"test {test_id}: has no readings to export")
    frame = frame[COLUMNS].copy()
    lacking = frame["temp_c"].isna() | frame["output"].isna()
    positioned = frame.groupby(["run", "serial"])["position_deg"].transform("count") > 0
    lacking |= positioned & frame["position_deg"].isna()
    frame["flag"] = np.where(lacking & (frame["flag"] == ""), "missing", frame["flag"])
    turned = frame["serial"].map(dict(mount_deg or {})).fillna(0.0)
    if (turned != 0.0).any():
        angle = np.where(turned != 0.0, frame["position_deg"] + turned, np.nan)
        frame[list(FORCES)] = head_force_g(angle)
    mounts = {s: float(angle) for s, angle in (mount_deg or {}).items() if angle}
    frame["run"] = [f"{test_id}-{number}" for number in frame["run"]]
    starts = {f"{test_id}-{n}": start for n, start in run_starts(test.runs).items()}
    record = make_runs(
        frame,
        output_unit=output_unit,
        gravity_m_s2=gravity_m_s2,
        nominal_scale=nominal_scale,
        run_start_utc=starts,
        mount_deg={run: mounts for run in frame["run"].unique()} if mounts else None,
        source=f"test {test_id}",
    )
    if path is not None:
        write_runs(record, path)
    return record


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
