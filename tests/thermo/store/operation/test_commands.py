"""The queue of commands, on both databases."""

from concurrent.futures import ThreadPoolExecutor

import pytest

from errormodel.errors import StoreError
from tests.thermo.store.short_test import begun
from thermo.store.operation.commands import (
    OF_CONTROLLERS,
    answer,
    ask,
    list_commands,
    read_command,
    refuse_left,
    take_next,
    withdraw,
)
from thermo.store.store import open_store


def test_a_command_is_asked_taken_and_answered_and_stays(store_url):
    with open_store(store_url) as store:
        test_id = begun(store)
        given = {"reason": "a look", "planned": 3.0, "hard": True}
        number = ask(store, "pause", who="anna@lab", test_id=test_id, arguments=given)
        assert read_command(store, number).state == "waiting"
        taken = take_next(store, by="process 1", actions=OF_CONTROLLERS, test_id=test_id)
        assert taken is not None
        assert (taken.number, taken.action, taken.state) == (number, "pause", "taken")
        assert dict(taken.arguments) == given
        assert taken.arguments["hard"] is True
        assert take_next(store, by="process 2", actions=OF_CONTROLLERS) is None
        assert answer(store, number, "done", "paused at 20 °C")
        assert not answer(store, number, "refused", "too late")  # it has its answer
    with open_store(store_url) as store:
        (kept,) = list_commands(store)
    assert (kept.who, kept.taken_by, kept.outcome) == ("anna@lab", "process 1", "paused at 20 °C")
    assert kept.asked_utc <= str(kept.taken_utc) <= str(kept.answered_utc)


def test_the_oldest_is_taken_first_and_only_of_the_test_and_the_kind_asked_for(store_url):
    with open_store(store_url) as store:
        one, other = begun(store), begun(store)
        first = ask(store, "pause", who="a", test_id=one)
        ask(store, "abort", who="b", test_id=one)
        ask(store, "pause", who="c", test_id=other)
        start = ask(store, "start", who="d")
        taken = take_next(store, by="x", actions=OF_CONTROLLERS, test_id=one)
        assert taken is not None
        assert taken.number == first
        found = take_next(store, by="runner", actions=("start",))
        assert found is not None
        assert (found.number, found.test_id) == (start, None)
        assert [c.state for c in list_commands(store, one)] == ["taken", "waiting"]
        assert [c.who for c in list_commands(store, newest=2)] == ["c", "d"]


def test_no_two_that_ask_get_the_same_command(store_url):
    with open_store(store_url) as store:
        asked = {ask(store, "pause", who="a") for _ in range(12)}

        def take_all(by: str) -> list[int]:
            found = []
            while (one := take_next(store, by=by, actions=OF_CONTROLLERS)) is not None:
                found.append(one.number)
            return found

        with ThreadPoolExecutor(3) as pool:
            parts = list(pool.map(take_all, ("x", "y", "z")))
    together = sorted(number for part in parts for number in part)
    assert together == sorted(asked)


def test_what_was_taken_cannot_be_withdrawn_and_what_is_left_is_refused(store_url):
    with open_store(store_url) as store:
        test_id = begun(store)
        first, second = (ask(store, "pause", who="a", test_id=test_id) for _ in range(2))
        take_next(store, by="x", actions=OF_CONTROLLERS)
        assert not withdraw(store, first, "nobody there")
        assert withdraw(store, second, "nobody there")
        assert refuse_left(store, test_id, "the test has ended") == 1
        assert [c.outcome for c in list_commands(store)] == ["the test has ended", "nobody there"]


@pytest.mark.parametrize(
    "statement",
    [
        "DELETE FROM commands",
        "UPDATE commands SET who = 'x'",
        "UPDATE commands SET action = 'abort'",
        "DELETE FROM command_arguments",
        "UPDATE command_arguments SET text = 'x'",
    ],
)
def test_the_database_itself_keeps_who_asked_for_what(store_url, statement):
    with open_store(store_url) as store:
        ask(store, "pause", who="a", arguments={"reason": "r"})
        refused = pytest.raises(StoreError, match=r"kept for good|only added")
        with refused, store.changing() as connection:
            connection.exec_driver_sql(statement)
        (kept,) = list_commands(store)
    assert (kept.who, kept.action, kept.arguments) == ("a", "pause", {"reason": "r"})


def test_a_command_without_a_name_or_of_no_test_is_refused(store_url):
    with open_store(store_url) as store:
        with pytest.raises(StoreError, match="nobody asks it"):
            ask(store, "pause", who=" ")
        with pytest.raises(StoreError):
            ask(store, "pause", who="a", test_id="20260101T000000-0000")
        with pytest.raises(StoreError, match="command 7: there is none"):
            read_command(store, 7)
        assert list_commands(store) == ()
