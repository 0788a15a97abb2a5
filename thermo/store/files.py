"""From a store to recorded-run files, with everything the store itself knows of their meaning."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from drivers.station import StationConfig
from errormodel.errors import InputError, StoreError
from thermo.planning.sequence import parse_sequence
from thermo.recording.files import RecordedRuns, join_runs
from thermo.recording.output_scale import OutputScale, OutputUnit
from thermo.recording.readings_check import flag_readings
from thermo.recording.summary import RecordingSummary
from thermo.store.database import parse_store_url
from thermo.store.export import export_test
from thermo.store.spool.recover import copies, recover
from thermo.store.sqlite import companion_path
from thermo.store.store import Store, open_store
from thermo.store.stream import export_in_pieces

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Exported:
    """One file of an export, and what is in it."""

    path: Path
    summary: RecordingSummary


@dataclass(frozen=True, slots=True, kw_only=True)
class _Group:
    """Accelerometers that share unit and nominal scale: a file has one sidecar."""

    output_unit: OutputUnit
    nominal_scale: float
    serials: tuple[str, ...]


def open_existing_store(url: str | Path) -> Store:
    """Open a store to read from it; one that is not there is not made.

    What earlier tests left in a spool flows in first (`thermo.store.spool.recover`).

    Raises
    ------
    InputError
        If there is none.
    StoreError
        If it cannot be opened.
    """
    parsed = parse_store_url(url)
    if parsed.get_backend_name() == "sqlite":
        path = Path(str(parsed.database))
        if not path.is_file():
            raise InputError(path, "", f"no such store{_traces(path)}")
    store = open_store(url, existing=True)
    try:
        recover(store)
    except StoreError as err:
        log.warning("%s", err)
    return store


def _traces(path: Path) -> str:
    """Return what there is in place of a store that is not there."""
    if made := copies(path):
        return f"; copied when it was deleted or moved under a test: {made[-1]}"
    if (wal := companion_path(path, "-wal")).exists():
        return f"; {wal} belongs to it: put the file back beside it"
    return ""


def export_paths(store: Store, test_id: str, path: Path) -> tuple[Path, ...]:
    """Return the files `export_recorded` would write."""
    groups = _groups(store, test_id)
    if len(groups) == 1:
        return (path,)
    return tuple(path.with_stem(f"{path.stem}-{k}") for k in range(1, len(groups) + 1))


def export_recorded(store: Store, test_id: str, path: Path) -> tuple[Exported, ...]:
    """Write a test as recorded runs, `PATH` with its sidecar.

    Accelerometers that differ in unit or nominal scale go into files of their own, NAME-1.csv,
    NAME-2.csv and so on; they can be read together again.

    Parameters
    ----------
    store : Store
    test_id : str
    path : Path
        A ``.csv`` or ``.parquet`` file; one that exists is replaced.

    Returns
    -------
    tuple of Exported

    Raises
    ------
    StoreError
        If there is no such test or it has no readings.
    InputError
        If a file cannot be written.
    """
    config = StationConfig.model_validate_json(store.test(test_id).station_json)
    sequence = parse_sequence(store.test(test_id).sequence_toml, f"test {test_id}")
    done: list[Exported] = []
    groups = _groups(store, test_id)
    for name, group in zip(export_paths(store, test_id, path), groups, strict=True):
        summary = export_in_pieces(
            store,
            test_id,
            name,
            scale=OutputScale(
                output_unit=group.output_unit,
                gravity_m_s2=config.gravity_m_s2,
                nominal_scale=group.nominal_scale,
            ),
            serials=group.serials,
            mount_deg={a.serial: a.mount_deg for a in sequence.accelerometers},
        )
        done.append(Exported(path=name, summary=summary))
    return tuple(done)


def stored_runs(store: Store, test_id: str) -> RecordedRuns:
    """Return a test's runs without writing any file; readings judged as those of files are.

    Raises
    ------
    StoreError
        If there is no such test or it has no readings.
    """
    return flag_readings(join_runs(recorded_runs(store, test_id)))


def recorded_runs(store: Store, test_id: str) -> tuple[RecordedRuns, ...]:
    """Return a test as recorded runs, one for each unit and nominal scale.

    Raises
    ------
    StoreError
        If there is no such test or it has no readings.
    """
    config = StationConfig.model_validate_json(store.test(test_id).station_json)
    sequence = parse_sequence(store.test(test_id).sequence_toml, f"test {test_id}")
    return tuple(
        export_test(
            store,
            test_id,
            None,
            output_unit=group.output_unit,
            gravity_m_s2=config.gravity_m_s2,
            nominal_scale=group.nominal_scale,
            serials=group.serials,
            mount_deg={a.serial: a.mount_deg for a in sequence.accelerometers},
        )
        for group in _groups(store, test_id)
    )


def _groups(store: Store, test_id: str) -> Sequence[_Group]:
    test = store.test(test_id)
    sequence = parse_sequence(test.sequence_toml, f"test {test_id}")
    config = StationConfig.model_validate_json(test.station_json)
    units: dict[str, OutputUnit] = {entry.serial: entry.output_unit for entry in config.inputs}
    found: dict[tuple[OutputUnit, float], list[str]] = {}
    for one in sequence.accelerometers:
        if one.serial not in units:
            raise StoreError(f"test {test_id}: {one.serial} is not wired in its station")
        found.setdefault((units[one.serial], one.nominal_scale), []).append(one.serial)
    return [
        _Group(output_unit=unit, nominal_scale=scale, serials=tuple(serials))
        for (unit, scale), serials in found.items()
    ]
