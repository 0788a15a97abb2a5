"""Planned tests and their states, on both databases."""

import pytest

from errormodel.errors import StoreError
from tests.thermo.store.short_test import begun
from thermo.store.operation.commands import list_commands
from thermo.store.operation.planned import (
    arm_test,
    begin_starting,
    end_planned,
    has_begun,
    list_planned,
    plan_test,
    read_planned,
    refuse_start,
    withdraw_test,
)
from thermo.store.store import Store, open_store


def planned(store: Store, after: int | None = None) -> int:
    return plan_test(store, name="night", sequence_toml="x = 1", who="anna@lab", after=after)


def test_a_planned_test_goes_from_planned_to_its_end_and_who_did_it_is_kept(store_url):
    with open_store(store_url) as store:
        test_id, number = begun(store), planned(store)
        with pytest.raises(StoreError, match="is planned, expected armed"):
            begin_starting(store, number)
        arm_test(store, number, who="bert@lab")
        assert begin_starting(store, number).armed_by == "bert@lab"
        with pytest.raises(StoreError, match="is starting, expected armed"):
            begin_starting(store, number)  # the second that asks
        has_begun(store, number, test_id)
        assert read_planned(store, number).test_id == test_id
        end_planned(store, number, "interrupted", "aborted by bert")
        with pytest.raises(StoreError, match="is interrupted, expected planned or armed"):
            arm_test(store, number, who="bert@lab")  # it never starts again
        end_planned(store, number, "finished", "all runs done")  # its test was resumed
        assert read_planned(store, number).state == "finished"
        assert list_planned(store, open_only=True) == ()
        history = [(c.action, c.who) for c in list_commands(store)]
    assert history == [("plan", "anna@lab"), ("arm", "bert@lab")]


def test_one_that_was_refused_has_to_be_armed_anew(store_url):
    with open_store(store_url) as store:
        number = planned(store)
        arm_test(store, number, who="a")
        begin_starting(store, number)
        refuse_start(store, number, "the chamber is in use")
        assert read_planned(store, number).outcome == "the chamber is in use"
        with pytest.raises(StoreError, match="is refused, expected armed"):
            begin_starting(store, number)
        arm_test(store, number, who="a")
        begin_starting(store, number)


def test_nothing_follows_what_will_never_come_to_a_good_end(store_url):
    with open_store(store_url) as store:
        first = planned(store)
        second = planned(store, after=first)
        assert read_planned(store, second).after_id == first
        withdraw_test(store, first, who="a")
        with pytest.raises(StoreError, match="is withdrawn, none follows it"):
            planned(store, after=first)
        with pytest.raises(StoreError, match="planned test 99: there is none"):
            planned(store, after=99)
        with pytest.raises(StoreError, match="is withdrawn, expected planned"):
            withdraw_test(store, first, who="a")
