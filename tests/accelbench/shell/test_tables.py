import io

import pytest
from rich.console import Console

from accelbench.shell.console import emit
from accelbench.shell.tables import TextTable, copied


def wide() -> TextTable:
    made = TextTable(
        ("serial", "K0 1σ µg", "limits", "K1 1σ ppm", "curves rms µg", "what it is"),
        right=("K0 1σ µg", "K1 1σ ppm", "curves rms µg"),
        words=("what it is",),
    )
    made.add_row("QA-001", "< 9.58", "0 to 9.58", "0.454", "4.06", "a run differs from the others")
    made.add_row("QA-002", "2.66", "0 to 23", "< 8.24", "6.42", "noise")
    return made


def printed(table: TextTable, width: int, *, terminal: bool) -> list[str]:
    console = Console(
        file=io.StringIO(),
        width=width,
        force_terminal=terminal,
        color_system=None,
        highlight=False,
        soft_wrap=not terminal,
    )
    console.print(table)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue().splitlines()


@pytest.mark.parametrize("width", [34, 40, 60, 80, 120])
def test_no_line_is_wider_than_the_terminal_and_no_value_is_broken(width):
    lines = printed(wide(), width, terminal=True)
    assert max(len(line) for line in lines) <= width
    text = "\n".join(lines)
    for value in ("QA-001", "< 9.58", "0 to 9.58", "0.454", "4.06", "2.66", "0 to 23", "< 8.24"):
        assert value in text


def test_a_part_that_follows_is_led_by_the_keys_again():
    lines = printed(wide(), 34, terminal=True)
    headed = [line for line in lines if line.startswith("serial")]
    assert len(headed) > 1
    assert sum(line.startswith("QA-002") for line in lines) == len(headed)


def test_a_terminal_too_narrow_for_one_column_still_shows_all_of_it():
    made = TextTable(("id", "n"))
    made.add_row("20261130T215702-ace6-1", "660")
    assert "20261130T215702-ace6-1" in "".join(printed(made, 10, terminal=True))


def test_a_file_gets_the_table_whole_however_wide():
    lines = printed(wide(), 40, terminal=False)
    assert len(lines) == 3
    assert lines[1].split() == [
        "QA-001", "<", "9.58", "0", "to", "9.58", "0.454", "4.06",
        "a", "run", "differs", "from", "the", "others",
    ]  # fmt: skip


def test_a_number_s_minus_can_be_copied_and_a_sentence_s_stays(capsys):
    assert copied("heating − cooling: −1.02 µg, −.5") == "heating − cooling: -1.02 µg, -.5"
    made = TextTable(("value",))
    made.add_row("−528.6 ± 3.6")
    emit({}, [made, "K0 is −528.6 µg"], as_json=False)
    value, sentence = capsys.readouterr().out.splitlines()[1:]
    assert float(value.split()[0]) == -528.6
    assert sentence == "K0 is -528.6 µg"


def test_a_row_of_another_number_of_cells_is_refused():
    with pytest.raises(ValueError, match="2 cells, expected 1"):
        TextTable(("one",)).add_row("a", "b")
