import datetime as dt
import logging
import time

import numpy as np
import pandas as pd
import pytest

from errormodel.errors import InputError
from tests.thermo.recording.sample_runs import HEADER, LINES, SIDECAR, put, sample
from thermo.recording.files import read_runs, write_runs


def test_reads_rows_and_sidecar(tmp_path):
    record = read_runs([put(tmp_path, HEADER + LINES)])
    assert record.run_ids == ("1",)
    assert record.serials == ("A", "B")
    assert (record.output_unit, record.gravity_m_s2, record.nominal_scale) == ("mA", 9.80665, 1.25)
    a = record.select("A")
    np.testing.assert_array_equal(a.time_s, [0, 10])
    np.testing.assert_array_equal(a.output, [0.001, 1.25])
    assert a.good.all()


@pytest.mark.parametrize(
    "change",
    [
        lambda t: "\ufeff" + t,
        lambda t: t.replace("\n", "\r\n"),
        lambda t: t.replace("\n", "\r"),
        lambda t: t.rstrip("\n"),
        lambda t: t.replace("\n", "\n\n"),
        lambda t: t.replace("1.25", "+1.25"),
        lambda t: t.replace("1.25", " 1.25 "),
        lambda t: t.replace("1.25", "125e-2"),
        lambda t: t.replace("1,A", '"1","A"'),
        lambda t: t.replace("run,serial", " run , serial"),
    ],
    ids=["bom", "crlf", "cr", "no-end", "blanks", "plus", "spaces", "exponent", "quotes", "header"],
)
def test_the_same_content_in_another_spelling(tmp_path, change):
    plain = read_runs([put(tmp_path, HEADER + LINES)])
    other = read_runs([put(tmp_path, change(HEADER + LINES), "other.csv")])
    assert other.digest("1") == plain.digest("1")
    pd.testing.assert_frame_equal(other.frame(), plain.frame())


@pytest.mark.parametrize(
    ("lines", "place", "words"),
    [
        ("1,A,0,20,0,0.1\n1,A,10,x,0,0.1\n", "line 3", "temp_c 'x', expected a number"),
        ("1,A,0,20,0,0.1\n1,A,10,1_0,0,0.1\n", "line 3", "temp_c '1_0'"),
        ("1,A,0,20,0,nan\n", "line 2", "output is empty or not a number"),
        ("1,A,0,20,0,\n", "line 2", "output is empty"),
        ("1,A,0,20,0,inf\n", "line 2", "infinite"),
        ("1,A,0,20,0,1e30\n", "line 2", "output 1e+30 mA at nominal_scale 1.25 is more than"),
        ("1,A,1e300,20,0,1\n", "line 2", "time_s 1e+300, expected 1e+12 at most"),
        ("1,A,0,20,-1e300,1\n", "line 2", "position_deg -1e+300, expected 3.6e+08 at most"),
        ("1,A,0,20,0,1e999\n", "line 2", "infinite"),
        ("1,A,,20,0,1\n", "line 2", "time_s is empty"),
        ("\n1,A,0,20,0,0.1\n\n1,A,0,20,0,0.2\n", "line 5", "time_s 0.0 is not after 0.0 in line 3"),
        ("1,A,0,20,0,0.1\n1,A,0,20,0,0.1\n", "line 3", "duplicate of line 2"),
        ("1,A,5,20,0,0.1\n1,B,4,20,0,1\n1,A,4,20,0,0.1\n", "line 4", "not after"),
        ("1,A,0,20,0,0.1\n1,A,10,20,0\n", "line 3", "5 cells, expected 6"),
        ("1,A,0,20,0,0.1\n1,A,10,20,0,1,2\n", "line 3", "7 cells, expected 6"),
        ("1,A,0,1000.5,0,0.1\n", "line 2", "expected -273.15 to 1000"),
        ("1,A,0,-274,0,0.1\n", "line 2", "expected -273.15 to 1000"),
        (",A,0,20,0,0.1\n", "line 2", "run ''"),
        ("1, ,0,20,0,0.1\n", "line 2", "serial ''"),
        ("1,A,0,20,0,0.1\n1,A,9,20,,0.1\n", "line 3", "position_deg is empty"),
        ('1,"A,0,20,0,0.1\n', "line 2", "cells, expected 6"),
    ],
)
def test_a_fault_is_named_with_its_line(tmp_path, lines, place, words):
    path = put(tmp_path, HEADER + lines)
    with pytest.raises(InputError) as caught:
        read_runs([path])
    assert (caught.value.source, caught.value.place) == (str(path), place)
    assert words in caught.value.problem
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (b"\n \n", "is empty"),
        (HEADER.encode(), "no readings"),
        (b"run;serial;time_s;temp_c;output\n1;A;0;20;1\n", "separated by ';', expected ','"),
        (b"run\tserial\ttime_s\ttemp_c\toutput\n", "separated by '\\t'"),
        (b"run,serial,time_s,output\n1,A,0,1\n", "no column temp_c"),
        (b"run,serial,time_s,temp_c,output,output\n1,A,0,1,1,1\n", "column output stands twice"),
        ((HEADER + LINES).encode("utf-16"), "not UTF-8"),
        ((HEADER + "1,\u00e4,0,20,0,1\n").encode("latin-1"), "line 2: is not UTF-8"),
    ],
)
def test_a_file_that_is_no_recorded_run(tmp_path, content, words):
    with pytest.raises(InputError, match=r"run\.csv") as caught:
        read_runs([put(tmp_path, content)])
    assert words in str(caught.value)


