import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from drivers.chambers.modbus_chamber import ModbusChamber
from tests.accelbench.program import ran
from thermo.recording.files import read_runs
from thermo.station.outcome import RunControl
from thermo.store.store import open_store

HERE = Path(__file__).parent
ROOT = HERE.parents[3]
MINI = HERE.parents[1] / "mini.toml"
STATION = ROOT / "examples/stations/f4t.toml"
SHORT = ROOT / "examples/sequences/short.toml"


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """One run of the small sequence through the program itself; nothing may be changed in it."""
    arguments = ["run", str(MINI), "--store", "s.sqlite", "--out", "run.csv", "--json"]
    return ran(tmp_path_factory.mktemp("run"), *arguments)


def test_a_run_on_emulated_instruments_ends_safe_and_tells_everything(done):
    _, document, stderr = done
    assert document["status"] == "finished"
    assert document["readings"] == 2 * 2 * 180
    assert document["safe"]["verified"] is True
    assert document["head_stopped"] is True
    assert len(document["uniformity"]) == 2 * 2 * 2
    assert all(v["passed"] for v in document["uniformity"])
    assert [v["serial"] for v in document["live"]] == ["QA-001", "QA-003"]
    # what a 6 min ramp at four positions gives; the noise is 5 µg a reading
    assert all(0 < v["k0_sigma_ug"] < 30 for v in document["live"])
    assert "left" in stderr
    assert "K0" in stderr


def test_accelerometers_of_different_scale_go_into_files_of_their_own(done):
    folder, document, _ = done
    assert document["exported"] == ["run-1.csv", "run-2.csv"]
    one, two = (read_runs([folder / name]) for name in document["exported"])
    assert (one.serials, one.nominal_scale) == (("QA-001",), 1.3)
    assert (two.serials, two.nominal_scale) == (("QA-003",), 1.25)
    assert len(read_runs([folder / name for name in document["exported"]])) == 720


def test_the_store_is_listed_and_exported(call, refused, done, tmp_path):
    folder, document, _ = done
    store = tmp_path / "s.sqlite"
    shutil.copy(folder / "s.sqlite", store)
    listed = call("runs", "--store", store, "--json").document["tests"]
    assert [t["id"] for t in listed] == [document["test_id"]]
    assert listed[0]["status"] == "finished"
    assert document["test_id"] in call("runs", "--store", store).out
    out = tmp_path / "again.csv"
    arguments = ("export", document["test_id"], "--store", store, "--out", out)
    again = call(*arguments, "--json").document["files"]
    assert [f["out"] for f in again] == [str(tmp_path / f"again-{k}.csv") for k in (1, 2)]
    assert (tmp_path / "again-1.csv").read_bytes() == (folder / "run-1.csv").read_bytes()
    assert "--force" in refused(*arguments)
    assert "no test has this id" in refused(
        "export", "nonsense", "--store", store, "--out", tmp_path / "x.csv"
    )
    assert "finished" in refused("run", "--resume", document["test_id"], "--store", store)


