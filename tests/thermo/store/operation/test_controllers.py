"""Heartbeats, on both databases."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta

from tests.thermo.store.short_test import begun
from thermo.store.database import utc_now
from thermo.store.operation.controllers import (
    ControllerBeat,
    end_beat,
    list_beats,
    read_beat,
    write_beat,
)
from thermo.store.store import open_store


def beat_of(test_id: str, **changes: object) -> ControllerBeat:
    now = utc_now()
    made = ControllerBeat(
        test_id=test_id, host="bench", pid=7, pid_start=None, began_utc=now, beat_utc=now
    )
    return replace(made, **changes)


def test_a_beat_takes_the_place_of_the_one_before(store_url):
    with open_store(store_url) as store:
        test_id = begun(store)
        assert read_beat(store, test_id) is None
        write_beat(store, beat_of(test_id))
        second = beat_of(test_id, phase="run", slot=3, chamber_c=21.5, left_s=9.0, last_fault="x")
        write_beat(store, second)
        assert read_beat(store, test_id) == second
        assert list_beats(store) == (second,)


def test_a_beat_that_is_old_is_silent_unless_its_controller_said_that_it_ends():
    old = (datetime.now(UTC) - timedelta(hours=1)).isoformat(timespec="microseconds")
    assert beat_of("t", beat_utc=old).is_silent
    assert not beat_of("t", beat_utc=old, state="ended").is_silent


def test_only_the_beat_that_was_seen_is_called_ended(store_url):
    with open_store(store_url) as store:
        test_id = begun(store)
        seen = beat_of(test_id)
        write_beat(store, seen)
        resumed = beat_of(test_id, pid=8)
        write_beat(store, resumed)
        assert not end_beat(store, seen)
        assert end_beat(store, resumed)
        assert list_beats(store, running_only=True) == ()
