"""Doubtful units are refused with a guess by every command that reads recorded runs."""

from pathlib import Path

import pytest

from tests.accelbench.conftest import table, write_run

GUESS = "is output_unit or nominal_scale a thousandth of what it should be?"


@pytest.fixture
def thousand_times(tmp_path: Path) -> Path:
    """Six runs in mA, declared as µA: the sidecar's nominal scale is 1300 per g."""
    frames = [table(f"r{k}", "A", n=120, seed=k) for k in range(6)]
    sidecar = 'output_unit = "mA"\ngravity_m_s2 = 9.80665\nnominal_scale = 1300.0\n'
    return write_run(tmp_path / "run.csv", *frames, sidecar=sidecar)


@pytest.mark.parametrize("command", ["fit", "stability", "runin"])
def test_doubtful_units_are_refused_and_taken_when_told_so(command, call, refused, thousand_times):
    said = refused(command, thousand_times)
    assert GUESS in said
    assert "--trust-units" in said
    trusted = call(command, thousand_times, "--trust-units", "--json")
    assert trusted.code == 1
    (doubt,) = trusted.document["doubtful_units"]
    assert GUESS in doubt
    assert trusted.document["readings"] == {"total": 720, "left_out": {}}
    assert GUESS in call(command, thousand_times, "--trust-units").out.replace("\n", " ")


@pytest.mark.parametrize("command", ["fit", "stability", "runin"])
def test_readings_left_out_are_counted_in_the_result(command, call, tmp_path):
    frames = [table(f"r{k}", "A", n=120, seed=k) for k in range(6)]
    frames[2].loc[50, "temp_c"] = -127.0
    done = call(command, write_run(tmp_path / "run.csv", *frames), "--json")
    assert done.document["readings"] == {"total": 720, "left_out": {"no_reading": 1}}
    assert "line 292 (temp_c -127)" in done.err