def test_a_dry_run_tells_the_plan_and_writes_nothing(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = call("run", MINI, "--dry-run")
    assert done.code == 0
    assert "duration" in done.out
    assert "Sigmas to expect" in done.out
    assert "delta_p has no effect in this plan" in done.out
    document = call("run", MINI, "--dry-run", "--json").document
    assert document["readings"] == 720
    assert document["expected_sigmas"]["k0"]["unit"] == "µg"
    assert ["delta_p"] in document["not_separable"]
    assert list(tmp_path.iterdir()) == []


def test_a_turned_mounting_is_announced_and_stands_in_the_sidecar(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "turned.toml"
    path.write_text(
        MINI.read_text().replace("nominal_scale = 1.3\n", "nominal_scale = 1.3\nmount_deg = 45.0\n")
    )
    told = "turn QA-001 by +45° on the head before the start; with the head at 0° each then reads "
    told += "+0.707 g"
    dry = call("run", path, "--dry-run")
    assert told in dry.out
    # a quarter turn's sin² is ½ at all four positions: for the other one it is not
    first, second = call("run", path, "--dry-run", "--json").document["by_mounting"]
    assert (first["serials"], second["serials"]) == (["QA-001"], ["QA-003"])
    assert ["k0", "k2"] in first["not_separable"]
    assert ["k0", "k2"] not in second["not_separable"]
    assert "second_order" in first["effects_not_shown"]
    done = call("run", path, "--store", "s.sqlite", "--out", "run.csv", "--json")
    assert done.code == 0
    assert done.err.startswith(f"mounting: {told}")
    one, two = (read_runs([name]) for name in done.document["exported"])
    assert set(one.mount_deg.values()) == {45.0}
    assert two.mount_deg == {}


class AbortedControl(RunControl):
    def __init__(self) -> None:
        super().__init__()
        self.looks = 0

    def check(self) -> None:
        self.looks += 1
        if self.looks > 300:  # in the middle of the first run
            self.abort("stopped by the test")
        super().check()


def test_a_run_that_ends_early_is_exit_code_1_and_can_be_resumed(call, tmp_path, monkeypatch):
    store = tmp_path / "s.sqlite"
    monkeypatch.setattr("thermo.launch.real.RunControl", AbortedControl)
    ended = call("run", MINI, "--store", store, "--json")
    assert ended.code == 1
    assert ended.document["status"] == "interrupted"
    assert ended.document["reason"] == "stopped by the test"
    assert ended.document["safe"]["verified"] is True
    monkeypatch.undo()
    test_id = ended.document["test_id"]
    resumed = call("run", "--resume", test_id, "--store", store, "--json")
    assert resumed.code == 0, resumed.err
    assert resumed.document["test_id"] == test_id
    with open_store(str(store)) as opened:
        readings = opened.readings(test_id)
    valid = readings[readings["voided"] == ""]
    assert not valid.duplicated(["run", "serial", "slot"]).any()
    assert len(valid) == 720


def test_a_station_that_is_not_there_is_one_line_and_leaves_no_store(refused, tmp_path):
    text = STATION.read_text().replace("192.0.2.10:502", "127.0.0.1:9")
    text = text.replace("/dev/ttyUSB", str(tmp_path / "no"))
    station = tmp_path / "station.toml"
    station.write_text(text)
    sequence = tmp_path / "one.toml"
    sequence.write_text(MINI.read_text())
    arguments = ("run", sequence, "--station", station, "--store", tmp_path / "s.sqlite")
    assert "cannot be opened" in refused(*arguments)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("to_c = 60.0", "to_c = 500.0", "temperature"),
        ('serial = "QA-003"', 'serial = "QA-001"', "twice"),
        ("period_s = 8.0", "period_s = 0.5", "sampling"),
        ("rate_c_per_min = 5.0", "rate_c_per_min = 50.0", "°C/min"),
        ("name", "nam", "name"),
    ],
)
def test_a_sequence_that_cannot_be_run_is_refused(refused, tmp_path, old, new, said):
    path = tmp_path / "bad.toml"
    path.write_text(MINI.read_text().replace(old, new))
    for more in ((), ("--dry-run",)):
        message = refused("run", path, "--store", tmp_path / "s.sqlite", *more)
        assert str(path) in message
        assert said in message


def test_more_accelerometers_than_can_be_emulated_are_refused(refused, tmp_path):
    path = tmp_path / "many.toml"
    many = "".join(
        f'[[accelerometers]]\nserial = "X{k}"\nnominal_scale = 1.3\n\n' for k in range(29)
    )
    path.write_text(MINI.read_text().replace("[[accelerometers]]", many + "[[accelerometers]]", 1))
    assert "31 are too many to emulate, at most 30" in refused("run", path, "--dry-run")


