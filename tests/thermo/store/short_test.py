"""A short test in a store: its scans, and a run that has begun."""

from thermo.store.records import NewTest, ReadingRow
from thermo.store.store import Store

SERIALS = ("A", "B", "C")
NEW = NewTest("night", 'name = "night"\n', "{}", {"accelbench": "0.1"}, {"chamber": {"pid": 1.5}})
START = "2026-11-22T22:15:00+00:00"


def scan(slot: int, attempt: int = 1, segment: int = 0, **changes: object) -> list[ReadingRow]:
    return [
        ReadingRow(
            **{
                "serial": serial,
                "slot": slot,
                "attempt": attempt,
                "segment": segment,
                "time_s": 10.0 * slot + 0.1 * i,
                "temp_c": -40 + slot / 7,
                "position_deg": 90.0 * (slot % 4),
                "output": 1 / 3 + slot + i,
                "chamber_c": -40.0,
                "lateness_s": 0.001,
                **changes,
            }
        )
        for i, serial in enumerate(SERIALS)
    ]


def begun(store: Store, scans: int = 0) -> str:
    test_id = store.begin_test(NEW)
    store.begin_run(test_id, 1, START, 123.5)
    for slot in range(scans):
        store.append(test_id, 1, scan(slot))
    return test_id
