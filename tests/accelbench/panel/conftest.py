"""A real browser on a real page: Debian's Chromium, driven by Playwright."""

import os
import select
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
PATIENCE_S = 60.0  # for what takes a second on an idle machine

SEQUENCE = """
name = "browser test"

[[accelerometers]]
serial = "QA-001"
nominal_scale = 1.3

[temperature]
start_c = 25.0

[[temperature.segments]]
kind = "ramp"
to_c = 45.0
rate_c_per_min = 1.0

[[temperature.segments]]
kind = "ramp"
to_c = 25.0
rate_c_per_min = 1.0

[positions]
angles_deg = [0.0, 90.0, 180.0, 270.0]

[sampling]
period_s = 10.0

[limits]
chamber_c = [15.0, 55.0]
"""


def until(true: Callable[[], object], what: str) -> None:
    """Wait until something is true."""
    give_up_s = time.monotonic() + PATIENCE_S
    while not true():
        assert time.monotonic() < give_up_s, f"never came: {what}"
        time.sleep(0.1)


@dataclass
class Served:
    """A page that is served by a process of its own."""

    folder: Path
    more: tuple[str, ...] = ()
    process: subprocess.Popen[str] | None = None
    url: str = ""
    store: Path = field(init=False)

    def __post_init__(self) -> None:
        self.store = self.folder / "s.sqlite"
        for name in ("sequences", "stations"):
            (self.folder / name).mkdir(exist_ok=True)
        (self.folder / "sequences/small.toml").write_text(SEQUENCE, encoding="utf-8")

    def start(self) -> "Served":
        words = ["panel", "--port", "0", "--store", str(self.store), *self.more]
        words += ["--sequences", "sequences", "--stations", "stations"]
        with (self.folder / "panel.log").open("a") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "accelbench", *words],
                cwd=self.folder,
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
            )
        assert self.process.stdout is not None
        ready, _, _ = select.select([self.process.stdout], [], [], PATIENCE_S)
        line = self.process.stdout.readline() if ready else ""
        assert line.startswith("http"), (self.folder / "panel.log").read_text()
        self.url = line.split()[0].rstrip("/")
        return self

    def end(self, number: int = signal.SIGTERM) -> None:
        if self.process is not None:
            self.process.send_signal(number)
            self.process.wait(PATIENCE_S)
            assert self.process.stdout is not None
            self.process.stdout.close()
            self.process = None


@pytest.fixture(scope="session")
def browser() -> Iterator[object]:
    if CHROMIUM is None:
        how = "no Chromium: apt install chromium has the page tested in a browser"
        if os.environ.get("ACCELBENCH_REQUIRE_CHROMIUM"):
            pytest.fail(how)
        pytest.skip(how)
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        one = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield one
        one.close()


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """One page for the tests of a module; nobody has to log in."""
    one = Served(tmp_path_factory.mktemp("panel")).start()
    yield one
    one.end()
    end_tests(one.store)


def end_tests(store: Path) -> None:
    """Abort what still runs, so that no process is left behind."""
    from thermo.launch.control import ask_controller
    from thermo.store.store import open_store

    with open_store(store) as opened:
        for test_id in opened.running_tests():
            ask_controller(opened, "abort", test_id, who="the end of the tests")


@pytest.fixture
def page(browser, served) -> Iterator[object]:
    context = browser.new_context(viewport={"width": 1280, "height": 800}, base_url=served.url)
    context.set_default_timeout(1000 * PATIENCE_S)
    one = context.new_page()
    one.troubles = []
    one.on("pageerror", lambda err: one.troubles.append(str(err)))
    one.on(
        "request",
        lambda r: (
            r.url.startswith((served.url, "ws", "data:", "blob:"))
            or one.troubles.append(f"left the machine: {r.url}")
        ),
    )
    yield one
    assert one.troubles == []
    context.close()
