import os
import threading
from dataclasses import replace

import numpy as np
import pytest
import sqlalchemy as sa

from errormodel.errors import StoreError
from tests.thermo.store.short_test import NEW, SERIALS, START, begun, scan
from thermo.recording.files import read_runs
from thermo.store.export import export_test
from thermo.store.records import ReadingRow
from thermo.store.schema import SCHEMA_VERSION
from thermo.store.store import open_store


def test_what_goes_in_comes_out(store_url):
    with open_store(store_url) as store:
        test_id = begun(store, 3)
        store.log_event(test_id, None, None, "note", "two\nlines")
        store.log_event(test_id, 1, 5.0, "gap", "zero \0 and surrogate \udc80 do no harm")
        store.finish_run(test_id, 1, "finished")
        store.finish_test(test_id, "finished", "done", '{"verified": true}')
    with open_store(store_url) as store:
        test = store.test(test_id)
        assert (test.name, test.sequence_toml) == (NEW.name, NEW.sequence_toml)
        assert test.station_json == NEW.station_json
        assert test.versions == NEW.versions
        assert test.settings == NEW.settings
        assert (test.status, test.outcome) == ("finished", "done")
        assert test.safe_result_json == '{"verified": true}'
        assert [(r.number, r.start_utc, r.start_clock_s, r.status) for r in test.runs] == [
            (1, START, 123.5, "finished")
        ]
        assert [(e.run, e.time_s, e.kind) for e in store.events(test_id)] == [
            (None, None, "note"), (1, 5.0, "gap")
        ]  # fmt: skip
        frame = store.readings(test_id, 1)
        assert frame["serial"].tolist() == [*SERIALS] * 3
        expected = [row.output for slot in range(3) for row in scan(slot)]
        np.testing.assert_array_equal(frame["output"], expected)  # doubles, bit for bit
        assert store.last_reading(test_id, 1) == scan(2)[-1]
        assert [(t.id, t.runs, t.readings) for t in store.tests()] == [(test_id, 1, 9)]


def test_ids_are_unique_and_stay(store_url):
    with open_store(store_url) as store:
        ids = [store.begin_test(NEW) for _ in range(20)]
        assert len(set(ids)) == 20
        assert all(len(i) == 20 and i[8] == "T" and i[15] == "-" for i in ids)
    for _ in range(2):
        with open_store(store_url) as store:
            assert {t.id for t in store.tests()} == set(ids)


def test_a_reading_is_never_overwritten(store_url):
    with open_store(store_url) as store:
        test_id = begun(store, 3)
        before = store.readings(test_id)
        fresh = scan(3)
        with pytest.raises(StoreError, match="B slot 2 attempt 1 is there already") as caught:
            store.append(test_id, 1, [*fresh, scan(2, output=9.0)[1]])
        assert "\n" not in str(caught.value)
        with pytest.raises(StoreError, match="A slot 3 attempt 1 is there already"):
            store.append(test_id, 1, [fresh[0], fresh[0]])
        assert store.readings(test_id).equals(before)
        store.append(test_id, 1, fresh)
        assert len(store.readings(test_id)) == 12


@pytest.mark.parametrize("statement", ["UPDATE readings SET output = 0", "DELETE FROM readings"])
def test_the_database_itself_refuses_changes(store_url, statement):
    with open_store(store_url) as store:
        test_id = begun(store, 1)
        with (
            pytest.raises(sa.exc.DBAPIError, match="only added, never changed"),
            store._engine.begin() as connection,
        ):
            connection.exec_driver_sql(statement)
        np.testing.assert_array_equal(
            store.readings(test_id)["output"], [row.output for row in scan(0)]
        )


def test_values_that_were_not_measured(store_url):
    with open_store(store_url) as store:
        test_id = begun(store)
        store.append(
            test_id,
            1,
            scan(0, temp_c=None, output=float("nan"), position_deg=np.float64(90), flag="overload"),
        )
        frame = store.readings(test_id)
        assert frame[["temp_c", "output"]].isna().all(axis=None)
        assert set(frame["flag"]) == {"overload"}
        with pytest.raises(StoreError, match="A slot 1: output is infinite"):
            store.append(test_id, 1, scan(1, output=float("inf")))
        with pytest.raises(StoreError, match="no time_s"):
            store.append(test_id, 1, scan(1, time_s=float("nan")))
        store.append(test_id, 1, [])
        assert len(store.readings(test_id)) == 3


def test_what_has_not_begun_or_is_over_takes_no_readings(store_url):
    with open_store(store_url) as store:
        test_id = begun(store, 1)
        with pytest.raises(StoreError, match="run 2: has not begun"):
            store.append(test_id, 2, scan(0))
        with pytest.raises(StoreError, match="no test has this id"):
            store.begin_run("20260101T000000-0000", 1, START)
        with pytest.raises(StoreError, match="no test has this id"):
            store.test("x")
        with pytest.raises(StoreError, match="expected one of running"):
            store.finish_run(test_id, 1, "done")
        store.finish_run(test_id, 1, "finished")
        with pytest.raises(StoreError, match="run 1: is finished"):
            store.append(test_id, 1, scan(1))
        with pytest.raises(StoreError, match="run 1: is finished"):
            store.begin_run(test_id, 1, START)
        store.finish_test(test_id, "finished", "done")
        store.finish_test(test_id, "finished", "done")
        with pytest.raises(StoreError, match="finished already"):
            store.finish_test(test_id, "failed", "again")
        with pytest.raises(StoreError, match="cannot be resumed"):
            store.reopen_test(test_id)


