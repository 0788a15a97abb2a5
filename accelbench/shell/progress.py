"""Display of progress and time left, on a terminal; lines elsewhere."""

import sys
import time
from collections.abc import Generator
from contextlib import contextmanager
from typing import TextIO, cast

import click
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from errormodel.progress import listening

BELIEVED = 0.05  # of the work is done before the time left is told
BELIEVED_S = 1.0
FRAME_S = 0.1  # between two changes of what is shown


class Work:
    """A computation that is being shown.

    Parameters
    ----------
    bar : Progress or None
        None where nobody looks at a terminal.
    text : str
        What is done.
    steps : int
        How often `tell` will be called, for work that tells its steps and no share; 0: it does.
    """

    def __init__(self, bar: Progress | None, text: str, steps: int = 0) -> None:
        self._bar = bar
        self._steps = steps
        self._told = 0
        self._began_s = time.monotonic()
        self._shown_s = 0.0
        self._done = 0.0
        self._task = bar.add_task(text, total=None, note="") if bar is not None else None

    def tell(self, text: str) -> None:
        """Say what is done now: beside the bar, or in a line where there is no terminal."""
        if self._bar is None or self._task is None:
            click.echo(text, err=True)
        else:
            self._bar.update(self._task, description=text)
        if self._steps:
            self.on_share(self._told / self._steps)
            self._told = min(self._told + 1, self._steps)

    def on_share(self, share: float) -> None:
        """Take the share of the work that is done; a bar never goes back."""
        now_s = time.monotonic()
        self._done = max(self._done, share)
        if self._bar is None or self._task is None or now_s < self._shown_s + FRAME_S:
            return
        self._shown_s = now_s
        note = left_text(now_s - self._began_s, self._done)
        self._bar.update(self._task, total=1.0, completed=self._done, note=note)


def left_text(spent_s: float, done: float) -> str:
    """Say how long the rest will take, if it goes on as it began; nothing at the beginning."""
    if done < BELIEVED or spent_s < BELIEVED_S:
        return ""
    left_s = round(spent_s * (1.0 - done) / done)
    minutes, seconds = divmod(left_s, 60)
    text = f"{minutes} min {seconds:02d} s" if minutes else f"{seconds} s"
    return f"{100.0 * done:.0f} %, about {text} left"


@contextmanager
def working(text: str, *, steps: int = 0) -> Generator[Work]:
    """Show within the block how far its computation is; the bar is gone afterwards.

    Parameters
    ----------
    text : str
        What is done, in a few words.
    steps : int
        As `Work` takes it.

    Yields
    ------
    Work
        Its `tell` takes the names of steps.
    """
    if not sys.stderr.isatty():
        yield Work(None, text, steps)
        return
    bar = Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=24),
        TimeElapsedColumn(),
        TextColumn("{task.fields[note]}", markup=False),
        console=Console(file=cast(TextIO, sys.stderr)),
        redirect_stdout=False,
        transient=True,
    )
    with bar:
        work = Work(bar, text, steps)
        with listening(work.on_share):
            yield work
