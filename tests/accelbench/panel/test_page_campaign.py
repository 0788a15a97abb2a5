"""The page under repeated kills and under an upload without end."""

import http.client
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.accelbench.panel.conftest import Served, end_tests, until
from tests.accelbench.panel.test_pages import begin, readings
from thermo.store.operation.controllers import read_beat
from thermo.store.store import open_store

PIECE = bytes(1 << 20)


def kill_and_look(browser, served: Served, store, test_id: str) -> None:
    """Kill the page, see the test go on without it, and the whole past on a new page."""
    served.end(signal.SIGKILL)
    slot = read_beat(store, test_id).slot
    until(lambda: read_beat(store, test_id).slot > slot, "a reading without a page")
    served.start()
    page = browser.new_page(base_url=served.url)
    page.goto(f"/test/{test_id}")
    until(lambda: readings(page) > slot, "the whole past on a new page")
    page.close()


@pytest.mark.slow  # one kill by default, in test_pages.py
@pytest.mark.timeout(1800)
def test_a_test_goes_on_through_twenty_kills_of_the_page(browser, tmp_path: Path) -> None:
    served = Served(tmp_path).start()
    try:
        page = browser.new_page(base_url=served.url)
        test_id = begin(page, "30")
        until(lambda: readings(page) >= 1, "readings")
        page.close()
        with open_store(served.store) as store:
            for _ in range(20):
                kill_and_look(browser, served, store, test_id)
            assert store.test(test_id).status == "running"
    finally:
        if served.process is not None:
            served.end()
        end_tests(served.store)


def rss_mb(pid: int) -> float:
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    raise AssertionError("no such process")


def pieces(count: int) -> Iterator[bytes]:
    for _ in range(count):
        yield PIECE


# the size that it is told beforehand is refused at once; one that is not is cut off at 2 MB
@pytest.mark.parametrize(
    ("told", "megabytes"),
    [(True, 1024), (False, 64), pytest.param(False, 1024, marks=pytest.mark.slow)],
)
def test_an_upload_without_end_is_refused_and_takes_no_memory(served, told, megabytes) -> None:
    before = rss_mb(served.process.pid)
    host = served.url.removeprefix("http://")
    connection = http.client.HTTPConnection(host, timeout=60)
    headers = {"Origin": served.url, "Content-Type": "application/octet-stream"}
    if told:
        headers["Content-Length"] = str(megabytes << 20)
    status = None
    try:
        body = pieces(1 if told else megabytes)
        path = "/_nicegui/client/x/upload/1"
        connection.request("POST", path, body=body, headers=headers, encode_chunked=not told)
        status = connection.getresponse().status
    except (TimeoutError, BrokenPipeError, ConnectionResetError):
        pass  # cut off while it was still sending
    finally:
        connection.close()
    assert status in (404, 413, None)  # no such address, too large, cut off
    assert rss_mb(served.process.pid) < before + 50
