"""Small inputs that other people's logs stand for; each has the right values beside it.

One accelerometer, 720 rows, −40 → 80 → −40 °C, four positions, 5 µg of white noise: K1 1.3 mA/g,
K1_t1 120 ppm/°C, K0 1500 µg, K0_t1 30 µg/°C, everything else 0. Every file is spoiled in one way.
"""

import logging
from pathlib import Path

import numpy as np
import pytest

from errormodel.errors import InputError
from thermo.fitting.fit import fit_runs
from thermo.recording.files import RecordedRuns, read_runs, write_runs
from thermo.recording.foreign.read import import_log

CASES = Path(__file__).parents[3] / "cases"
TRUTH = {"k1": 1.0, "k1_t1": 120e-6, "k0": 1500e-6, "k0_t1": 30e-6}


def check_truth(record: RecordedRuns, truth: dict[str, float] = TRUTH) -> None:
    fit = fit_runs(record)[0].fit
    found, sigma = fit.as_dict(), dict(zip(fit.names, np.sqrt(np.diag(fit.cov)), strict=True))
    for name, value in truth.items():
        # the noise of these 720 readings is within 2 sigma of the truth in the clean file
        assert abs(found[name] - value) < 3 * sigma[name], name


def imported(name: str, mapping: str = "map") -> RecordedRuns:
    return import_log(CASES / f"{name}.csv", CASES / f"{mapping}.toml")


@pytest.mark.parametrize(
    ("name", "mapping", "rows", "left_out"),
    [
        ("temperature_minus127", "map", 720, 3),
        ("output_overload", "map", 720, 3),
        ("time_one_wrong", "time_one_wrong", 719, 0),
        ("over_midnight", "over_midnight", 720, 0),
        ("trailing_delimiter", "map", 720, 0),
    ],
)
def test_a_log_spoiled_in_one_way_gives_the_truth(name, mapping, rows, left_out):
    record = imported(name, mapping)
    assert len(record) == rows
    assert int((~record.good).sum()) == left_out
    check_truth(record)


def test_a_sensor_just_powered_is_left_out_with_its_line(caplog):
    with caplog.at_level(logging.WARNING):
        record = read_runs([CASES / "temperature_plus5_once.csv"])
    assert np.flatnonzero(~record.good).tolist() == [401]
    assert "line 403 (temp_c 85)" in caplog.text
    check_truth(record)


@pytest.mark.parametrize("offset_c", [5.0, -5.0])
def test_a_temperature_five_degrees_off_is_left_out(tmp_path, offset_c):
    text = (CASES / "temperature_plus5_once.csv").read_text(encoding="utf-8").splitlines()
    cells = text[402].split(",")
    neighbours = [float(text[k].split(",")[3]) for k in (401, 403)]
    cells[3] = f"{np.mean(neighbours) + offset_c:.3f}"
    text[402] = ",".join(cells)
    (tmp_path / "run.csv").write_text("\n".join(text) + "\n", encoding="utf-8")
    side = (CASES / "temperature_plus5_once.toml").read_text(encoding="utf-8")
    (tmp_path / "run.toml").write_text(side, encoding="utf-8")
    record = read_runs([tmp_path / "run.csv"])
    assert np.flatnonzero(~record.good).tolist() == [401]
    check_truth(record)


def with_key(tmp_path: Path, name: str, after: str, key: str) -> RecordedRuns:
    text = (CASES / f"{name}.toml").read_text(encoding="utf-8")
    assert after in text
    mapping = tmp_path / "map.toml"
    mapping.write_text(text.replace(after, f"{after}\n{key}", 1), encoding="utf-8")
    return import_log(CASES / f"{name}.csv", mapping)


def test_signed_counts_written_as_unsigned(tmp_path):
    record = with_key(tmp_path, "output_unsigned16", 'column = "U"', "signed = true\nbits = 16")
    assert record.output.min() < 0
    check_truth(record)


def test_unsigned_counts_are_told_from_signed_ones(tmp_path):
    write_runs(imported("output_unsigned16", "output_unsigned16"), tmp_path / "run.csv")
    with pytest.raises(InputError, match="signed counts written as unsigned"):
        read_runs([tmp_path / "run.csv"])


def test_a_counter_that_wraps(tmp_path, caplog):
    with caplog.at_level(logging.WARNING):
        record = with_key(tmp_path, "time_counter_wraps", 'unit = "us"', "wrap_bits = 32")
    assert "the counter overflowed" in caplog.text
    np.testing.assert_allclose(np.diff(record.time_s), 20.0)
    check_truth(record)
