import datetime as dt
import logging
import os
from pathlib import Path

import numpy as np
import pytest

from errormodel.errors import InputError
from errormodel.io import memory
from tests.thermo.recording.foreign.sample_log import LOG, MAP, changed, run
from thermo.recording.files import read_runs, write_runs
from thermo.recording.foreign.read import import_log

ROOT = Path(__file__).parents[4]
REAL = ROOT / "../shared/data/imu_thermal_loop/imu_raw_data.csv"


def test_a_plain_log(tmp_path):
    record = run(tmp_path)
    assert (record.run_ids, record.serials) == (("1",), ("A",))
    np.testing.assert_array_equal(record.time_s, [0, 1, 2])
    np.testing.assert_array_equal(record.temp_c, [20, 21, 22])
    np.testing.assert_array_equal(record.output, [0.1, 0.2, 0.3])
    assert (record.output_unit, record.gravity_m_s2, record.nominal_scale) == ("V", 9.81, 1.2)
    assert not record.has_input


def test_a_log_that_would_not_fit_is_refused_with_its_size_before_it_is_read(tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "available_bytes", lambda: 8 * 10**9)
    log = LOG + "8,23,0.4,4,ok\n" * 1000
    assert len(run(tmp_path, log=log.replace("8,23", "{},23")
                   .format(*range(8, 1008)))) == 1003  # fmt: skip
    os.truncate(tmp_path / "log.txt", 40 * 10**9)  # a hole: read, it would take all there is
    with pytest.raises(InputError) as caught:
        import_log(tmp_path / "log.txt", tmp_path / "map.toml")
    text = str(caught.value)
    assert "40 GB of log" in text
    assert "8 GB are available" in text
    assert "rows of 5 cells" in text
    assert "\n" not in text


def test_everything_at_once(tmp_path):
    log = "made by X\n\n% t; T; out mV; angle; chamber; run; status\n"
    mapping = """
    on_bad_row = "flag"
    [file]
    delimiter = ";"
    decimal = ","
    skip_lines = 1
    comment = "%"
    header = false
    encoding = "cp1251"
    [time]
    column = 1
    scale = 0.5
    start = "zero"
    [temperature]
    column = 2
    unit = "F"
    [chamber]
    column = 5
    unit = "K"
    [run]
    column = 6
    [[accelerometers]]
    serial = "Q-1"
    column = 3
    unit = "mV"
    scale = 2.0
    sign = -1
    position_deg = 90.0
    [[accelerometers]]
    serial = "Q-2"
    column = 3
    a_i_g = 0.5
    a_p_g = 0.25
    [output]
    output_unit = "V"
    gravity_m_s2 = 9.81
    nominal_scale = 1.2
    [[flag]]
    column = 7
    good = "да"
    flag = "чужой"
    [rows]
    first = 2
    last = 5
    """
    log += "0;0;0;0;0;a;да\n2;68;1500,5;30;293,15;a;да\n4;212;\u2014;30;300;a;да\n"
    log += "6;32;1;30;300;b;нет\n6;32;1;30;300;b;да\n8;32;1;30;300;b;да\n"
    record = run(tmp_path, log.encode("cp1251"), mapping)
    one = record.select("Q-1")
    assert one.run.text().tolist() == ["a", "a", "b"]  # the repeated time is left out
    np.testing.assert_array_equal(one.time_s, [1, 2, 3])
    np.testing.assert_allclose(one.temp_c, [20, 100, 0], atol=1e-12)  # rounding of °F to °C
    np.testing.assert_allclose(one.output[[0, 2]], [-3.001, -0.002], rtol=1e-15)
    assert np.isnan(one.output[1])
    np.testing.assert_allclose(one.chamber_c, [20, 26.85, 26.85], atol=1e-12)
    assert one.flag.text().tolist() == ["", "bad", "чужой"]
    np.testing.assert_allclose(one.select(runs=["a"]).specific_force_g[0], [1, 0, 0], atol=1e-15)
    np.testing.assert_array_equal(record.select("Q-2").specific_force_g[0], [0.5, 0.25, 0])


@pytest.mark.parametrize(
    ("unit", "output", "expected"),
    [
        ("g", "m/s2", 9.81e-1),
        ("mg", "g", 1e-4),
        ("m/s2", "g", 0.1 / 9.81),
        ("ug", "m/s2", 9.81e-7),
        ("A", "mA", 100),
        ("uA", "mA", 1e-4),
        ("mV", "V", 1e-4),
        ("count", "count", 0.1),
    ],
)
def test_units(tmp_path, unit, output, expected):
    mapping = changed(('column = "u"', f'column = "u"\nunit = "{unit}"'), ('"V"', f'"{output}"'))
    np.testing.assert_allclose(run(tmp_path, mapping=mapping).output[0], expected, rtol=1e-15)


