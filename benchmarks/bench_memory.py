"""Peak memory of what takes most of it, each in a process of its own, beside what is aimed at.

    .venv/bin/python benchmarks/bench_memory.py [--rows N] [--readings N] [--folder DIR]

The aims hold for 5·10⁶ rows and 10⁷ readings. The recording is of one accelerometer, the worst
case; the store is filled with bulk inserts straight into its table. It takes some 3 GB of disk.
"""

import argparse
import os
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from errormodel.io.table_write import write_with_sidecar
from thermo.launch.real import load_station
from thermo.store.records import NewTest
from thermo.store.store import open_store

EXAMPLES = Path(__file__).parent.parent / "examples"
COMMAND = [sys.executable, "-c", "from accelbench.cli import main; raise SystemExit(main())"]
SIDECAR = 'output_unit = "mA"\ngravity_m_s2 = 9.81\nnominal_scale = 1.25\n'
PIECE = 100_000


def tumbled(run: int, begin: int, n: int, rows_of_run: int) -> pd.DataFrame:
    """Return readings of one accelerometer, tumbled on a ramp that goes up and down again."""
    rng = np.random.default_rng([run, begin])
    time_s = np.arange(begin, begin + n, dtype=float)
    temp_c = np.interp(time_s, [0, rows_of_run / 2, rows_of_run], [-40.0, 60.0, -40.0])
    temp_c = np.round(temp_c + 0.002 * rng.standard_normal(n), 4)
    position_deg = (np.arange(begin, begin + n) // 8 % 4) * 90.0
    x = temp_c - 25.0
    output = 1.25 * (1.002 + 8e-5 * x) * (-4e-4 - 7e-6 * x + np.sin(np.deg2rad(position_deg)))
    return pd.DataFrame(
        {
            "run": f"r{run}",
            "serial": "QA-001",
            "time_s": time_s,
            "temp_c": temp_c,
            "position_deg": position_deg,
            "output": np.round(output + 6e-6 * rng.standard_normal(n), 9),
        }
    )


def make_recording(path: Path, rows: int, runs: int = 4) -> None:
    """Write a recording of some runs."""
    of_run = rows // runs
    pieces = (
        tumbled(run, begin, min(PIECE, of_run - begin), of_run)
        for run in range(runs)
        for begin in range(0, of_run, PIECE)
    )
    write_with_sidecar(pieces, SIDECAR, path)


def make_store(path: Path, readings: int) -> str:
    """Fill a store with a test of three accelerometers and return the test's id."""
    sequence = (EXAMPLES / "sequences" / "overnight.toml").read_text(encoding="utf-8")
    station = load_station(EXAMPLES / "stations" / "f4.toml").model_dump_json()
    with open_store(path) as store:
        test_id = store.begin_test(NewTest("benchmark", sequence, station))
        store.begin_run(test_id, 1, "2026-11-22T22:15:00+00:00")
        store.finish_run(test_id, 1, "finished")
        store.finish_test(test_id, "finished", "")
    names = (
        "test_id,run,slot,attempt,serial,segment,time_s,temp_c,position_deg,output,chamber_c,flag"
    )
    db = sqlite3.connect(path)
    db.execute("PRAGMA synchronous=OFF")
    rows = stored_rows(test_id, readings)
    while piece := list(islice(rows, PIECE)):
        with db:
            db.executemany(f"INSERT INTO readings ({names}) VALUES ({'?,' * 11}?)", piece)
    db.close()
    return test_id


def stored_rows(test_id: str, readings: int) -> Iterator[tuple[object, ...]]:
    """Yield rows of the table of readings."""
    rng, noise = np.random.default_rng(1), list[float]()
    for slot in range(-(-readings // 3)):
        if slot % PIECE == 0:
            noise = rng.standard_normal(3 * PIECE).tolist()
        position_deg = 90.0 * (slot // 8 % 4)
        for k in range(3):
            output = noise[3 * (slot % PIECE) + k]
            time_s, serial = 2.0 * slot + 0.2 * k, f"QA-00{k + 1}"
            yield (test_id, 1, slot, 1, serial, 0, time_s, 20.0, position_deg, output, 20.0, "")


def make_bomb(path: Path, groups: int = 100, rows: int = 1_000_000) -> None:
    """Write Parquet of many equal rows: a few kilobytes that stand for gigabytes."""
    text = pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, np.int32)), ["A"])
    number = pa.array(np.zeros(rows))
    group = pa.table(
        {"run": text, "serial": text, "time_s": number, "temp_c": number, "output": number}
    )
    with pq.ParquetWriter(path, group.schema) as writer:
        for _ in range(groups):
            writer.write_table(group)
    path.with_suffix(".toml").write_text(SIDECAR, encoding="utf-8")


def make_sparse(path: Path, size: int = 40_000_000_000) -> None:
    """Write a CSV that begins soundly and has a hole of many gigabytes."""
    make_recording(path, 4_000)
    os.truncate(path, size)


def peak(arguments: list[str], *, exit_code: int = 0) -> tuple[float, float, str]:
    """Run a command; return its peak memory, MB, how long it took, s, and its error's text."""
    # a small process between: a child's peak counts what its parent had when it was forked
    code = (
        "import resource, subprocess, sys\n"
        "done = subprocess.run(sys.argv[1:], capture_output=True, text=True)\n"
        "used = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss\n"
        "print(used, done.returncode, done.stderr.strip()[-300:], sep='\\t')\n"
    )
    begun = time.perf_counter()
    told = subprocess.run(
        [sys.executable, "-c", code, *COMMAND, *arguments],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    took = time.perf_counter() - begun
    rss_kib, returned, error = told.split("\t", 2)
    if int(returned) != exit_code:
        raise SystemExit(f"{' '.join(arguments)}: exit code {returned}: {error}")
    return int(rss_kib) * 1024 / 1e6, took, error.strip()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, default=5_000_000)
    parser.add_argument("--readings", type=int, default=10_000_000)
    parser.add_argument("--folder", type=Path, default=Path())
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=asked.folder, prefix="bench-memory-") as name:
        folder = Path(name)
        print(f"{'what':<44}{'peak MB':>9}{'aim MB':>8}{'s':>7}")

        def tell(what: str, arguments: list[str], aim_mb: float, exit_code: int = 0) -> None:
            mb, took, error = peak(arguments, exit_code=exit_code)
            print(f"{what:<44}{mb:>9.0f}{aim_mb:>8.0f}{took:>7.1f}  {error if exit_code else ''}")

        tell("the program alone (--help)", ["fit", "--help"], 300)
        for suffix in (".csv", ".parquet"):
            recording = folder / f"run{suffix}"
            make_recording(recording, asked.rows)
            tell(f"fit of {asked.rows} rows, {suffix[1:]}", ["fit", str(recording)], 1500)
            recording.unlink()
        store = folder / "night.sqlite"
        test_id = make_store(store, asked.readings)
        for suffix in (".csv", ".parquet"):
            out = folder / f"export{suffix}"
            told = ["export", test_id, "--store", str(store), "--out", str(out)]
            tell(f"export of {asked.readings} readings, {suffix[1:]}", told, 500)
            out.unlink()
            out.with_suffix(".toml").unlink()
        store.unlink()
        make_bomb(folder / "bomb.parquet")
        tell("refusal of 1e8 equal rows in Parquet", ["fit", str(folder / "bomb.parquet")], 300, 2)
        make_sparse(folder / "sparse.csv")
        tell("refusal of 40 GB of CSV with a hole", ["fit", str(folder / "sparse.csv")], 300, 2)


if __name__ == "__main__":
    main()
