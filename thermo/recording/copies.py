"""Runs that hold the same readings under two names."""

import hashlib

import numpy as np

from errormodel.errors import InputError
from thermo.recording.runs import RecordedRuns


def refuse_copies(record: RecordedRuns) -> None:
    """Refuse runs that hold the same readings under two names.

    Raises
    ------
    InputError
        Naming both.
    """
    seen: dict[bytes, tuple[str, str]] = {}
    for run, serial in record.scales:
        mine = record.run.codes == record.run_ids.index(run)
        mine &= record.serial.codes == record.serials.index(serial)
        output = record.output[mine]
        if len(np.unique(output)) < 3:
            continue  # a few digits may be equal by chance, or by an overload
        key = hashlib.sha256(output.tobytes() + record.temp_c[mine].tobytes()).digest()
        other = seen.setdefault(key, (run, serial))
        if other[0] != run:
            raise InputError(
                record.source,
                "",
                f"run {run!r} serial {serial!r} has the same readings as run {other[0]!r} serial "
                f"{other[1]!r}; expected each run under one name only",
            )