def test_missing_file_and_sidecar(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_runs([tmp_path / "no.csv"])
    path = put(tmp_path, HEADER + LINES, sidecar=None)
    with pytest.raises(InputError, match=r"run\.toml.*output_unit, gravity_m_s2, nominal_scale"):
        read_runs([path])
    with pytest.raises(InputError, match="no file given"):
        read_runs([])


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ('"mA"', '"A"', "output_unit"),
        ("9.80665", "981", "gravity_m_s2"),
        ("9.80665", "nan", "gravity_m_s2"),
        ("1.25", "0", "nominal_scale"),
        ("1.25", "inf", "nominal_scale"),
        ("1.25", "true", "nominal_scale"),
        ("1.25", '1.25\nrun_start_utc = {"1" = 5}', "run_start_utc.1"),
        ("1.25", '1.25\nrun_start_utc = {"1" = "noon"}', "run_start_utc.1"),
        ("1.25", '1.25\nmount_deg = {"1" = {"A" = "x"}}', "mount_deg.1.A"),
        ("1.25", "1.25\ncomment = 1", "comment"),
        ("nominal_scale", "scale", "nominal_scale"),
    ],
)
def test_sidecar_faults_name_the_key(tmp_path, old, new, place):
    with pytest.raises(InputError) as caught:
        read_runs([put(tmp_path, HEADER + LINES, sidecar=SIDECAR.replace(old, new))])
    assert caught.value.place == place
    assert caught.value.source.endswith("run.toml")


def test_start_times(tmp_path):
    sidecar = SIDECAR + '[run_start_utc]\n1 = 2026-11-22T23:00:00+01:00\n2 = "2026-01-01"\n'
    record = read_runs([put(tmp_path, HEADER + LINES, sidecar=sidecar)])
    assert record.run_start_utc == {"1": dt.datetime(2026, 11, 22, 22, tzinfo=dt.UTC)}


def test_a_turned_mounting_gives_the_forces_and_is_written_again(tmp_path):
    sidecar = SIDECAR + "[mount_deg.1]\nA = 45.0\nC = 10.0\n[mount_deg.2]\nA = 1.0\n"
    record = read_runs([put(tmp_path, HEADER + LINES, sidecar=sidecar)])
    assert record.mount_deg == {("1", "A"): 45.0}
    half = 0.5**0.5
    np.testing.assert_allclose(
        record.specific_force_g, [[half, half, 0], [half, -half, 0], [0, 1, 0]], atol=1e-15
    )
    write_runs(record, tmp_path / "again.csv")
    again = read_runs([tmp_path / "again.csv"])
    assert again.mount_deg == record.mount_deg
    plain = read_runs([put(tmp_path, HEADER + LINES)])
    assert again.digest("1") == record.digest("1") != plain.digest("1")
    assert record.select("B").mount_deg == {}


def test_a_mounting_that_the_forces_deny_is_refused(tmp_path):
    header = "run,serial,time_s,temp_c,position_deg,output,a_i_g,a_p_g,a_o_g\n"
    lines = "1,A,0,20.5,0,0.001,0.7071,0.7071,0\n1,A,10,20.6,90,1.25,1,0,0\n"
    path = put(tmp_path, header + lines, sidecar=SIDECAR + "[mount_deg.1]\nA = 45.0\n")
    with pytest.raises(InputError) as caught:
        read_runs([path])
    assert caught.value.place == "line 3"
    assert "rotated by 0.0°" in caught.value.problem


