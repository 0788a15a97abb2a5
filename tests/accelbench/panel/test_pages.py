"""The page in a browser: a test from plan to abort, and whatever is closed or killed meanwhile."""

import json
import os
import re
import signal

import pytest

from tests.accelbench.panel.conftest import PATIENCE_S, Served, until
from thermo.store.operation.alarms import list_alarms, raise_alarm
from thermo.store.operation.commands import list_commands
from thermo.store.operation.controllers import list_beats, read_beat
from thermo.store.operation.planned import list_planned
from thermo.store.store import open_store

PAGES = ("/", "/plan", "/queue", "/alarms", "/results", "/history")


def begin(page, speed: str = "20") -> str:
    """Plan, arm and start a test through the page, and return its id."""
    page.goto("/plan")
    page.get_by_label("Time multiple").fill(speed)
    page.get_by_role("button", name="Put into the queue").click()
    page.wait_for_url("**/queue")
    page.get_by_role("button", name="Check and arm").click()
    page.get_by_role("button", name="Start", exact=True).click()
    page.wait_for_url("**/test/*")
    return page.url.rpartition("/")[2]


def figure(page, name: str) -> str:
    box = page.locator(".figure", has=page.get_by_text(name, exact=True))
    return str(box.locator(".value").inner_text())


def readings(page) -> int:
    if not page.locator(".figure").count():
        return 0
    told = figure(page, "readings").split()[0]
    return int(told) if told.isdigit() else 0


def abort(page, reason: str) -> None:
    page.keyboard.press("Escape")
    dialog = page.get_by_role("dialog")
    dialog.get_by_label("Reason (kept with the test)").fill(reason)
    dialog.get_by_role("button", name="Abort now").click()


def test_a_test_is_planned_started_watched_aborted_and_gone_on_with(page, served: Served) -> None:
    test_id = begin(page)
    until(lambda: readings(page) >= 5, "readings")
    assert page.locator("canvas").count() >= 3
    assert re.search(r"\d+\.\d\d °C", figure(page, "chamber"))
    assert page.get_by_text("K0 at 25 °C, µg").count() == 1
    abort(page, "a cable has moved")
    page.get_by_text("▲ interrupted").wait_for()
    with open_store(served.store) as store:
        test = store.test(test_id)
        command = list_commands(store, test_id)[-1]
    assert json.loads(test.safe_result_json)["verified"] is True
    assert (command.action, command.state) == ("abort", "done")
    assert command.arguments == {"reason": "a cable has moved"}
    page.get_by_role("button", name="Go on with this test").click()
    page.get_by_text("The interrupted segment is repeated").wait_for()
    page.get_by_role("button", name="Go on", exact=True).click()
    page.get_by_text("▶ running").first.wait_for()
    page.get_by_role("button", name="Pause").click()
    until(lambda: figure(page, "phase") == "pause", "a pause")
    page.get_by_role("button", name="Resume").click()
    until(lambda: figure(page, "phase") != "pause", "going on")
    abort(page, "enough")
    page.get_by_text("▲ interrupted").wait_for()
    page.goto("/queue")
    with open_store(served.store) as store:
        assert [p.state for p in list_planned(store)] == ["interrupted"]


def test_closing_and_killing_the_page_leave_the_test_running(page, browser, served) -> None:
    test_id = begin(page)
    until(lambda: readings(page) >= 2, "readings")
    other = browser.new_page(base_url=served.url)
    other.goto(f"/test/{test_id}")
    until(lambda: readings(other) >= 2, "readings on a second page")
    page.goto("about:blank")  # closed
    before = readings(other)
    until(lambda: readings(other) > before, "readings after a page was closed")
    served.end(signal.SIGKILL)
    with open_store(served.store) as store:
        slot = read_beat(store, test_id).slot
        until(lambda: read_beat(store, test_id).slot > slot + 1, "readings without a page")
    served.start()
    other.goto(f"{served.url}/test/{test_id}")
    until(lambda: readings(other) > before, "the whole past on a new page")
    other.get_by_role("button", name="Abort (Esc)").click()
    other.get_by_role("button", name="Abort now").click()
    other.get_by_text("▲ interrupted").wait_for()
    other.close()


def test_a_killed_controller_is_told_within_seconds(page, browser, served: Served) -> None:
    fresh = browser.new_page(base_url=served.url)
    test_id = begin(fresh)
    until(lambda: readings(fresh) >= 1, "readings")
    with open_store(served.store) as store:
        beat = next(b for b in list_beats(store) if b.test_id == test_id)
    os.kill(beat.pid, signal.SIGKILL)
    fresh.get_by_text("Controller lost").first.wait_for()
    fresh.get_by_text("▲ interrupted").wait_for()
    fresh.close()


