import numpy as np
import pytest

from errormodel.errors import InputError
from sinscal.triad.plain_log import read_plain_log, step_of


@pytest.mark.parametrize(
    "text",
    [
        "1 2 3\n4 5 6\n",
        "  1.0e0   2.0   3.0\n\n4 5\t6\n",
        "1,2,3\n4,5,6\n",
        "# a comment\nt;x;y\n1;2;3\n4;5;6",
        '"t","x","y"\n"1","2","3"\n"4","5","6"\n',
        "1\t2\t3\r\n4\t5\t6\r\n",
    ],
)
def test_one_log_in_many_spellings(tmp_path, text):
    path = tmp_path / "log.txt"
    path.write_text(text, encoding="utf-8")
    np.testing.assert_array_equal(read_plain_log(path, ["3", "1"]), [[3, 1], [6, 4]])


def test_columns_by_name(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,ax,ay\n0,1,2\n", encoding="utf-8")
    np.testing.assert_array_equal(read_plain_log(path, ["ay", "t"]), [[2, 0]])


@pytest.mark.parametrize(
    ("text", "columns", "words"),
    [
        ("", ["1"], "is empty"),
        ("1 2\n3\n", ["1"], "line 2: 1 cells, expected 2"),
        ("1 2\n3 x\n", ["2"], "line 2: column 2 is 'x', expected a finite number"),
        ("1 2\n3 nan\n", ["2"], "line 2: column 2 is 'nan'"),
        ("1 2\n", ["3"], "line 1: no column '3', expected 1 to 2, or no header"),
        ("1 2\n", ["ax"], "no column 'ax'"),
        ("t,ax\n1,2\n", ["ay"], "or the header's t, ax"),
    ],
)
def test_a_fault_is_named_with_its_line(tmp_path, text, columns, words):
    path = tmp_path / "log.txt"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_plain_log(path, columns)
    assert words in str(caught.value)


def test_times_must_increase():
    assert step_of(np.array([0.0, 0.1, 0.2, 0.31]), "x") == pytest.approx(0.1)
    with pytest.raises(InputError, match="row 3: expected times that increase"):
        step_of(np.array([0.0, 0.1, 0.1]), "x")