def test_a_chamber_in_use_is_refused_unless_it_is_taken_over(call, refused, tmp_path, monkeypatch):
    monkeypatch.setattr(ModbusChamber, "read_occupation", lambda _: ("profile 3 is running",))
    sequence, store = tmp_path / "short.toml", tmp_path / "s.sqlite"
    sequence.write_text(SHORT.read_text())
    said = refused("run", sequence, "--store", store)
    assert "profile 3 is running" in said
    assert "--take-over" in said
    assert not store.exists()
    done = call("run", sequence, "--store", store, "--take-over", "--json")
    assert done.code == 0
    assert done.document["safe"]["commanded"] is True
    assert done.document["complaints"] == []
    with open_store(store) as opened:
        events = opened.events(done.document["test_id"])
    assert [e.text for e in events if e.kind == "take-over"] == ["profile 3 is running"]


def test_a_chamber_changed_by_somebody_else_is_told_and_exit_code_1(call, tmp_path, monkeypatch):
    sequence, store = tmp_path / "short.toml", tmp_path / "s.sqlite"
    sequence.write_text(SHORT.read_text())
    looks = iter(range(10_000))

    def read_foreign_changes(_: ModbusChamber) -> tuple[str, ...]:
        return ("set point 80 °C, commanded 20 °C",) if next(looks) > 40 else ()

    monkeypatch.setattr(ModbusChamber, "read_foreign_changes", read_foreign_changes)
    done = call("run", sequence, "--store", store)
    assert done.code == 1
    assert "failed: somebody else changed the chamber: set point 80 °C" in done.out
    assert "chamber's safe condition verified" in done.out
    assert "complaint: somebody else changed the chamber" in done.out


def test_speed_is_for_emulated_instruments(refused, tmp_path):
    sequence = tmp_path / "s.toml"
    sequence.write_text(MINI.read_text())
    said = refused("run", sequence, "--station", STATION, "--speed", "10")
    assert "[emulation]" in said


def test_a_sequence_other_than_the_one_begun_is_refused(refused, done, tmp_path):
    folder, document, _ = done
    shutil.copy(folder / "s.sqlite", tmp_path / "s.sqlite")
    other = ROOT / "examples/sequences/short.toml"
    resume = ("--resume", document["test_id"], "--store", tmp_path / "s.sqlite")
    assert "is a different sequence from that of test" in refused("run", other, *resume)


def test_emulate_serves_until_it_is_stopped(tmp_path):
    text = STATION.read_text().replace("192.0.2.10:502", "127.0.0.1:0")
    text = text.replace("serial:///dev/ttyUSB1", "serial://auto")
    text = text.replace("serial:///dev/ttyUSB2", f"serial://{tmp_path}/head")
    station = tmp_path / "station.toml"
    station.write_text(text)
    program = "import sys; from accelbench.cli import main; sys.exit(main())"
    process = subprocess.Popen(
        [sys.executable, "-c", program, "emulate", str(station), "--speed", "10", "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )
    assert process.stdout is not None
    try:
        document = json.loads(process.stdout.readline())
        assert document["speed"] == 10.0
        assert set(document["urls"]) == {"chamber", "digitiser", "head"}
        assert not document["urls"]["chamber"].endswith(":0")
        assert (tmp_path / "head").is_symlink()
        process.send_signal(signal.SIGTERM)
        out, err = process.communicate(timeout=30)
    finally:
        process.kill()
        process.wait()
    assert (process.returncode, out, err) == (0, "", "")
    assert not (tmp_path / "head").exists()


def test_an_address_that_cannot_be_served_is_refused(refused, tmp_path):
    station = tmp_path / "station.toml"
    text = STATION.read_text().replace("/dev/ttyUSB", str(tmp_path / "tty"))
    station.write_text(text)  # 192.0.2.10 is nobody's
    assert "station.toml: url: cannot be served" in refused("emulate", station)