@pytest.mark.parametrize(
    ("cells", "how", "expected"),
    [
        (["1700000000000000001", "1700000000000000501"], 'unit = "ns"', 500e-9),
        (["0.5", "0.75"], 'unit = "min"', 15.0),
        (["1", "2"], 'unit = "h"', 3600.0),
        (["2026-03-29T01:59:59+01:00", "2026-03-29T03:00:00+02:00"], 'format = "iso"', 1.0),
        (["2026-01-01 00:00:00", "2026-01-01 00:00:01.5"], 'format = "iso"', 1.5),
        (["31.12.2025 23:59:59", "01.01.2026 00:00:00"], 'format = "%d.%m.%Y %H:%M:%S"', 1.0),
    ],
)
def test_times(tmp_path, cells, how, expected):
    log = "t,T,u\n" + "".join(f"{cell},20,1\n" for cell in cells)
    record = run(tmp_path, log, changed(('unit = "s"', how)))
    np.testing.assert_allclose(record.time_s, [0, expected], rtol=1e-12)
    if "+01:00" in cells[0]:
        assert record.run_start_utc == {"1": dt.datetime(2026, 3, 29, 0, 59, 59, tzinfo=dt.UTC)}
    else:
        assert record.run_start_utc == {}


def test_runs_are_split_at_gaps(tmp_path):
    log = "t,T,u\n" + "".join(f"{t},20,1\n" for t in (0, 1, 2, 100, 101))
    record = run(tmp_path, log, MAP + "[run]\ngap_s = 10.0\n")
    assert record.run.text().tolist() == ["1", "1", "1", "2", "2"]
    np.testing.assert_array_equal(record.time_s, [0, 1, 2, 0, 1])


def test_one_reading_a_row(tmp_path):
    log = "t,T,u,who\n0,20,1,A\n0,20,2,B\n1,20,3,A\n1,21,4,B\n"
    mapping = changed(('column = "u"', 'column = "u"\nonly = {column = "who", equals = "A"}'))
    mapping = mapping.replace(
        "[output]",
        '[[accelerometers]]\nserial = "B"\ncolumn = "u"\nonly = {column = "who", equals = "B"}\n'
        'temperature = {column = "T", unit = "K"}\n[output]',
    )
    record = run(tmp_path, log.replace("2", "3"), mapping.replace(', unit = "K"', ""))
    np.testing.assert_array_equal(record.select("A").output, [1, 3])
    np.testing.assert_array_equal(record.select("B").output, [3, 4])


