"""Random faults against `accelbench run` on foreign instruments in another process."""

import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.thermo.station.campaign.case import judge_readings

ROOT = Path(__file__).parents[4]


def campaign(tmp_path, *args: str, patience_s: float) -> list[dict]:
    log = tmp_path / "log.jsonl"
    done = subprocess.run(
        [sys.executable, "-m", "tests.thermo.station.campaign.campaign", "--log", str(log), *args],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=patience_s,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return [json.loads(line) for line in log.read_text().splitlines()]


THREE = {"sigkill": -9, "panel_setpoint": 1, "store_locked": None}  # the code that each ends with


@pytest.mark.parametrize(
    "kinds",
    [("panel_setpoint",), pytest.param(tuple(THREE), marks=pytest.mark.slow)],
    ids=["one", "three"],
)
def test_three_faults_leave_the_chamber_safe_and_every_reading_stored(tmp_path, kinds):
    chosen = [word for name in kinds for word in ("--kind", name)]
    results = campaign(tmp_path, *chosen, "--count", "1", patience_s=250)
    assert [r["kind"] for r in results] == list(kinds)
    assert all(THREE[r["kind"]] in (None, r["code"]) for r in results)
    assert all(r["acks"] > 0 for r in results)


NOT_SET = """
import sys
from pathlib import Path
from tests.thermo.station.campaign.campaign import _try_one
from tests.thermo.station.campaign.case import _processes_naming
from tests.thermo.station.campaign.kinds import NotSetError, kind

@kind(1)
def fault_not_set(case):
    case.start()
    assert case.wait_for_slots(1)
    raise NotSetError("too late")

found = _try_one("fault_not_set", 1, Path(sys.argv[1]) / "case")
print(found["not_set"], found["problems"][-1], _processes_naming(sys.argv[1]))
"""


@pytest.mark.slow  # of the campaign itself, which is slow, too
def test_a_kind_that_fails_leaves_no_process_behind(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", NOT_SET, str(tmp_path)],
        cwd=ROOT, capture_output=True, text=True, timeout=280, check=False,
    )  # fmt: skip
    assert done.stdout.strip() == "True the controller was running []", done.stdout + done.stderr


@pytest.mark.slow
@pytest.mark.timeout(7200)
def test_three_hundred_faults(tmp_path):
    results = campaign(tmp_path, "--count", "300", "--seed", "1", patience_s=7000)
    assert len(results) == 300


@pytest.mark.parametrize(
    ("change", "found"),
    [
        ({}, (0, 0, 0)),
        ({"output": 0.5002}, (1, 0, 1)),
        ({"slot": 1}, (1, 0, 0)),
        ({"chamber_c": 22.02}, (0, 0, 1)),
        ({"temp_c": 21.9}, (0, 0, 1)),
        ({"position_deg": 90.0}, (0, 0, 1)),
    ],
)
def test_a_reading_that_is_lost_or_altered_is_counted(change, found):
    scan = {"values": [[101, 0.5001], [111, 9e3]], "angle": 0.0, "body": 22.0}
    said = {"scan": [scan], "temp": [{"c": 22.01}]}
    case = SimpleNamespace(
        acks=lambda: [[1, 0, 1, "QA-001", 0.5001]], log=said.get, model="watlow_f4t"
    )
    row = {"run": 1, "slot": 0, "attempt": 1, "serial": "QA-001", "output": 0.5001, "flag": "",
           "temp_c": 22.0, "position_deg": 0.0, "chamber_c": 22.01}  # fmt: skip
    assert judge_readings(case, [row | change]) == found
    assert judge_readings(case, [row, row])[1] == 1
