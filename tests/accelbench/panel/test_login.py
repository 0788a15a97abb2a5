"""Log-ins through the browser: a wrong password, a role that may only look, a log-out."""

from collections.abc import Iterator

import pytest

pytest.importorskip("argon2", reason="pip install 'accelbench[panel]' has the page tested")

from accelbench.panel.access.users import add_user
from tests.accelbench.panel.conftest import Served, until
from thermo.launch.runner import CLAIM
from thermo.store.operation.alarms import raise_alarm
from thermo.store.store import open_store


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A page with two users."""
    folder = tmp_path_factory.mktemp("guarded")
    add_user(folder / "users.toml", "ann", "operate", "correct horse")
    add_user(folder / "users.toml", "bob", "view", "battery staple")
    one = Served(folder, ("--users", "users.toml")).start()
    yield one
    one.end()


def log_in(page, name: str, password: str) -> None:
    page.goto("/queue")
    page.wait_for_url("**/login")
    page.get_by_label("Name").fill(name)
    page.get_by_label("Password").fill(password)
    page.get_by_role("button", name="Log in").click()


def test_who_may_look_sees_the_alarm_and_no_button(browser, guarded: Served) -> None:
    with open_store(guarded.store) as store:
        raise_alarm(store, "sensor", "a thermistor is open")
    page = browser.new_page(base_url=guarded.url)
    log_in(page, "bob", "wrong horse!")
    page.get_by_text("Name or password is wrong.").wait_for()
    log_in(page, "bob", "battery staple")
    page.wait_for_url("**/")
    page.goto("/alarms")
    page.get_by_text("a thermistor is open").first.wait_for()
    assert page.get_by_role("button", name="Acknowledge").count() == 0
    assert page.get_by_role("button", name="Abort (Esc)").count() == 0
    page.get_by_role("button", name="Log out").click()
    page.wait_for_url("**/login")
    page.goto("/alarms")
    page.wait_for_url("**/login")
    page.close()


def test_what_was_done_stands_under_the_name(browser, guarded: Served) -> None:
    page = browser.new_page(base_url=guarded.url)
    log_in(page, "ann", "correct horse")
    page.wait_for_url("**/")
    page.goto("/plan")
    page.get_by_role("button", name="Put into the queue").click()
    page.wait_for_url("**/queue")
    page.get_by_text("planned by ann (page)").wait_for()
    page.goto("/history")
    page.get_by_text("test 1 is planned: browser test").wait_for()
    page.close()


def test_a_page_that_is_ended_ends_the_runner_it_had_started(browser, guarded: Served) -> None:
    with open_store(guarded.store) as store:
        until(lambda: store.is_claimed(CLAIM), "a runner")
        guarded.end()
        until(lambda: not store.is_claimed(CLAIM), "the end of the runner")
