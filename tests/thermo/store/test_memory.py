"""What a recording and its fit take in memory, and an export that never stands whole."""

import tracemalloc
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import columns
from thermo.fitting.fit import TermsFile, fit_runs
from thermo.recording.files import make_runs, read_runs, write_runs
from thermo.recording.output_scale import OutputScale
from thermo.recording.summary import summary_of
from thermo.store import reading_queries
from thermo.store.export import export_test
from thermo.store.records import NewTest, ReadingRow
from thermo.store.store import Store, open_store
from thermo.store.stream import export_in_pieces

TERMS = TermsFile(terms=("k1", "k1_t1", "k0", "k0_t1", "k0_t2"))


def recording(path: Path, n: int) -> Path:
    rng = np.random.default_rng(1)
    x = np.interp(np.arange(n), [0, n / 2, n], [-60.0, 30.0, -60.0])
    angle_deg = 90.0 * (np.arange(n) // 8 % 4)
    force = np.sin(np.deg2rad(angle_deg))
    frame = pd.DataFrame(
        {
            "run": np.where(np.arange(n) < n // 2, "1", "2"),
            "serial": "A",
            "time_s": np.arange(n, dtype=float),
            "temp_c": 25.0 + x,
            "position_deg": angle_deg,
            "output": 1.2 * (1 + 8e-5 * x) * (force - 7e-6 * x) + 5e-6 * rng.standard_normal(n),
        }
    )
    runs = make_runs(frame, output_unit="mA", gravity_m_s2=9.81, nominal_scale=1.2)
    write_runs(runs, path)
    return path


def peak_of_fit(path: Path, terms: TermsFile | None) -> tuple[int, int]:
    """Return the most bytes that were held, after reading a recording and while it was fitted."""
    tracemalloc.start()
    try:
        runs = read_runs([path])
        held = tracemalloc.get_traced_memory()[0]
        fit_runs(runs, terms=terms)
        return held, tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("terms", "few"),
    [
        (TERMS, 20_000),
        pytest.param(TERMS, 60_000, marks=pytest.mark.slow),
        pytest.param(None, 60_000, marks=pytest.mark.slow),
    ],
    ids=["given", "given, long", "chosen"],
)
def test_reading_and_fitting_take_less_than_thirty_numbers_a_reading(
    tmp_path, monkeypatch, terms, few
):
    monkeypatch.setattr(columns, "KEPT", 0)  # as a long recording is fitted
    many = 2 * few
    fit_runs(read_runs([recording(tmp_path / "2.csv", 2000)]), terms=terms)  # imports, compilers
    held, peak = peak_of_fit(recording(tmp_path / "many.csv", many), terms)
    less = peak_of_fit(recording(tmp_path / "few.csv", few), terms)[1]
    assert held / many < 60  # bytes: four numbers and three codes are 44
    # 5e6 readings shall be fitted below 1.5 GB with 0.3 GB for the program; the blocks of columns
    # do not grow with the readings
    assert (peak - less) / (many - few) < 240


@pytest.fixture
def stored(tmp_path):
    rng = np.random.default_rng(5)
    with open_store(tmp_path / "night.sqlite") as store:
        test_id = store.begin_test(NewTest("x", "", "{}"))
        for run in (1, 2, 10):
            store.begin_run(test_id, run, "2026-11-22T22:15:00+00:00")
            for slot in range(20):
                store.append(test_id, run, list(_scan(slot, rng)))
        store.mark_attempt(test_id, 2, 1)
        yield store, test_id


def _scan(slot: int, rng: np.random.Generator):
    for serial in ("B", "A", "=C"):
        yield ReadingRow(
            serial=serial,
            slot=slot,
            segment=slot // 10,
            time_s=10.0 * slot + rng.uniform(),
            temp_c=None if rng.uniform() < 0.1 else 20.0 + rng.uniform(),
            position_deg=None if serial == "=C" or rng.uniform() < 0.1 else 90.0 * (slot % 4),
            output=rng.uniform(),
            chamber_c=20.0,
            flag="moving" if rng.uniform() < 0.1 else "",
        )


@pytest.mark.parametrize("mount_deg", [{}, {"A": 90.0, "=C": 10.0}], ids=["plain", "turned"])
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize("piece", [11, 1000])
def test_an_export_in_pieces_is_the_export_of_the_whole(
    stored: tuple[Store, str], tmp_path, monkeypatch, suffix, mount_deg, piece
):
    store, test_id = stored
    monkeypatch.setattr(reading_queries, "PIECE", piece)
    whole, parted = tmp_path / f"whole{suffix}", tmp_path / f"parted{suffix}"
    scale = OutputScale(output_unit="mA", gravity_m_s2=9.81, nominal_scale=1.3)
    record = export_test(
        store, test_id, whole,
        output_unit="mA", gravity_m_s2=9.81, nominal_scale=1.3, mount_deg=mount_deg,
    )  # fmt: skip
    summary = export_in_pieces(
        store, test_id, parted, scale=scale, serials=["A", "B", "=C"], mount_deg=mount_deg
    )
    assert summary == summary_of(record) == summary_of(read_runs([parted], checked=False))
    assert parted.with_suffix(".toml").read_text() == whole.with_suffix(".toml").read_text()
    if suffix == ".csv":
        assert parted.read_bytes() == whole.read_bytes()


def test_an_export_that_fails_in_its_middle_leaves_what_was_there(stored, tmp_path, monkeypatch):
    store, test_id = stored
    store.append(test_id, 10, [ReadingRow(
        serial="A", slot=99, time_s=999.0, temp_c=5000.0, position_deg=0.0, output=1.0
    )])  # fmt: skip
    monkeypatch.setattr(reading_queries, "PIECE", 7)
    out = tmp_path / "run.csv"
    out.write_text("as before")
    scale = OutputScale(output_unit="mA", gravity_m_s2=9.81, nominal_scale=1.3)
    with pytest.raises(Exception, match=r"run 10 serial A time_s 999\.0: temp_c 5000, expected"):
        export_in_pieces(store, test_id, out, scale=scale, serials=["A"], mount_deg={})
    assert out.read_text() == "as before"
    assert [p.name for p in tmp_path.iterdir() if p.suffix in {".part", ".toml"}] == []
