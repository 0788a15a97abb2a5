"""Pictures of the operator's page for the documents, from an emulated test in a real browser.

    python docs/screenshots.py FOLDER

Needs Chromium and Playwright's Python package (`make setup` installs the latter).
"""

import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

FLAGS = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking"]
SIZES = {"": (1280, 800), "-tablet": (820, 1180)}


def main() -> None:
    out = Path(sys.argv[1]).resolve()
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        sys.exit("no Chromium on this machine")
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        words = [sys.executable, "-m", "accelbench"]
        subprocess.run([*words, "examples", folder], check=True, stdout=subprocess.DEVNULL)
        shutil.copy(Path(__file__).parent / "tutorial/first-night.toml", here / "sequences")
        serve = [
            *words,
            "panel",
            "--port",
            "0",
            "--sequences",
            "sequences",
            "--stations",
            "stations",
        ]
        served = subprocess.Popen(serve, cwd=here, stdout=subprocess.PIPE, text=True)
        assert served.stdout is not None
        url = served.stdout.readline().split()[0].rstrip("/")
        try:
            with sync_playwright() as playwright:
                browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
                page = browser.new_page(
                    base_url=url, viewport={"width": 1280, "height": 800}, color_scheme="light"
                )
                take_all(page, out)
                browser.close()
        finally:
            served.terminate()
            served.wait()


def take_all(page: Page, out: Path) -> None:
    """Go the operator's way once, with a picture of every page."""
    page.goto("/plan")
    option = page.get_by_role("option", name="first-night.toml")
    while not option.is_visible():  # a page that is not connected yet opens nothing
        page.get_by_label("Sequence", exact=True).click()
        time.sleep(2)
    option.click()
    page.get_by_label("Time multiple").fill("120")
    page.get_by_role("button", name="Show the plan").click()
    page.get_by_text("Cannot be separated").wait_for(timeout=120_000)
    take(page, out, "plan")
    page.get_by_role("button", name="Put into the queue").click()
    page.wait_for_url("**/queue")
    page.get_by_role("button", name="Check and arm").click()
    page.get_by_role("button", name="Start", exact=True).wait_for()
    take(page, out, "queue")
    page.get_by_role("button", name="Start", exact=True).click()
    page.wait_for_url("**/test/*", timeout=120_000)
    time.sleep(80)  # the first run
    take(page, out, "live")
    page.get_by_role("button", name="Light or dark").click()
    time.sleep(2)
    page.screenshot(path=out / "panel-live-dark.png")
    page.get_by_role("button", name="Light or dark").click()
    test = page.url
    for name, path in (("tests", "/"), ("alarms", "/alarms"), ("history", "/history")):
        page.goto(path)
        take(page, out, name)
    page.goto(test)
    page.keyboard.press("Escape")
    page.get_by_role("dialog").wait_for()
    time.sleep(1)
    page.screenshot(path=out / "panel-abort.png")
    page.get_by_role("button", name="Abort now").click()
    page.get_by_text("▲ interrupted").wait_for(timeout=60_000)


def take(page: Page, out: Path, name: str) -> None:
    """Take a picture of a page on a desk and on a tablet."""
    for size, (width, height) in SIZES.items():
        page.set_viewport_size({"width": width, "height": height})
        time.sleep(2)
        page.screenshot(path=out / f"panel-{name}{size}.png")
    page.set_viewport_size({"width": 1280, "height": 800})


if __name__ == "__main__":
    main()