def test_an_alarm_stays_until_it_is_acknowledged_and_who_did_it_is_kept(browser, served) -> None:
    with open_store(served.store) as store:
        number = raise_alarm(store, "link lost", "<b>multimeter</b> does not answer")
    one = browser.new_page(base_url=served.url)
    for _ in range(2):  # it is still there when the page is opened again
        one.goto("/alarms")
        card = one.locator(".strip", has_text=f"{number} · Instrument lost")
        card.get_by_text("<b>multimeter</b>").wait_for()  # text, not HTML
        assert "See to its power and cable" in card.inner_text()
    card.get_by_role("button", name="Acknowledge").click()
    card.wait_for(state="detached")
    with open_store(served.store) as store:
        (alarm,) = [a for a in list_alarms(store) if a.number == number]
    assert alarm.acknowledged_by
    one.goto("/history")
    one.get_by_text(f"alarm {number}: acknowledged").first.wait_for()
    one.close()


def test_the_form_makes_a_file_that_is_shown_and_kept(browser, served: Served) -> None:
    one = browser.new_page(base_url=served.url)
    one.goto("/plan")
    one.get_by_text("Fill in a form").click()
    one.get_by_label("Rate, °C/min").fill("fast")
    one.get_by_label("Keep as file").fill("made.toml")
    one.get_by_role("button", name="Make the file").click()
    one.get_by_text("'fast', expected a number").wait_for()
    one.get_by_label("Rate, °C/min").fill("2")
    one.get_by_role("button", name="Make the file").click()
    one.get_by_text("made.toml is kept").wait_for()
    one.get_by_text("What it will show").wait_for()
    assert "rate_c_per_min = 2.0" in (served.folder / "sequences/made.toml").read_text()
    one.get_by_label("Keep as file").fill("../made.toml")
    one.get_by_role("button", name="Make the file").click()
    one.get_by_text("expected letters, digits").wait_for()
    assert not (served.folder / "made.toml").exists()
    one.close()


@pytest.mark.parametrize(
    ("name", "content"),
    [("rubbish.toml", os.urandom(4000)), ("other.toml", b'name = "x"\nexec = "rm -rf"\n')],
)
def test_rubbish_that_is_uploaded_is_refused_in_a_line(browser, served, name, content) -> None:
    one = browser.new_page(base_url=served.url)
    one.goto("/plan")
    one.get_by_text("Upload a file").click()
    one.locator("input[type=file]").set_input_files(
        {"name": name, "mimeType": "text/plain", "buffer": content}
    )
    one.locator(".q-notification", has_text=name).wait_for()
    assert not (served.folder / "sequences" / name).exists()
    one.close()


@pytest.mark.parametrize("dark", [False, True])
def test_axe_finds_nothing_serious_on_any_page(browser, served: Served, dark: bool) -> None:
    from axe_playwright_python.sync_playwright import Axe

    one = browser.new_page(base_url=served.url, color_scheme="dark" if dark else "light")
    with open_store(served.store) as store:
        tests = [f"/test/{t.id}" for t in store.tests()[:1]]
    for path in (*PAGES, *tests):
        one.goto(path)
        one.locator(".card, .strip").first.wait_for()
        one.wait_for_timeout(700)
        found = Axe().run(one).response["violations"]
        serious = [v for v in found if v["impact"] in ("serious", "critical")]
        told = [(v["id"], [n["html"][:200] for n in v["nodes"][:3]]) for v in serious]
        assert told == [], path
    one.close()


def test_ticked_tests_are_fitted_and_the_report_opens_as_page_and_pdf(browser, served) -> None:
    one = browser.new_page(base_url=served.url)
    one.set_default_timeout(1000 * PATIENCE_S)
    with open_store(served.store) as store:
        before = {t.id for t in store.tests()}
    test_id = begin(one, speed="")  # as fast as can be
    assert test_id not in before
    one.get_by_text("✔ finished").wait_for()
    one.goto("/")
    one.get_by_label("Search serial").fill("QA-001 browser")
    one.get_by_role("link", name=test_id).first.wait_for()
    one.get_by_label("Search serial").fill("QA-999")
    one.get_by_text("no test", exact=True).wait_for()
    one.get_by_label("Tick tests").click()
    one.get_by_role("option", name=test_id).click()
    one.keyboard.press("Escape")
    one.get_by_role("button", name="Fit", exact=True).click()
    one.wait_for_url("**/results")
    one.get_by_text("✔ done").first.wait_for()
    one.get_by_text("K0 ", exact=False).first.wait_for()
    link = one.get_by_role("link", name="report.html").first.get_attribute("href")
    report = one.request.get(link)
    assert report.ok
    assert "Temperature model of QA-001" in report.text()
    printed = one.request.get(link.replace(".html", ".pdf"))
    assert printed.ok
    assert printed.body()[:5] == b"%PDF-"
    table = one.request.get(f"/recorded/{test_id}.csv")
    assert table.ok
    assert table.text().startswith("run,serial,time_s")
    for bad in ("/result/../x/job.json", "/result/x/..%2f..%2fs.sqlite", "/recorded/none.csv"):
        assert one.request.get(bad).status == 404, bad
    one.close()