def test_flags(tmp_path):
    text = HEADER.replace("\n", ",flag\n") + "".join(
        f"1,A,{i},20,0,{'' if flag == 'overload' else 1},{flag}\n"
        for i, flag in enumerate(["", "0", "ok", "OK", "1", "overload", "gap"])
    )
    record = read_runs([put(tmp_path, text)])
    np.testing.assert_array_equal(record.good, [1, 1, 1, 1, 0, 0, 0])
    assert record.flag.text().tolist() == ["", "", "", "", "1", "overload", "gap"]
    assert np.isnan(record.output[5])
    with pytest.raises(InputError, match="line 7: output is infinite"):
        read_runs([put(tmp_path, text.replace(",,overload", ",inf,overload"))])


def test_unknown_columns_are_ignored_aloud(tmp_path, caplog):
    text = "note," + HEADER + LINES.replace("1,A", "hello,1,A").replace("1,B", "x,1,B")
    with caplog.at_level(logging.WARNING):
        record = read_runs([put(tmp_path, text)])
    assert "columns not used: note" in caplog.text
    assert record.digest("1") == read_runs([put(tmp_path, HEADER + LINES, "b.csv")]).digest("1")


def test_parquet_made_by_others(tmp_path):
    frame = pd.DataFrame(
        {
            "run": [1, 1, 2],
            "serial": pd.Categorical(["A", "A", "A"]),
            "time_s": [0, 10, 0],
            "temp_c": np.array([20, 21, 22], dtype=np.float32),
            "output": [1.0, 2.0, np.nan],
            "flag": [np.nan, 0.0, 3.0],
        }
    )
    frame.to_parquet(tmp_path / "o.parquet")
    (tmp_path / "o.toml").write_text(SIDECAR)
    record = read_runs([tmp_path / "o.parquet"])
    assert record.run_ids == ("1", "2")
    np.testing.assert_array_equal(record.good, [True, True, False])
    frame.assign(temp_c=["a", "b", "c"]).to_parquet(tmp_path / "o.parquet")
    with pytest.raises(InputError, match=r"temp_c holds .*string, expected numbers"):
        read_runs([tmp_path / "o.parquet"])


@pytest.mark.parametrize("seed", range(20))
def test_damaged_parquet_is_refused_or_unharmed(tmp_path, seed):
    path = tmp_path / "d.parquet"
    record = sample(rows=200)
    write_runs(record, path)
    data = bytearray(path.read_bytes())
    rng = np.random.default_rng(seed)
    if seed % 2:
        del data[int(rng.integers(len(data))) :]
    else:
        data[int(rng.integers(len(data)))] ^= int(rng.integers(1, 256))
    path.write_bytes(bytes(data))
    try:
        back = read_runs([path])
    except InputError as err:
        message = str(err)
    else:
        message = "d.parquet"
        assert [back.digest(r) for r in back.run_ids] == [record.digest(r) for r in record.run_ids]
    assert "d.parquet" in message
    assert "\n" not in message


def test_a_million_rows_in_seconds(tmp_path):
    record = sample(runs=10, rows=33_334)
    assert len(record) > 1_000_000
    write_runs(record, tmp_path / "big.csv")
    began = time.perf_counter()
    back = read_runs([tmp_path / "big.csv"], checked=False)
    took_s = time.perf_counter() - began
    assert len(back) == len(record)
    assert took_s < 20  # about 1 s on an idle machine; the rest is for a loaded one
    text = (tmp_path / "big.csv").read_text().splitlines(keepends=True)
    text[900_000] = text[900_000].replace(".", "?", 1)
    (tmp_path / "big.csv").write_text("".join(text))
    with pytest.raises(InputError, match="line 900001"):
        read_runs([tmp_path / "big.csv"])


def test_an_overload_that_an_instrument_reports_as_a_huge_number_may_stand_flagged(tmp_path):
    lines = "run,serial,time_s,temp_c,output,flag\n1,A,0,20,9.9e37,overload\n1,A,1,20,1,\n"
    record = read_runs([put(tmp_path, lines)])
    assert record.good.tolist() == [False, True]
