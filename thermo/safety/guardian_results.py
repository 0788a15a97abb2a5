"""Results of guardians: their files, and their way into the store."""

import contextlib
from pathlib import Path

import sqlalchemy as sa

from thermo.safety.commanded_note import state_folder
from thermo.safety.guardian_record import GuardianRecord, read_record
from thermo.store.store import Store

SUFFIX = ".guardian.json"


def _store_file(store_url: str | Path) -> Path | None:
    """Return the file of an SQLite store; None for a store on a server."""
    text = str(store_url)
    if "://" in text and not text.startswith("sqlite"):
        return None
    database = sa.make_url(text).database if text.startswith("sqlite:") else text
    return Path(database or "store")


def result_file(store_url: str | Path, test_id: str) -> Path:
    """Return where the guardian of a test leaves its result.

    Beside an SQLite store; for a store on a server in the user's state directory.
    """
    store = _store_file(store_url)
    if store is None:
        return state_folder() / f"{test_id}{SUFFIX}"
    return store.with_name(f"{store.name}.{test_id}{SUFFIX}")


def pending_results(store_url: str | Path) -> tuple[GuardianRecord, ...]:
    """Return what guardians have left for a store and what is not entered into it yet.

    Parameters
    ----------
    store_url : str or path
        For a store on a server the results of every such store of the user are returned; match
        their `test_id`.

    Returns
    -------
    tuple of GuardianRecord
        By test id; those of a healthy running test are left out.
    """
    store = _store_file(store_url)
    folder, prefix = (state_folder(), "") if store is None else (store.parent, f"{store.name}.")
    found: list[GuardianRecord] = []
    with contextlib.suppress(OSError):
        for path in sorted(folder.iterdir()):
            if path.name.startswith(prefix) and path.name.endswith(SUFFIX):
                test_id = path.name[len(prefix) : -len(SUFFIX)]
                record = read_record(path, test_id)
                if record is not None and not (record.phase == "watching" and record.alive):
                    found.append(record)
    return tuple(found)


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
    record = read_record(path, test_id)
    if record is None:
        return None
    kind = "guardian" if record.verified else "guardian: not safe"
    store.log_event(test_id, None, None, kind, record.text)
    if not record.alive:  # one that still works on the chamber goes on telling
        path.unlink(missing_ok=True)
    return record.verified
