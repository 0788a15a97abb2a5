"""Tables read and written in pieces, refused by size, and texts that no spreadsheet evaluates."""

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from errormodel.errors import InputError
from errormodel.io import memory, table_csv, tables
from errormodel.io.table_write import write_with_sidecar
from errormodel.io.tables import TableForm, column_names, read_table
from errormodel.io.text_cells import cell_of_text, text_of_cell

FORM = TableForm(numbers=("x", "y"), texts=("name", "flag"), required=("name", "x"))
SIGNS = "=+-@\t\r'"


def written(frame: pd.DataFrame, path: Path) -> Path:
    write_with_sidecar(frame, "", path)
    return path


def sample(n: int = 500) -> pd.DataFrame:
    rng = np.random.default_rng(3)
    return pd.DataFrame(
        {
            "name": rng.choice(["A", "=B", "c,d", "'-1", "-12"], n),
            "x": rng.standard_normal(n),
            "y": np.where(rng.uniform(size=n) < 0.2, np.nan, -rng.uniform(size=n)),
            "flag": rng.choice(["", "gap"], n),
        }
    )


def texts(table: tables.RawTable, name: str) -> list[str]:
    codes, names = table.text[name]
    return [names[k] for k in codes]


def assert_same(table: tables.RawTable, frame: pd.DataFrame) -> None:
    for name in FORM.numbers:
        np.testing.assert_array_equal(table.number[name], frame[name].to_numpy())
    for name in FORM.texts:
        assert texts(table, name) == frame[name].tolist()
        codes, names = table.text[name]
        assert names == tuple(dict.fromkeys(frame[name]))  # in order of appearance
        assert codes.dtype == np.int32


@settings(max_examples=8, deadline=None)
@given(block=st.integers(200, 5000), batch=st.integers(1, 700), cut=st.integers(1, 600))
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_pieces_of_any_size_give_the_table_that_was_written(
    tmp_path_factory, suffix, block, batch, cut
):
    frame, path = sample(), tmp_path_factory.mktemp("pieces") / f"run{suffix}"
    write_with_sidecar((frame[k : k + cut] for k in range(0, len(frame), cut)), "", path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(table_csv, "BLOCK_BYTES", block)
        patch.setattr(tables, "BATCH", batch)
        assert_same(read_table(path, FORM), frame)


@settings(max_examples=10, deadline=None)
@given(piece=st.integers(1, 40))
def test_careful_reading_in_pieces_of_any_size_names_the_same_line(tmp_path_factory, piece):
    path = tmp_path_factory.mktemp("careful") / "run.csv"
    path.write_text("name,x,y\n" + "A, 1 ,2\n\n" * 60 + "A,z,2\n", encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(table_csv, "PIECE", piece)
        with pytest.raises(InputError, match=r"line 122: x 'z'"):
            read_table(path, FORM)


@settings(max_examples=60, deadline=None)
@given(st.text(alphabet=st.sampled_from(SIGNS + 'A1 ",;é')) | st.text())
def test_a_text_comes_back_from_its_cell_and_is_no_formula(text):
    cell = cell_of_text(text)
    assert text_of_cell(cell) == text
    assert not cell.startswith(tuple("=+-@\t\r"))


@settings(max_examples=20, deadline=None)
@given(
    st.lists(
        st.text(alphabet=st.sampled_from("=+-@'A1 ,\"é"), min_size=1, max_size=6),
        min_size=1,
        max_size=8,
    )
)
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_texts_and_negative_numbers_come_back_from_a_file(tmp_path_factory, suffix, names):
    frame = pd.DataFrame({"name": names, "x": -1.5, "y": -0.0, "flag": ""})
    path = written(frame, tmp_path_factory.mktemp("texts") / f"run{suffix}")
    assert_same(read_table(path, FORM), frame)
    if suffix == ".csv":
        assert ",-1.5,-0," in path.read_text(encoding="utf-8").splitlines()[1]


def test_a_foreign_files_minus_stays(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("name,x\n-12,1\n'-12,2\n'A,3\n", encoding="utf-8")
    assert texts(read_table(path, FORM), "name") == ["-12", "-12", "'A"]


def bomb(path: Path, rows: int) -> Path:
    """Write equal rows, which Parquet keeps in next to nothing."""
    name = pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, np.int32)), ["A"])
    pq.write_table(pa.table({"name": name, "x": np.zeros(rows), "y": np.zeros(rows)}), path)
    return path


def test_a_parquet_bomb_is_refused_by_its_size(tmp_path, monkeypatch):
    path = bomb(tmp_path / "run.parquet", 1_000_000)
    assert path.stat().st_size < 100_000
    monkeypatch.setattr(memory, "available_bytes", lambda: 100_000_000)
    monkeypatch.setattr(tables, "GrowingTable", None)  # nothing of it is read
    with pytest.raises(
        InputError,
        match=r"1000000 rows of 3 columns need about 0\.12 GB of memory, 0\.1 GB are available; ",
    ):
        read_table(path, FORM)


def test_a_csv_with_a_hole_is_refused_by_its_size(tmp_path, monkeypatch):
    path = tmp_path / "run.csv"
    path.write_text("name,x\n" + "A,1.5\n" * 20_000, encoding="utf-8")
    os.truncate(path, 4_000_000_000)
    monkeypatch.setattr(memory, "available_bytes", lambda: 1_000_000_000)
    monkeypatch.setattr(table_csv, "GrowingTable", None)
    with pytest.raises(InputError, match=r"about \d+ rows of 2 columns need about 4\d\.?\d* GB"):
        read_table(path, FORM)


def test_a_file_that_is_one_hole_is_refused_at_its_line(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("name,x\n", encoding="utf-8")
    os.truncate(path, 40_000_000)
    with pytest.raises(InputError, match=r"line 2: is longer than 16777216 characters"):
        read_table(path, FORM)


def test_a_header_of_a_million_columns_is_refused(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("name,x" + ",c" * 1_000_000 + "\n", encoding="utf-8")
    for read in (lambda: read_table(path, FORM), lambda: column_names(path)):
        with pytest.raises(InputError, match=r"line 1: is longer than 1048576 characters"):
            read()


def test_what_is_available_is_known_and_less_than_a_machine_has():
    available = memory.available_bytes()
    total = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    assert available is not None
    assert 0 < available < total


@pytest.mark.parametrize(("limit", "left"), [("1000000", 1000000 - 300000 + 100000), ("max", None)])
def test_a_control_groups_cache_is_given_back(tmp_path, limit, left):
    (tmp_path / "memory.max").write_text(f"{limit}\n")
    (tmp_path / "memory.current").write_text("300000\n")
    (tmp_path / "memory.stat").write_text("anon 1\ninactive_file 100000\n")
    assert memory._group_left(tmp_path, "memory.max", "memory.current") == left
