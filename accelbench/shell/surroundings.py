"""Surroundings of a command: its warnings, its terminal, the signals that end it."""

import logging
import os
import signal
import threading
from dataclasses import dataclass, field
from types import FrameType
from typing import TYPE_CHECKING

import click

from accelbench.shell.terminal import Terminal
from thermo.station.observers.detached import CLOSE_S

if TYPE_CHECKING:
    from accelbench.shell.laboratory import Laboratory

DONE, FAILED, MISUSE, STOPPED = 0, 1, 2, 130
HELD_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class HeldWarnings(logging.Handler):
    """Keeps warnings until it is known that they do not stand beside an error of one line.

    Tracebacks are never shown; `go_live` shows what follows at once, for commands that take hours.
    The same line is shown once.
    """

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self._lines: dict[str, None] = {}  # in the order in which they came
        self._live = False

    def emit(self, record: logging.LogRecord) -> None:
        """Take one record."""
        line = f"accelbench: warning: {' '.join(record.getMessage().split())}"
        if line in self._lines:
            return
        self._lines[line] = None
        if self._live:
            click.echo(line, err=True)

    def go_live(self) -> None:
        """Show what was held, and the rest as it comes."""
        if self._live:
            return
        self._live = True
        for line in self._lines:
            click.echo(line, err=True)


class LateSignals:
    """Sees to it that a signal after a test does not keep its outcome from being told.

    While a test runs, signals are `thermo.launch.real`'s. What comes before it has begun does
    what it always did; what comes after it has ended is ignored.
    """

    def __init__(self) -> None:
        self.begun = False
        self._before: dict[int, signal.Handlers | int | object] = {}

    def install(self) -> None:
        """Take over; in another thread than the main one do nothing."""
        if threading.current_thread() is not threading.main_thread():
            return
        for number in HELD_SIGNALS:
            # what was ignored before (nohup, a job in the background) is meant to stay so
            if number not in self._before and signal.getsignal(number) is not signal.SIG_IGN:
                self._before[number] = signal.signal(number, self._handle)

    def release(self) -> None:
        """Let signals do again what they did before."""
        for number, handler in self._before.items():
            signal.signal(number, handler)  # type: ignore[arg-type]
        self._before.clear()

    def ignore_for_good(self) -> None:
        """Ignore them until the process has ended: the interpreter's end restores handlers."""
        for number in self._before:
            signal.signal(number, signal.SIG_IGN)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self.begun:
            return
        self.release()
        signal.raise_signal(number)


@dataclass(slots=True)
class Shell:
    """Surroundings of one command; the laboratory is the one stated with `--lab`."""

    terminal: Terminal
    laboratory: "Laboratory | None" = None
    held: HeldWarnings = field(default_factory=HeldWarnings)
    late_signals: LateSignals = field(default_factory=LateSignals)

    def end(self, code: int, *, program: bool) -> int:
        """Write what is left and return the exit code.

        A result that could not be written is misuse; of a command that detached its terminal, a
        test, the code is the test's all the same. A program whose reader stands still ends here.
        """
        if program:
            self.late_signals.ignore_for_good()
        else:
            self.late_signals.release()
        terminal = self.terminal
        written = terminal.drain(CLOSE_S)
        if complaint := terminal.out.channel.complaint:
            code = MISUSE if code == DONE and terminal.worker is None else code
            click.echo(f"accelbench: {complaint}", err=True)
        if not terminal.close(CLOSE_S if written else 0.0) and program:
            logging.shutdown()
            os._exit(code)  # a thread waits in the operating system for a reader
        return code


def current_shell() -> Shell:
    """Return the running command's; one that does nothing special outside of any."""
    context = click.get_current_context(silent=True)
    found = context.obj if context is not None else None
    return found if isinstance(found, Shell) else Shell(Terminal())


def show_warnings_at_once() -> None:
    """From here on show warnings as they come: what follows may take hours."""
    current_shell().held.go_live()
