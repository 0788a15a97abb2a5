"""Sustained rate of acknowledged readings: scans of a few accelerometers, each durable on return.

    python benchmarks/bench_store.py [URL] [--accelerometers 3] [--scans 2000]

Without a URL it uses an SQLite file in a folder of its own under the current one, for the disk that
counts is the one that data go to. The line "fsync alone" says what the disk itself takes.
"""

import argparse
import os
import tempfile
import time
from pathlib import Path

import numpy as np

from thermo.store.records import NewTest, ReadingRow
from thermo.store.store import open_store


def fsync_alone_s(folder: Path, count: int = 200) -> float:
    took = []
    with open(folder / "probe", "wb") as file:
        for _ in range(count):
            began = time.perf_counter()
            file.write(b"x" * 4096)
            file.flush()
            os.fsync(file.fileno())
            took.append(time.perf_counter() - began)
    return float(np.median(took))


def measure(url: str, accelerometers: int, scans: int) -> None:
    took = np.empty(scans)
    serials = [f"QA-{i}" for i in range(accelerometers)]
    with open_store(url) as store:
        test_id = store.begin_test(NewTest("benchmark", "", "{}"))
        store.begin_run(test_id, 1, "2026-11-22T22:15:00+00:00")
        for slot in range(scans):
            rows = [
                ReadingRow(
                    serial=serial,
                    slot=slot,
                    time_s=10.0 * slot,
                    temp_c=-40 + slot / scans,
                    position_deg=90.0 * (slot % 4),
                    output=1.25 / (slot + 1),
                    chamber_c=-40.0,
                    lateness_s=0.0,
                )
                for serial in serials
            ]
            began = time.perf_counter()
            store.append(test_id, 1, rows)
            took[slot] = time.perf_counter() - began
        store.finish_test(test_id, "finished", "")
    rate = accelerometers * scans / took.sum()
    median, p99, worst = 1e3 * np.array([*np.percentile(took, [50, 99]), took.max()])
    print(
        f"{accelerometers} accelerometers, {scans} scans: {rate:.0f} readings/s; a scan takes "
        f"{median:.2f} ms (median), {p99:.2f} ms (p99), {worst:.2f} ms (worst)"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("url", nargs="?")
    parser.add_argument("--accelerometers", type=int, default=3)
    parser.add_argument("--scans", type=int, default=2000)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=".", prefix="bench-store-") as name:
        folder = Path(name)
        print(f"fsync alone: {1e3 * fsync_alone_s(folder):.2f} ms (median)")
        url = asked.url or f"sqlite:///{folder / 'bench.sqlite'}"
        measure(url, asked.accelerometers, asked.scans)


if __name__ == "__main__":
    main()