def test_an_interrupted_run_goes_on_with_its_first_start(store_url):
    with open_store(store_url) as store:
        test_id = begun(store, 2)
        store.finish_run(test_id, 1, "interrupted")
        store.finish_test(test_id, "interrupted", "Ctrl-C")
    with open_store(store_url) as store, store.claim(test_id):
        store.reopen_test(test_id)
        store.begin_run(test_id, 1, "2026-11-23T05:00:00+00:00")
        test = store.test(test_id)
        assert (test.status, test.runs[0].status, test.runs[0].start_utc) == (
            "running", "running", START
        )  # fmt: skip
        store.append(test_id, 1, scan(2))
        assert len(store.readings(test_id)) == 9


def test_an_abandoned_attempt_stays_and_does_not_count(store_url, tmp_path):
    with open_store(store_url) as store:
        test_id = begun(store)
        for slot in range(4):
            store.append(test_id, 1, scan(slot, segment=slot // 2))
        assert store.mark_attempt(test_id, 1, 1) == 2
        assert store.mark_attempt(test_id, 1, 1) == 2
        assert store.mark_attempt(test_id, 1, 7) == 1
        with pytest.raises(StoreError, match="attempt 1 at segment 1 was abandoned"):
            store.append(test_id, 1, scan(4, segment=1))
        for slot in (2, 3):
            again = scan(slot, attempt=2, segment=1)
            store.append(test_id, 1, [shifted(row) for row in again])
        frame = store.readings(test_id)
        assert len(frame) == 18
        assert (frame["voided"] == "superseded").tolist() == [False] * 6 + [True] * 6 + [False] * 6
        record = export_test(
            store, test_id, tmp_path / "x.csv",
            output_unit="mA", gravity_m_s2=9.81, nominal_scale=1.3,
        )  # fmt: skip
        assert len(record) == 12
        assert record.time_s.max() > 1000


def shifted(row: ReadingRow) -> ReadingRow:
    return replace(row, time_s=row.time_s + 1000)


@pytest.mark.parametrize("name", ["run.csv", "run.parquet"])
def test_export(store_url, tmp_path, name):
    with open_store(store_url) as store:
        test_id = begun(store, 4)
        store.append(test_id, 1, scan(4, output=None, flag="overload"))
        store.append(test_id, 1, scan(5, temp_c=None))
        store.begin_run(test_id, 2, "2026-11-23T22:15:00+00:00")
        store.append(test_id, 2, scan(0))
        given = {"output_unit": "mA", "gravity_m_s2": 9.81, "nominal_scale": 1.3}
        made = export_test(store, test_id, tmp_path / name, **given)
        back = read_runs([tmp_path / name])
        assert back.run_ids == (f"{test_id}-1", f"{test_id}-2")
        assert [back.digest(r) for r in back.run_ids] == [made.digest(r) for r in made.run_ids]
        assert back.run_start_utc[f"{test_id}-1"].isoformat() == START
        assert back.select("A", [f"{test_id}-1"]).flag.text().tolist() == [
            "", "", "", "", "overload", "missing"
        ]  # fmt: skip
        assert (back.output_unit, back.gravity_m_s2, back.nominal_scale) == ("mA", 9.81, 1.3)
        only = export_test(store, test_id, None, serials=["B"], **given)
        assert only.serials == ("B",)
        with pytest.raises(StoreError, match="no readings to export"):
            export_test(store, test_id, tmp_path / "z.csv", serials=["Z"], **given)
        assert not (tmp_path / "z.csv").exists()


def test_one_controller_at_a_time(store_url):
    with open_store(store_url) as store, open_store(store_url) as other:
        test_id = begun(store)
        assert other.is_claimed(test_id)
        with pytest.raises(StoreError, match=rf"is being run by .*{os.getpid()}"):
            other.claim(test_id)
        store.claim(test_id)  # it has it already
        store.finish_test(test_id, "interrupted", "stop")
        assert not other.is_claimed(test_id)
        with other.claim(test_id):
            assert store.is_claimed(test_id)
        assert not store.is_claimed(test_id)


def test_threads_share_a_store(store_url):
    with open_store(store_url) as store:
        test_id = begun(store)
        failures: list[BaseException] = []

        def work(thread: int) -> None:
            try:
                for slot in range(thread * 10, thread * 10 + 10):
                    store.append(test_id, 1, scan(slot))
                    store.last_reading(test_id, 1)
            except BaseException as err:
                failures.append(err)

        threads = [threading.Thread(target=work, args=(i,)) for i in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert failures == []
        assert len(store.readings(test_id)) == 120


def test_a_new_store_may_be_opened_by_several_at_once(store_url):
    failures: list[BaseException] = []
    together = threading.Barrier(4)

    def work() -> None:
        try:
            together.wait()
            open_store(store_url).close()
        except BaseException as err:
            failures.append(err)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failures == []


def test_a_newer_schema_is_refused(store_url):
    with open_store(store_url) as store, store._engine.begin() as connection:
        connection.exec_driver_sql("UPDATE schema_version SET version = 99")
    with pytest.raises(StoreError, match=f"schema version 99, expected {SCHEMA_VERSION}"):
        open_store(store_url)


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("mysql://x/y", "mysql: expected sqlite"),
        ("sqlite://", "in memory"),
        (":memory:", "expected a file name"),
        ("", "expected a file name"),
        ("sqlite:///no/such/folder/x.sqlite", "no such folder"),
        ("postgresql://u:secret@127.0.0.1:1/x", r"127\.0\.0\.1.*refused"),
        ("a://b:c:d", "expected sqlite"),
    ],
)
def test_urls_that_are_no_store(url, words):
    with pytest.raises(StoreError, match=words) as caught:
        open_store(url)
    assert "\n" not in str(caught.value)
    assert "secret" not in str(caught.value)
