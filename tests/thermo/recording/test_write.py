"""Recorded runs written and read again: bit for bit, or refused."""

import datetime as dt

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from errormodel.errors import InputError
from tests.thermo.recording.sample_runs import sample
from thermo.recording.files import make_runs, read_runs, write_runs


@pytest.mark.parametrize("name", ["out.csv", "out.parquet"])
def test_written_runs_come_back_bit_for_bit(tmp_path, name):
    n = 300
    flags = np.where(np.arange(n) % 7 == 0, "moving", "")
    output = np.where(np.arange(n) % 14 == 0, np.nan, 0.1 + np.arange(n) * np.pi)
    record = sample(flag=flags, output=output, chamber_c=np.linspace(-40, 70, n))
    write_runs(record, tmp_path / name)
    back = read_runs([tmp_path / name], checked=False)
    pd.testing.assert_frame_equal(back.frame(), record.frame(), check_exact=True)
    assert back.scales == record.scales
    assert [back.digest(r) for r in back.run_ids] == [record.digest(r) for r in record.run_ids]
    assert not back.good[::7].any()
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([name, "out.toml"])


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=20))
def test_any_double_survives_csv(tmp_path_factory, values):
    path = tmp_path_factory.mktemp("doubles") / "x.csv"
    frame = pd.DataFrame(
        {
            "run": "1",
            "serial": "A",
            "time_s": np.arange(len(values)),
            "temp_c": 20.0,
            "output": values,
        }
    )
    record = make_runs(frame, output_unit="V", gravity_m_s2=9.8, nominal_scale=-1e303)
    write_runs(record, path)
    assert read_runs([path], checked=False).output.tobytes() == np.array(values).tobytes()


def test_awkward_names_survive(tmp_path):
    names = ['a,b "c"', "ä / 7", "#1", "\\"]
    frame = pd.DataFrame(
        {"run": names, "serial": names, "time_s": 0.0, "temp_c": 20.0, "output": 1.0}
    )
    starts = {names[0]: dt.datetime(2026, 1, 2, tzinfo=dt.UTC), names[3]: dt.datetime(2026, 1, 3)}
    record = make_runs(
        frame, output_unit="g", gravity_m_s2=9.8, nominal_scale=1, run_start_utc=starts
    )
    write_runs(record, tmp_path / "n.csv")
    back = read_runs([tmp_path / "n.csv"])
    assert back.run_ids == tuple(names)
    assert back.serials == tuple(names)
    assert back.run_start_utc == {n: t.replace(tzinfo=dt.UTC) for n, t in starts.items()}


def test_writing_refuses_before_it_touches(tmp_path):
    with pytest.raises(InputError, match=r"expected a name ending in \.csv or \.parquet"):
        write_runs(sample(), tmp_path / "x.xlsx")
    with pytest.raises(InputError, match="cannot be written"):
        write_runs(sample(), tmp_path / "nowhere" / "x.csv")
    assert list(tmp_path.iterdir()) == []
