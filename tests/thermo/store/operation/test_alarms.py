"""Alarms that latch, and their notices, on both databases."""

from dataclasses import replace

import pytest

from errormodel.errors import StoreError
from tests.thermo.store.short_test import begun
from thermo.store.operation import notices
from thermo.store.operation.alarm_kinds import ALARM_KINDS
from thermo.store.operation.alarms import acknowledge, list_alarms, raise_alarm
from thermo.store.operation.commands import list_commands
from thermo.store.store import open_store


def test_an_alarm_stays_until_somebody_acknowledges_it(store_url):
    with open_store(store_url) as store:
        test_id = begun(store)
        first = raise_alarm(store, "link lost", "multimeter lost", test_id=test_id)
        assert raise_alarm(store, "link lost", "head lost", test_id=test_id, times=3) == first
        other = raise_alarm(store, "late", "slot 3", test_id=test_id)
        one, two = list_alarms(store, test_id, open_only=True)
        assert (one.number, one.text, one.times) == (first, "multimeter lost", 4)
        assert (two.number, two.times) == (other, 1)
        assert one.about is ALARM_KINDS["link lost"]
        assert acknowledge(store, first, who="anna@lab")
        assert not acknowledge(store, first, who="bert@lab")
        assert [a.number for a in list_alarms(store, open_only=True)] == [other]
        again = raise_alarm(store, "link lost", "lost again", test_id=test_id)
        assert again not in (first, other)
        kept = list_alarms(store)[0]
        assert (kept.acknowledged_by, kept.is_open) == ("anna@lab", False)
        (entry,) = [c for c in list_commands(store) if c.action == "acknowledge"]
        assert (entry.who, entry.state, entry.test_id) == ("anna@lab", "done", test_id)
        assert entry.arguments == {"alarm": float(first)}
        with pytest.raises(StoreError, match="alarm 99: there is none"):
            acknowledge(store, 99, who="x")


def test_every_kind_says_what_it_means_and_what_to_do_in_a_sentence_each():
    for name, kind in ALARM_KINDS.items():
        for text in (kind.meaning, kind.remedy):
            assert text[0].isupper(), name
            assert text.endswith("."), name
            assert text.count(". ") == 0, name


def test_a_notice_goes_with_each_new_alarm_and_not_with_its_repetitions(store_url):
    with open_store(store_url) as store:
        number = raise_alarm(store, "finished", "all runs done")
        raise_alarm(store, "finished", "all runs done")
        (notice,) = notices.list_notices(store, waiting_only=True)
        assert (notice.alarm_id, notice.kind, notice.tries) == (number, "finished", 0)
        assert "all runs done" in notice.text
        assert ALARM_KINDS["finished"].remedy in notice.text


def test_a_notice_is_taken_by_one_and_comes_back_when_it_could_not_be_sent(store_url):
    with open_store(store_url) as store:
        raise_alarm(store, "finished", "x")
        taken = notices.take_notice(store)
        assert taken is not None
        assert taken.tries == 1
        assert notices.take_notice(store) is None  # it is being tried
        notices.not_sent(store, taken, frozenset({"aa"}), "refused")
        (kept,) = notices.list_notices(store, waiting_only=True)
        assert (kept.last_error, kept.delivered) == ("refused", frozenset({"aa"}))
        assert kept.next_utc > taken.entered_utc
        notices.sent(store, kept, frozenset({"aa", "bb"}))
        assert notices.list_notices(store, waiting_only=True) == ()
        (sent,) = notices.list_notices(store)
        assert (sent.state, sent.delivered) == ("sent", frozenset({"aa", "bb"}))
        assert sent.sent_utc is not None


def test_a_notice_that_could_not_be_sent_for_a_week_expires(store_url):
    with open_store(store_url) as store:
        raise_alarm(store, "finished", "x")
        taken = notices.take_notice(store)
        assert taken is not None
        old = replace(taken, entered_utc="2020-01-01T00:00:00.000000+00:00")
        notices.not_sent(store, old, frozenset(), "refused")
        (kept,) = notices.list_notices(store)
        assert (kept.state, kept.last_error) == ("expired", "refused")


@pytest.mark.parametrize(
    "statement",
    ["DELETE FROM alarms", "UPDATE alarms SET text = 'y'", "DELETE FROM notices"],
)
def test_the_database_itself_keeps_them(store_url, statement):
    with open_store(store_url) as store:
        raise_alarm(store, "finished", "x")
        with pytest.raises(StoreError, match="kept for good"), store.changing() as connection:
            connection.exec_driver_sql(statement)
        (kept,) = list_alarms(store)
    assert kept.text == "x"
