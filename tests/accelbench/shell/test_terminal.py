"""The standard streams: whatever becomes of their readers, nothing is raised and nothing waits."""

import io
import os
import re
import sys
import threading
from contextlib import contextmanager

import click
import pytest

from accelbench.shell.terminal import Terminal
from tests.accelbench.commands.run.display_process import PATIENCE_S, screen
from thermo.station.observers.detached import MOST


@contextmanager
def standing_still(monkeypatch):
    """Standard error on a terminal that takes nothing more, standard output somewhere else."""
    with screen() as made, open(made.slave, "w", closefd=False, encoding="utf-8") as stream:
        made.fill()
        out = io.StringIO()
        monkeypatch.setattr(sys, "stderr", stream)
        monkeypatch.setattr(sys, "stdout", out)
        yield made, out


def test_a_detached_terminal_takes_text_though_it_stands_still(monkeypatch):
    with standing_still(monkeypatch) as (made, out), Terminal() as terminal:
        worker = terminal.detach()
        for k in range(3000):
            click.echo(f"line {k}", err=True)
        click.echo("the result")
        assert not terminal.drain(0.1)
        assert out.getvalue() == "the result\n"
        made.read_along()
        assert terminal.close(PATIENCE_S)
        assert worker is terminal.worker
        seen = wait_for(made, b"line 2999")
    # the oldest were dropped, and it is said how many, where they would stand
    told = re.findall(rb"the terminal did not accept output; not shown: (\d+) line", seen)
    shown = [int(k) for k in re.findall(rb"line (\d+)\r", seen)]
    assert 0 < sum(map(int, told)) == 3000 - len(shown)
    assert shown[-MOST["line"] :] == list(range(2000, 3000))
    assert seen.index(b"not shown") < seen.index(b"line 2000")


def wait_for(made, text: bytes) -> bytes:
    waiting = threading.Event()
    for _ in range(int(PATIENCE_S / 0.02)):
        if text in made.seen:
            break
        waiting.wait(0.02)
    return made.seen


def test_a_reader_that_has_gone_is_noted_and_nothing_is_raised(monkeypatch):
    read, write = os.pipe()
    os.close(read)
    with open(write, "w", encoding="utf-8") as stream:
        monkeypatch.setattr(sys, "stdout", stream)
        with Terminal() as terminal:
            for _ in range(3):
                click.echo("nobody hears it")
            assert terminal.out.channel.lost == "standard output: Broken pipe"
            assert terminal.out.channel.complaint == ""


def test_a_full_disk_is_something_to_complain_of(monkeypatch):
    with open("/dev/full", "w", encoding="utf-8") as stream:
        monkeypatch.setattr(sys, "stdout", stream)
        with Terminal() as terminal:
            click.echo("a result")
            assert "No space left" in terminal.out.channel.complaint


def test_a_descriptor_that_does_not_wait_gets_everything_all_the_same(monkeypatch):
    read, write = os.pipe()
    os.set_blocking(write, False)
    text = "x" * 1_000_000
    got: list[bytes] = []

    def take() -> None:
        while piece := os.read(read, 65536):
            got.append(piece)

    reader = threading.Thread(target=take)
    reader.start()
    with open(write, "w", encoding="utf-8") as stream:
        monkeypatch.setattr(sys, "stdout", stream)
        with Terminal():
            click.echo(text)
    reader.join(PATIENCE_S)
    os.close(read)
    assert b"".join(got) == text.encode() + b"\n"


@pytest.mark.parametrize("detached", [False, True])
def test_streams_that_are_not_there_take_everything(monkeypatch, detached):
    monkeypatch.setattr(sys, "stdout", None)
    monkeypatch.setattr(sys, "stderr", None)
    with Terminal() as terminal:
        if detached:
            terminal.detach()
        click.echo("one")
        click.echo("two", err=True)
        assert not sys.stdout.isatty()
        assert terminal.close(PATIENCE_S)
    assert terminal.err.channel.lost == ""


def test_pieces_of_a_line_stay_together(monkeypatch):
    out = io.StringIO()
    monkeypatch.setattr(sys, "stdout", out)
    with Terminal() as terminal:
        terminal.detach()
        sys.stdout.write("a")
        sys.stderr.write("")
        sys.stdout.write("b\nc")
        assert terminal.close(PATIENCE_S)
    assert out.getvalue() == "ab\nc"
