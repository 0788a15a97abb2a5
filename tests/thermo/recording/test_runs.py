"""Recorded runs in memory: their digest, their input, joined, selected, sealed."""

import numpy as np
import pandas as pd
import pytest

from errormodel.errors import InputError
from tests.thermo.recording.sample_runs import HEADER, LINES, SIDECAR, put, sample
from thermo.recording.files import make_runs, read_runs, write_runs


def test_digest_changes_with_what_the_thermistors_may_be_wrong_by():
    """It widens the sigmas of a fit; recordings that say nothing keep the digest they had."""
    frame = pd.DataFrame(
        {"run": "1", "serial": "A", "time_s": [0.0, 1.0], "temp_c": 25.0, "output": [1.0, 2.0]}
    )
    unit = {"output_unit": "mA", "gravity_m_s2": 9.80665, "nominal_scale": 1.3}
    digests = [
        make_runs(frame, **unit, **more).digest("1")
        for more in ({}, {"temp_sigma_c": 0.1}, {"temp_gain_ppm": 0.1}, {"temp_sigma_c": 0.2})
    ]
    assert len(set(digests)) == 4
    assert make_runs(frame, **unit, temp_sigma_c=0.0).digest("1") == digests[0]


def test_digest_depends_on_content_only(tmp_path):
    record = sample()
    shuffled = record.take(np.argsort(record.serial.codes, kind="stable"))
    renamed = make_runs(
        record.frame().replace({"run": {"r0": "copy"}}),
        output_unit="mA",
        gravity_m_s2=9.80665,
        nominal_scale=1.25,
    )
    assert shuffled.digest("r0") == record.digest("r0") == renamed.digest("copy")
    assert record.digest("r0") != record.digest("r1")
    frame = record.frame()
    frame.loc[0, "output"] = np.nextafter(frame.loc[0, "output"], 1)
    nudged = make_runs(frame, output_unit="mA", gravity_m_s2=9.80665, nominal_scale=1.25)
    assert nudged.digest("r0") != record.digest("r0")
    assert nudged.digest("r1") == record.digest("r1")


def test_input_from_the_head_and_from_given_forces():
    angles = np.array([0.0, 90.0, 180.0, 30.0])
    base = {"run": "1", "serial": "A", "time_s": np.arange(4.0), "temp_c": 20.0, "output": 1.0}
    scale = {"output_unit": "V", "gravity_m_s2": 9.8, "nominal_scale": 1.0}
    turned = make_runs(pd.DataFrame({**base, "position_deg": angles}), **scale)
    assert turned.has_input
    expected = [[0, 1, 0], [1, 0, 0], [0, -1, 0], [0.5, np.sqrt(0.75), 0]]
    np.testing.assert_allclose(
        turned.specific_force_g, expected, atol=4e-16
    )  # rounding of sin, cos
    some = {**base, "position_deg": angles, "a_i_g": [np.nan, 0.3, 0.4, np.nan]}
    mixed = make_runs(pd.DataFrame(some), **scale)
    np.testing.assert_allclose(
        mixed.specific_force_g, [[0, 1, 0], [0.3, 0, 0], [0.4, 0, 0], expected[3]], atol=4e-16
    )
    alone = make_runs(pd.DataFrame(base), **scale)
    assert not alone.has_input
    with pytest.raises(InputError, match="input unknown"):
        _ = alone.specific_force_g
    with pytest.raises(InputError, match="in part"):
        make_runs(pd.DataFrame({**some, "a_o_g": [1.0, np.nan, 0, np.nan]}), **scale)


def test_files_are_joined(tmp_path):
    first = put(tmp_path, HEADER + LINES)
    later = put(tmp_path, HEADER + "1,A,20,20,0,1\n2,A,0,20,0,1\n", "later.csv")
    record = read_runs([later, first])
    assert sorted(record.run_ids) == ["1", "2"]
    np.testing.assert_array_equal(record.select("A", ["1"]).time_s, [0, 10, 20])
    volts = put(tmp_path, HEADER + "3,A,0,20,0,1\n", "volts.csv", SIDECAR.replace("mA", "V"))
    mixed = read_runs([first, volts])
    assert mixed.scale_of("3", "A").output_unit == "V"
    assert mixed.select(runs=["3"]).output_unit == "V"
    with pytest.raises(InputError, match="2 different output units"):
        _ = mixed.nominal_scale
    with pytest.raises(InputError, match="different output units"):
        write_runs(mixed, tmp_path / "mixed.csv")
    assert not (tmp_path / "mixed.csv").exists()


def test_the_same_reading_in_two_files_is_refused(tmp_path):
    first = put(tmp_path, HEADER + LINES)
    again = put(tmp_path, HEADER + "1,A,10,20,0,1\n", "again.csv")
    with pytest.raises(
        InputError, match=r"again\.csv: run '1' serial 'A' time_s 10\.0 is also in another"
    ):
        read_runs([first, again])
    with pytest.raises(InputError, match="another file"):
        read_runs([first, first])
    volts = put(tmp_path, HEADER + "1,A,20,20,0,1\n", "v.csv", SIDECAR.replace("mA", "V"))
    with pytest.raises(InputError, match="differ from those in another file"):
        read_runs([first, volts])


def test_nothing_can_be_changed():
    record = sample()
    with pytest.raises(ValueError, match="read-only"):
        record.output[0] = 1
    with pytest.raises(AttributeError):
        record.time_s = record.temp_c  # type: ignore[misc]
    with pytest.raises(TypeError):
        record.scales[("r0", "A")] = None  # type: ignore[index]


def test_select_names_what_there_is():
    record = sample()
    assert record.select("B", runs=["r1"]).run_ids == ("r1",)
    assert len(record.select("B")) == 100
    with pytest.raises(InputError, match="no serial 'Z'; expected one of A, B, C"):
        record.select("Z")
    with pytest.raises(InputError, match="no run 'x'"):
        record.select(runs=["x"])
