import io
import sys

from accelbench.shell.progress import left_text, working
from errormodel.progress import track


class Looked(io.StringIO):
    """Standard error where somebody looks at a terminal."""

    def isatty(self) -> bool:
        return True


def test_without_a_terminal_steps_are_lines_and_shares_are_not_told(capsys):
    with working("fitting") as work:
        work.tell("again")
        assert list(track((1, 2))) == [1, 2]
    assert capsys.readouterr().err == "again\n"


def test_on_a_terminal_there_is_a_bar_and_it_is_gone_afterwards(monkeypatch, capsys):
    seen = Looked()
    monkeypatch.setattr(sys, "stderr", seen)
    with working("fitting") as work:
        for _ in track((1, 2)):
            work.tell("a step")
    assert "a step" in seen.getvalue()
    assert seen.getvalue().rstrip().endswith("\x1b[2K")  # the bar's line is cleared
    assert capsys.readouterr().out == ""


def test_the_time_left_is_told_once_it_can_be():
    assert left_text(0.5, 0.5) == ""  # too early
    assert left_text(60.0, 0.01) == ""  # too little
    assert left_text(30.0, 0.25) == "25 %, about 1 min 30 s left"
    assert left_text(9.0, 0.9) == "90 %, about 1 s left"
