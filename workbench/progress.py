"""The progress of a test on standard error: where it is, how long it still takes, K0 and K1."""

import sys
import time
from collections.abc import Iterable, Sequence

import click
from rich.console import Console, RenderableType
from rich.progress import BarColumn, Progress, TaskID, TextColumn
from rich.text import Text

from thermo.live import LiveEstimate
from thermo.plan_text import duration_text
from thermo.station_types import Event
from thermo.station_types import Progress as TestProgress
from thermo.store_records import ReadingRow
from workbench.console import show_warnings_at_once

SHOWN = 3  # accelerometers with their live K0 on the line
STEP = 10  # percent between two lines where nobody looks at a terminal
WORTH_SHOWING = (
    "fault",
    "alarm",
    "complaint",
    "foreign change",
    "take-over",
    "pause",
    "gap",
    "resoak",
    "missed",
    "skipped",
    "position",
    "not safe",
    "run-in",
)


class _Bar(Progress):
    """A bar with a line of text below it."""

    below = ""

    def get_renderables(self) -> Iterable[RenderableType]:
        yield from super().get_renderables()
        if self.below:
            yield Text(self.below, no_wrap=True, overflow="ellipsis")


class ProgressView:
    """Shows a test while it runs (`thermo.station_types.Observer`); a context manager.

    On a terminal a bar; else a line every ten percent. The time left is the station's own; where
    the station runs faster than real time, the time at this desk stands beside it.

    Parameters
    ----------
    total_s : float
        Expected duration of the whole test, s.
    live : LiveEstimate, optional
        Whose K0 to show; it must be among the observers before this one.
    """

    def __init__(self, total_s: float, live: LiveEstimate | None = None) -> None:
        self._total_s = max(total_s, 1.0)
        self._live = live
        self._began_s = time.monotonic()
        self._told = 0
        self._begun = False
        self._done = 0.0
        self._bar: _Bar | None = None
        self._task: TaskID | None = None

    def __enter__(self) -> "ProgressView":
        if sys.stderr.isatty():
            self._bar = _Bar(
                TextColumn("{task.description}", markup=False),
                BarColumn(bar_width=12),
                TextColumn("{task.percentage:>3.0f} % {task.fields[note]}", markup=False),
                console=Console(stderr=True),
                refresh_per_second=4,
                transient=True,
            )
            self._bar.start()
            self._task = self._bar.add_task("starting", total=1.0, note="")
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def on_reading(self, run: int, rows: Sequence[ReadingRow]) -> None:
        """See nothing in it: the live estimate does."""

    def on_event(self, event: Event) -> None:
        """Tell what went wrong, at once."""
        if event.kind in WORTH_SHOWING:
            self._line(f"run {event.run}: {event.kind}: {event.text}")

    def on_progress(self, progress: TestProgress) -> None:
        """Move on."""
        if not self._begun:
            self._begun = True
            show_warnings_at_once()
        share = min(max(1.0 - progress.left_s / self._total_s, 0.0), 1.0)
        self._done = max(self._done, share)
        where = f"run {max(progress.run, 1)} of {progress.runs}, {progress.phase}"
        if progress.chamber_c is not None:
            where += f" {progress.chamber_c:+.1f} °C"
        if self._bar is not None and self._task is not None:
            self._bar.below = self._estimate().removeprefix(" · ")
            note = f"· {self._left(progress)}"
            self._bar.update(self._task, completed=self._done, description=where, note=note)
        elif int(100 * self._done) >= self._told + STEP:
            self._told = int(100 * self._done) // STEP * STEP
            self._line(f"{self._told} %: {where}; {self._left(progress)}{self._estimate()}")

    def tell(self, text: str) -> None:
        """Say what is being done when the test is over."""
        if self._bar is not None and self._task is not None:
            self._bar.below = ""
            self._bar.update(self._task, completed=1.0, description=text, note="")
        else:
            self._line(text)

    def _left(self, progress: TestProgress) -> str:
        text = f"{duration_text(progress.left_s)} left"
        spent_s = time.monotonic() - self._began_s
        here_s = spent_s * (1.0 - self._done) / self._done if self._done > 0.02 else None
        if here_s is not None and here_s < 0.5 * progress.left_s:
            text += f" there, {duration_text(here_s)} here"
        return text

    def _estimate(self) -> str:
        values = self._live.values() if self._live else ()
        return "".join(
            f" · {v.serial} K0 {v.k0_ug:.1f} ± {v.k0_sigma_ug:.1f} µg, "
            f"K1 ± {v.k1_sigma_ppm:.1f} ppm"
            for v in values[:SHOWN]
        )

    def _line(self, text: str) -> None:
        if self._bar is not None:
            self._bar.console.print(text, markup=False, highlight=False)
        else:
            click.echo(text, err=True)
