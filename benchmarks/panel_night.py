"""A night watched through the operator's page: memory, latency, and readings late because of it.

    python -m benchmarks.panel_night [--minutes 20] [--speed 40]

Sixteen emulated accelerometers are read every 10 s of test time at a multiple of real time. First
the test runs with a page open in Chromium, then for a quarter of the time without any. Printed:
memory of the server and of the tab after warm-up and at the end, the latency from a reading's entry
in the store to its figure on the page, and the lateness of the scans with and without the page.
"""

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright

from thermo.launch.control import ask_controller
from thermo.store.operation.planned import list_planned
from thermo.store.store import open_store

FLAGS = ["--headless", "--no-sandbox", "--disable-gpu", "--enable-precise-memory-info"]
ACCELEROMETERS = 16
COUNT = "select count(*) from readings"
WATCH = """
() => {
  window.seen = [];
  const box = [...document.querySelectorAll('.figure')].find(
    f => f.querySelector('.name').textContent === 'readings').querySelector('.value');
  new MutationObserver(() => window.seen.push([Date.now() / 1000, parseInt(box.textContent)]))
    .observe(box, {childList: true, characterData: true, subtree: true});
}
"""


def sequence(hours: float) -> str:
    """Return a sequence of slow ramps that lasts for so long."""
    serials = "".join(
        f'[[accelerometers]]\nserial = "QA-{k:03d}"\nnominal_scale = 1.3\n'
        for k in range(1, ACCELEROMETERS + 1)
    )
    return f"""name = "night"
{serials}
[temperature]
start_c = 25.0

[[temperature.segments]]
kind = "cycle"
low_c = 20.0
high_c = 60.0
rate_c_per_min = 1.0
count = {int(hours / 1.3) + 1}

[positions]
angles_deg = [0.0, 90.0, 180.0, 270.0]
[sampling]
period_s = 10.0
settle_s = 0.2
"""


def rss_mb(pid: int) -> float:
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    return float("nan")


class Entries(threading.Thread):
    """Notes when the store had how many readings."""

    def __init__(self, store: Path) -> None:
        super().__init__(daemon=True)
        self.store, self.seen, self.stop = store, list[tuple[float, int]](), threading.Event()

    def run(self) -> None:
        with open_store(self.store) as opened:
            while not self.stop.wait(0.05):
                with opened.snapshot() as connection:
                    count = int(connection.exec_driver_sql(COUNT).scalar_one())
                if not self.seen or count != self.seen[-1][1]:
                    self.seen.append((time.time(), count))


def lateness_s(store: Path, test_id: str, speed: float) -> np.ndarray:
    """Return how late scans were, in real seconds."""
    with open_store(store) as opened:
        frame = opened.readings(test_id)
    late = frame.drop_duplicates(["run", "slot"])["lateness_s"].dropna().to_numpy()
    return late[5:] / speed  # the first ones wait for compilation


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--speed", type=float, default=40.0)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        print(json.dumps(measure(Path(folder), given.minutes, given.speed), indent=2))


def measure(folder: Path, minutes: float, speed: float) -> dict[str, object]:
    store = folder / "s.sqlite"
    for name in ("sequences", "stations"):
        (folder / name).mkdir()
    hours = 1.4 * minutes / 60 * speed
    (folder / "sequences/night.toml").write_text(sequence(hours), encoding="utf-8")
    words = [sys.executable, "-m", "accelbench", "panel", "--port", "0", "--store", str(store)]
    words += ["--sequences", "sequences", "--stations", "stations"]
    served = subprocess.Popen(words, cwd=folder, stdout=subprocess.PIPE, text=True)
    assert served.stdout is not None
    url = served.stdout.readline().split()[0].rstrip("/")
    try:
        told = watched(folder, store, url, served.pid, minutes, speed)
    finally:
        served.terminate()
        served.wait()
    with open_store(store) as opened:
        (test_id,) = opened.running_tests()
    time.sleep(60 * minutes / 4)
    with open_store(store) as opened:
        last = opened.test(test_id)
        ask_controller(opened, "abort", test_id, who="benchmark")
        readings = len(opened.readings(test_id))
    late = lateness_s(store, test_id, speed)
    cut = told.pop("scans_watched")
    assert isinstance(cut, int)
    for name, part in (("with the page", late[:cut]), ("without", late[cut:])):
        told[f"lateness {name}, ms: median, p95, largest"] = [
            round(1000 * float(v), 1)
            for v in (np.median(part), np.quantile(part, 0.95), part.max())
        ]
    return {"readings": readings, "runs": len(last.runs)} | told


def watched(
    folder: Path, store: Path, url: str, pid: int, minutes: float, speed: float
) -> dict[str, object]:
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        page = browser.new_page(base_url=url)
        page.set_default_timeout(120_000)
        page.goto("/plan")
        page.get_by_label("Time multiple").fill(f"{speed:g}")
        page.get_by_role("button", name="Put into the queue").click()
        page.wait_for_url("**/queue")
        page.get_by_role("button", name="Check and arm").click()
        page.get_by_role("button", name="Start", exact=True).click()
        page.wait_for_url("**/test/*")
        page.locator(".figure").first.wait_for()
        page.evaluate(WATCH)
        entries = Entries(store)
        entries.start()
        heap = page.context.new_cdp_session(page)
        memory: list[tuple[float, float, float]] = []
        begin_s = time.monotonic()
        while (passed_s := time.monotonic() - begin_s) < 60 * minutes:
            heap.send("HeapProfiler.collectGarbage")
            used = float(page.evaluate("performance.memory.usedJSHeapSize")) / 1e6
            memory.append((passed_s / 60, rss_mb(pid), used))
            page.wait_for_timeout(15_000)
        seen = page.evaluate("window.seen")
        entries.stop.set()
        browser.close()
    with open_store(store) as opened:
        scans = len(opened.readings(list_planned(opened)[0].test_id or "")) // ACCELEROMETERS
    at = np.array(memory)
    warm = at[:, 0] > minutes / 4
    counts = np.array([c for _, c in entries.seen])
    times = np.array([t for t, _ in entries.seen])
    latency = [
        t - times[min(np.searchsorted(counts, count), len(times) - 1)] for t, count in seen if count
    ]
    slope = [float(np.polyfit(at[warm, 0], at[warm, k], 1)[0]) for k in (1, 2)]
    return {
        "scans_watched": scans - 5,
        "server, MB after warm-up and at the end": [round(v, 1) for v in at[warm, 1][[0, -1]]],
        "tab, MB after warm-up and at the end": [round(v, 1) for v in at[warm, 2][[0, -1]]],
        "MB per minute: server, tab": [round(v, 3) for v in slope],
        "figure changes": len(latency),
        "latency, s: median, p95, largest": [
            round(float(v), 2)
            for v in (np.median(latency), np.quantile(latency, 0.95), max(latency))
        ],
    }


if __name__ == "__main__":
    main()