@pytest.mark.parametrize(
    ("log", "changes", "place", "words"),
    [
        (LOG.replace("0.2", "x"), [], "line 3", "column u is 'x', expected a finite number"),
        (LOG.replace("0.2", "nan"), [], "line 3", "'nan', expected a finite number"),
        (LOG.replace("0.2", "1e999"), [], "line 3", "'1e999', expected a finite number"),
        (LOG.replace("21", "5000"), [], "line 3", "temp_c 5000"),
        (LOG.replace("6,", "5,"), [], "line 3", "time '5' is not after 5"),
        (LOG.replace("6,", "4,"), [], "line 3", "time '4' is not after 5"),
        (LOG.replace("6,", "?,"), [], "line 3", "time '?' is no time"),
        (LOG.replace("6,21", "6"), [], "line 3", "4 cells, expected 5"),
        (LOG, [('"u"', '"w"')], "header", "no column 'w'; there are: t, T, u, v, s"),
        (LOG, [('"u"', "6")], "column 6", "the log has 5 columns"),
        (LOG.replace("v", "u"), [], "header", "column 'u' stands twice"),
        ("t,T,u\n", [], "", "no rows"),
        ("", [], "", "no rows"),
        (b"t,T,u\n0,20,\xff\n", [], "line 2", "is not utf-8-sig text"),
        (LOG, [('unit = "s"', 'format = "iso"')], "line 2", "time '5' is no time"),
    ],
)
def test_faults_of_the_log(tmp_path, log, changes, place, words):
    with pytest.raises(InputError) as caught:
        run(tmp_path, log, changed(*changes))
    assert (caught.value.place, caught.value.source) == (place, str(tmp_path / "log.txt"))
    assert words in caught.value.problem


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ('unit = "s"', "", "time"),
        ('unit = "s"', 'unit = "s"\nscale = 1.0', "time"),
        ('unit = "s"', 'unit = "week"', "time.unit"),
        ('unit = "s"', 'format = "%Q"', "time"),
        ('unit = "s"', 'unit = "s"\nzone = 1', "time.zone"),
        ('serial = "A"', 'serial = ""', "accelerometers.0.serial"),
        ('serial = "A"', 'serial = "A"\nunit = "mA"', ""),
        ('serial = "A"', 'serial = "A"\nscale = 0', "accelerometers.0.scale"),
        ('column = "u"', "column = 0", "accelerometers.0.column"),
        ("1.2", "1.2\n[file]\nencoding = 'klingon'", "file.encoding"),
        ("1.2", "1.2\n[file]\ndecimal = ','", "file"),
        ("1.2", "1.2\n[run]\nid = 'a'\ngap_s = 1.0", "run"),
        ("1.2", "1.2\n[extra]", "extra"),
    ],
)
def test_faults_of_the_mapping(tmp_path, old, new, place):
    with pytest.raises(InputError) as caught:
        run(tmp_path, LOG, changed((old, new)))
    assert caught.value.source == str(tmp_path / "map.toml")
    assert caught.value.place.startswith(place)
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(not REAL.exists(), reason="the measured data are not beside the project")
def test_the_real_thermal_loop(tmp_path):
    record = import_log(REAL, ROOT / "examples/maps/imu_thermal_loop.toml")
    assert record.serials == ("x", "y", "z")
    assert len(record) == 3 * 8400
    assert not record.has_input
    # the first reading is from before the sensor was ready: 0.5 °C off half a second later
    assert np.flatnonzero(~record.good).tolist() == [0, 1, 2]
    residual = {}
    for serial in record.serials:
        one = record.select(serial)
        line = np.polynomial.Polynomial.fit(one.temp_c, one.output, 3)
        residual[serial] = np.std(one.output - line(one.temp_c))
    # published for these data to four decimals
    assert {k: round(float(v), 4) for k, v in residual.items()} == {
        "x": 0.0064, "y": 0.0173, "z": 0.0443
    }  # fmt: skip
    np.testing.assert_allclose(np.median(np.diff(record.select("x").time_s)), 0.505, atol=5e-4)
    write_runs(record, tmp_path / "loop.csv")
    assert read_runs([tmp_path / "loop.csv"]).digest("loop") == record.digest("loop")


def test_a_blank_between_sign_and_digits_is_no_fault(tmp_path):
    log = LOG.replace("0.2", "- 0.2").replace("21", "+ 21")
    record = run(tmp_path, log)
    np.testing.assert_array_equal(record.output, [0.1, -0.2, 0.3])
    np.testing.assert_array_equal(record.temp_c, [20, 21, 22])


@pytest.mark.parametrize("end", ["8,23", "8,23,0", "8,"])
def test_a_last_line_cut_short_is_left_out_aloud(tmp_path, caplog, end):
    with caplog.at_level(logging.WARNING):
        record = run(tmp_path, LOG + end)
    np.testing.assert_array_equal(record.output, [0.1, 0.2, 0.3])
    assert "line 5" in caplog.text
    assert "the last line is left out" in caplog.text
    with pytest.raises(InputError, match="line 5"):  # in the midst it is a fault
        run(tmp_path, f"{LOG}{end}\n9,24,0.5,5,ok\n")


def test_a_delimiter_at_the_end_of_the_rows_of_readings_is_no_cell(tmp_path):
    log = LOG.replace(",ok\n", ",ok,\n").replace(",warm\n", ",warm,\n")
    np.testing.assert_array_equal(run(tmp_path, log).output, [0.1, 0.2, 0.3])
    with pytest.raises(InputError, match="6 cells, expected 5"):
        run(tmp_path, log.replace("ok,\n", "ok,7\n"))


def test_unsigned_counts_are_made_signed_by_their_width(tmp_path):
    log = "t,T,u\n0,20,0\n1,20,127\n2,20,128\n3,20,255\n"
    mapping = changed(('column = "u"', 'column = "u"\nsigned = true\nbits = 8'))
    np.testing.assert_array_equal(run(tmp_path, log, mapping).output, [0, 127, -128, -1])
    with pytest.raises(InputError, match="signed needs bits"):
        run(tmp_path, log, mapping.replace("bits = 8", ""))


def test_a_log_without_temperature_has_none_in_its_recording(tmp_path):
    mapping = changed(('[temperature]\ncolumn = "T"\n', ""))
    record = run(tmp_path, LOG, mapping)
    assert np.isnan(record.temp_c).all()
    assert record.good.all()
    write_runs(record, tmp_path / "run.csv")
    assert np.isnan(read_runs([tmp_path / "run.csv"]).temp_c).all()
