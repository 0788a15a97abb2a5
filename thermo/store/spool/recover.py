"""Recovery of what an earlier process left: a spool not taken in, a test not ended.

And the files that lie beside a store and tell of it.
"""

import logging
from pathlib import Path

from errormodel.errors import StoreError
from thermo.store.database import StoreAwayError, parse_store_url
from thermo.store.spool.log import SUFFIX, SpoolFile, default_folder, digest, replay
from thermo.store.sqlite import holds_test
from thermo.store.store import Store

log = logging.getLogger(__name__)

ENDED = "its process ended without storing the outcome (killed, or the store could not be written)"


def recover(store: Store, folder: Path | None = None) -> None:
    """Let flow in what earlier tests of this store left in spools, and mend their status.

    What is done is told by warnings. A spool that another process has open is left alone, and so
    is a test that is claimed.

    Raises
    ------
    StoreError
        If the store does not take it now.
    """
    folder = folder or default_folder()
    busy: set[str] = set()
    for path in spools(folder):
        test_id = test_of(path)
        if not store.has_test(test_id):
            continue
        try:
            spool = SpoolFile(path)
        except StoreError:
            busy.add(test_id)  # its test runs
            continue
        _flow_in(store, spool, test_id)
    for test_id in store.running_tests():
        if test_id not in busy:
            _mend(store, test_id)


def spools(folder: Path) -> tuple[Path, ...]:
    """Return the spools in a folder."""
    return tuple(sorted(folder.glob(f"*{SUFFIX}")))


def test_of(path: Path) -> str:
    """Return the id of the test a spool is of."""
    return path.name.removesuffix(SUFFIX).split(".", 1)[-1]


def _flow_in(store: Store, spool: SpoolFile, test_id: str) -> None:
    delete = False
    try:
        where, (waiting, _) = spool.where, spool.count()
        if not _belongs(store, spool.path, where, test_id):
            log.warning(
                "%s: %d entries of test %s wait for the store %s; not stored in this one",
                spool.path, waiting, test_id, where,
            )  # fmt: skip
            return
        replay(store, spool)
        refused = spool.count()[1]
        delete = not refused
        if waiting:
            log.warning("%s: %d entries of test %s were stored", spool.path, waiting, test_id)
        if refused:
            log.warning("%s: the store refuses %d entries of test %s; they stay there",
                        spool.path, refused, test_id)  # fmt: skip
    finally:
        spool.close(delete=delete)


def _belongs(store: Store, path: Path, where: str, test_id: str) -> bool:
    """Tell whether a spool is of this store, or of one whose file is no more where it was."""
    if path.name.startswith(digest(store.url) + "."):
        return True
    if store.path is None or "://" in where:
        return False
    return not holds_test(Path(where), test_id)


def _mend(store: Store, test_id: str) -> None:
    try:
        if store.is_claimed(test_id):
            return
        with store.claim(test_id):
            if store.test(test_id).status == "running":
                store.finish_test(test_id, "interrupted", ENDED)
                log.warning("test %s: %s; its status is now interrupted", test_id, ENDED)
    except StoreAwayError as err:
        log.warning("test %s: is still marked as running: %s", test_id, err)
    except StoreError:
        return  # somebody took it in the meantime


def copies(store: Path, folder: Path | None = None) -> tuple[Path, ...]:
    """Return the copies that tests made of a store that was deleted or moved under them."""
    return tuple(sorted((folder or default_folder()).glob(f"{store.stem}.*.sqlite")))


def warnings(url: str | Path, folder: Path | None = None) -> tuple[str, ...]:
    """Return what lies about of a store and its tests, a line each.

    Parameters
    ----------
    url : str or path
    folder : Path, optional
        Of the spools; `thermo.store.spool.log.default_folder` if not given.
    """
    parsed = parse_store_url(url)
    lines: list[str] = []
    for path in spools(folder or default_folder()):
        if path.name.startswith(digest(parsed) + "."):
            lines.append(f"{path}: readings of test {test_of(path)} are there, not in the store")
    if parsed.get_backend_name() != "sqlite":
        return tuple(lines)
    store = Path(str(parsed.database))
    for path in sorted(store.parent.glob("*-wal")):
        if not path.with_name(path.name.removesuffix("-wal")).exists() and path.stat().st_size:
            lines.append(f"{path}: an orphaned write-ahead log; a store that is opened without "
            f"it lacks its readings")  # fmt: skip
    for path in sorted(store.parent.glob(f"{store.name}.*.guardian.json*")):
        lines.append(f"{path}: left by a guardian; `accelbench run --resume` stores it")
    return tuple(lines)
