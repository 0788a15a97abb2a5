"""One run of the campaign: a bench, a controller, and what came of it."""

import json
import math
import os
import random
import signal
import socket
import sqlite3
import subprocess
import sys
import time
from contextlib import closing, suppress
from pathlib import Path

import psycopg
import psycopg.rows

from tests.thermo.station.campaign.controller import Process
from tests.thermo.station.there_and_stay import there_and_stay

HERE = Path(__file__).parent
SPEED = 60.0
SILENCE_S = 4.0  # of controllers that are stopped; else it follows from the station file, real s
SAFE_C = 25.0
SERIALS = ("QA-001", "QA-002")
SLOTS = 16

SEQUENCE = there_and_stay(
    serials=SERIALS,
    start_c=22.0,
    hold_min=1.25,
    to_c=24.5,
    rate_c_per_min=1.6667,
    stay_min=1.25,
    period_s=15.0,
    angles_deg=(0.0, 90.0, 180.0, 270.0),
    # half the slots may be bad: a loaded machine misses some at this speed
    more="""settle_s = 0.5
[limits]
max_deviation_c = 1.5
max_deviation_min = 1.0
stuck_c = 1.0
max_failure_s = 60.0
max_bad_share = 0.5
[after_gap]
resoak_min = 0.3
""",
)

STATION = """
name = "campaign"
on_foreign_change = "{rule}"
[chamber]
model = "{model}"
url = "modbus+tcp://{host}:{port}"
timeout_s = 0.3
retries = 1
[digitiser]
url = "serial://{digitiser}"
timeout_s = 0.5
retries = 1
[head]
url = "serial://{head}"
timeout_s = 0.3
retries = 1
speed_deg_per_s = 60.0
[guardian]
margin_s = 1.0
[emulation]
speed = {speed}
[[inputs]]
serial = "QA-001"
output_channel = 101
thermistor_channel = 111
[[inputs]]
serial = "QA-002"
output_channel = 102
thermistor_channel = 112
"""


