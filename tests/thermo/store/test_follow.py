"""Following a test from another process."""

from dataclasses import replace

from thermo.store import follow
from thermo.store.records import NewTest, ReadingRow
from thermo.store.store import open_store


def test_a_segment_that_is_repeated_is_read_from_the_beginning(tmp_path) -> None:
    with open_store(tmp_path / "s.sqlite") as store:
        test_id = store.begin_test(NewTest(name="x", sequence_toml="", station_json="{}"))
        store.begin_run(test_id, 1, "2026-12-01T00:00:00+00:00")
        row = ReadingRow(serial="A", slot=0, time_s=0.0, temp_c=1.0, position_deg=0.0, output=1.0)
        rows = [replace(row, slot=k, time_s=float(k)) for k in range(4)]
        store.append(test_id, 1, rows)
        first = follow.read_added(store, test_id, follow.Place())
        assert [r.slot for _, r in first.readings] == [0, 1, 2, 3]
        assert follow.read_added(store, test_id, first.place).readings == ()
        attempt = store.mark_attempt(test_id, 1, 0)
        store.append(test_id, 1, [replace(r, attempt=attempt) for r in rows[:2]])
        again = follow.read_added(store, test_id, first.place)
        assert again.afresh
        assert [(r.slot, r.attempt) for _, r in again.readings] == [(0, attempt), (1, attempt)]
