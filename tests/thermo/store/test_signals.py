"""Signals recorded beside a reading: kept, exported, never changed."""

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sqlalchemy as sa

from errormodel.errors import StoreError
from thermo.recording.files import read_runs
from thermo.recording.output_scale import OutputScale
from thermo.recording.signals import Signal, signals, using_signals
from thermo.store import schema
from thermo.store.records import NewTest, ReadingRow, reading_values
from thermo.store.spool.log import Operation, apply
from thermo.store.store import Store, open_store
from thermo.store.stream import export_in_pieces

SUPPLY = Signal(name="supply_v", unit="V", sentence="Supply voltage.", recorded=True)
SCALE = OutputScale(output_unit="mA", gravity_m_s2=9.80665, nominal_scale=1.3)


def row(slot: int, **signals: float | None) -> ReadingRow:
    return ReadingRow(
        serial="A", slot=slot, time_s=10.0 * slot, temp_c=20.0, position_deg=90.0,
        output=1.3 + 1e-4 * slot, signals=signals,
    )  # fmt: skip


def begun(store: Store) -> str:
    test_id = store.begin_test(NewTest("night", "", "{}"))
    store.begin_run(test_id, 1, "2026-11-22T22:15:00+00:00")
    return test_id


def exported(store: Store, test_id: str, path: Path) -> str:
    export_in_pieces(store, test_id, path, scale=SCALE, serials=["A"], mount_deg={})
    return path.read_text(encoding="utf-8").splitlines()[0]


def test_signals_come_back_as_columns_and_into_the_recorded_run(
    store_url: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with open_store(store_url) as store:
        test_id = begun(store)
        for slot in range(4):
            store.append(test_id, 1, [row(slot, supply_v=None if slot == 2 else 15.0 + slot)])
        frame = store.readings(test_id)
        np.testing.assert_array_equal(frame["supply_v"], [15.0, 16.0, np.nan, 18.0])
        with using_signals((*signals(), SUPPLY)):
            assert exported(store, test_id, tmp_path / "run.csv").split(",")[-1] == "supply_v"
            more = read_runs([tmp_path / "run.csv"], trust_units=True).more["supply_v"]
            np.testing.assert_array_equal(more, frame["supply_v"])
        with caplog.at_level(logging.WARNING):
            assert "supply_v" not in exported(store, test_id, tmp_path / "plain.csv")
        assert "supply_v is left out" in caplog.text


def test_they_go_through_the_spool_and_are_not_entered_twice(store_url: str) -> None:
    with open_store(store_url) as store:
        test_id = begun(store)
        values = reading_values(test_id, 1, row(0, supply_v=15.0))
        operation = Operation(
            call="append", arguments={"test_id": test_id, "run": 1, "values": [values]}
        )
        apply(store, operation, again=False)
        apply(store, operation, again=True)  # the answer had not come
        other = {**values, "signals": {"supply_v": 16.0}}
        changed = replace(operation, arguments={**operation.arguments, "values": [other]})
        with pytest.raises(StoreError):
            apply(store, changed, again=True)
        assert store.readings(test_id)["supply_v"].tolist() == [15.0]


def test_a_signal_is_only_added_and_never_infinite(store_url: str) -> None:
    with open_store(store_url) as store:
        test_id = begun(store)
        with pytest.raises(StoreError, match="supply_v is infinite"):
            store.append(test_id, 1, [row(0, supply_v=np.inf)])
        store.append(test_id, 1, [row(0, supply_v=15.0)])
        with pytest.raises(sa.exc.DBAPIError), store._engine.begin() as connection:
            connection.execute(sa.update(schema.signals).values(value=1.0))