class Case:
    """The bench of one fault, and its controller."""

    def __init__(self, folder: Path, seed: int, *, model="watlow_f4t", rule="end") -> None:
        self.folder, self.rng = folder, random.Random(seed)
        folder.mkdir(parents=True)
        self.model, self.rule, self.store = model, rule, str(folder / "night.sqlite")
        self.bench = subprocess.Popen(
            [sys.executable, "-S", str(HERE / "bench.py"), str(folder), str(SPEED), model,
             ",".join(SERIALS)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        self.where = json.loads(self.bench.stdout.readline())
        (folder / "sequence.toml").write_text(SEQUENCE)
        self.station("station.toml")
        self.environment = {"XDG_STATE_HOME": str(folder / "state")}
        self.process: Process | None = None
        self.others: list[int] = []  # processes of other sessions that must be gone at the end
        self.fault_s = math.nan  # when, by the monotonic clock

    def station(self, name: str, host: str = "127.0.0.1") -> str:
        text = STATION.format(
            rule=self.rule, model=self.model, speed=SPEED, host=host, **self.where
        )
        (self.folder / name).write_text(text)
        return name

    def start(self, *more: str, store: str | None = None, **how) -> Process:
        self.process = Process(
            self.folder,
            ["run", "sequence.toml", "--station", "station.toml", "--store", store or self.store,
             *more],
            acks=self.folder / "acks", **(self.environment | how),
        )  # fmt: skip
        return self.process

    def command(self, *args: str, patience_s: float = 60, acks=None) -> tuple[int | None, str]:
        process = Process(self.folder, list(args), acks=acks, **self.environment)
        code = process.wait(patience_s)
        if code is None:
            process.kill(signal.SIGKILL)
            process.wait(5)
        return code, process.text()

    def panel(self, *words: object) -> dict:
        with socket.socket(socket.AF_UNIX) as link:
            link.connect(str(self.folder / "panel"))
            link.sendall(" ".join(map(str, words)).encode())
            return json.loads(link.recv(4096).decode())

    def strike(self) -> None:
        self.fault_s = time.monotonic()

    def acks(self) -> list[list]:
        path = self.folder / "acks"
        return [json.loads(x) for x in path.read_text().splitlines()] if path.exists() else []

    def wait_for_slots(self, count: int, patience_s: float = 180) -> bool:
        give_up = time.monotonic() + patience_s
        while time.monotonic() < give_up and self.process.poll() is None:
            if len({(a[0], a[1]) for a in self.acks()}) >= count:
                return True
            time.sleep(0.02)
        return False

    def guardian(self) -> int:
        found = self.process.children()
        assert found, "no guardian"
        return found[-1]

    def is_safe(self, state: dict | None = None) -> bool:
        at = state or self.panel("state")
        ended = at["state"] == 1 if self.model == "watlow_f4" else at["profile"] == 61
        return at["setpoint_c"] == SAFE_C and at["ramp"] == 62 and ended

    def wait_safe(self, patience_s: float) -> float:
        """Return how long after the fault the chamber is safe, s; NaN if it is not."""
        give_up = time.monotonic() + patience_s
        while True:
            if self.is_safe():
                return max(0.0, self.last_write_s() - self.fault_s)
            if time.monotonic() > give_up:
                return math.nan
            time.sleep(0.05)

    def log(self, what: str) -> list[dict]:
        lines = (self.folder / "bench.jsonl").read_text().splitlines()
        return [x for x in map(json.loads, lines) if x["what"] == what]

    def last_write_s(self) -> float:
        writes = self.log("write")
        return writes[-1]["t"] if writes else self.fault_s

    def rows(self, query: str, store: str | Path = "") -> list[dict]:
        """Return what a query finds in the store, or in a copy of it."""
        where = str(store or self.store)
        if where.startswith("postgresql:"):
            with psycopg.connect(where, row_factory=psycopg.rows.dict_row) as server:
                return server.execute(query).fetchall()
        with closing(sqlite3.connect(f"file:{where}?mode=ro", uri=True)) as file:
            file.row_factory = sqlite3.Row
            return [dict(r) for r in file.execute(query)]

    def tests(self) -> list[dict]:
        return self.rows("select * from tests order by id")

    def events(self) -> str:
        return "\n".join(f"{r['kind']}: {r['text']}" for r in self.rows("select * from events"))

    def close(self) -> list[str]:
        """End everything; return what should have been gone by itself."""
        left = []
        if self.process is not None and self.process.poll() is None:
            left.append("the controller was running")
            self.process.kill(signal.SIGCONT)
            self.process.kill(signal.SIGTERM)  # it makes the chamber safe and ends its guardian
            self.process.wait(30)
            self.process.kill(signal.SIGKILL)
        mine = str(self.folder)
        give_up = time.monotonic() + 30
        while True:
            still = [p for p in _processes_naming(mine) if p != self.bench.pid]
            if not still or time.monotonic() > give_up:
                break
            time.sleep(0.1)
        for pid in still:
            left.append(f"process {pid} left behind")
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        if self.process is not None:
            self.process.poll()
        self.bench.stdin.close()
        self.bench.stdout.close()
        self.bench.wait(10)
        return left


def _processes_naming(text: str) -> list[int]:
    """Return the processes whose folder, command or environment names the case."""
    # a guardian stands in / and was given the environment
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and int(entry.name) != os.getpid():
            try:
                told = (entry / "cmdline").read_bytes() + (entry / "environ").read_bytes()
                told += os.readlink(entry / "cwd").encode()
                state = (entry / "stat").read_text().rsplit(")", 1)[1].split()[0]
            except OSError:
                continue
            if text.encode() in told and state != "Z":
                found.append(int(entry.name))
    return found


def judge_readings(case: Case, rows: list[dict]) -> tuple[int, int, int]:
    """Return how many acknowledged readings are lost, stored twice, and wrong."""
    held = {(r["run"], r["slot"], r["attempt"], r["serial"]): r for r in rows}
    acks = case.acks()
    lost = sum((key := tuple(a[:4])) not in held or held[key]["output"] != a[4] for a in acks)
    double = len(rows) - len(held)
    served: dict[tuple[int, float], list[dict]] = {}
    for scan in case.log("scan"):
        for channel, value in scan["values"]:
            served.setdefault((channel, _key(value)), []).append(scan)
    temps = [x["c"] for x in case.log("temp")]
    wrong = sum(_is_wrong(r, served, temps, case.model) for r in rows)
    return lost, double, wrong


def _key(value: float) -> float:
    return float(f"{value:.7e}")


def _is_wrong(row: dict, served: dict, temps: list[float], model: str) -> bool:
    number = SERIALS.index(row["serial"]) + 1
    chamber = row["chamber_c"]
    near = 0.056 if model == "watlow_f4" else 1e-3
    if chamber is not None and not any(abs(chamber - t) <= near for t in temps):
        return True
    if row["output"] is None:
        return row["flag"] == ""
    scans = served.get((100 + number, _key(row["output"])), [])
    if not scans:
        return True
    bodies = [s["body"] for s in scans]
    if row["temp_c"] is not None and not any(abs(row["temp_c"] - b) < 0.02 for b in bodies):
        return True
    at = row["position_deg"]
    return at is not None and not any(abs(at - s["angle"]) < 0.01 for s in scans)
