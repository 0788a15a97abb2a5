"""The progress of a test on standard error: where it is, how long it still takes, K0 and K1."""

import time
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TextIO, cast

from rich.console import Console, RenderableType
from rich.progress import BarColumn, Progress, TaskID, TextColumn
from rich.text import Text

from accelbench.shell.console import value_and_sigma
from accelbench.shell.surroundings import Shell, current_shell
from accelbench.shell.tables import copied
from accelbench.shell.terminal import OutputStream, Terminal
from thermo.planning.text import duration_text
from thermo.station.observers.detached import DetachedObserver
from thermo.station.observers.live import LiveEstimate
from thermo.station.outcome import Event, Observer
from thermo.station.outcome import Progress as TestProgress
from thermo.store.records import ReadingRow

SHOWN = 3  # accelerometers with their live K0 on the line
STEP = 10  # percent between two lines where nobody looks at a terminal
FRAME_S = 0.25  # real seconds between two pictures of the bar
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
    "display",
)


class _Bar(Progress):
    """A bar with a line of text below it."""

    below = ""

    def get_renderables(self) -> Iterable[RenderableType]:
        yield from super().get_renderables()
        if self.below:
            yield Text(self.below, no_wrap=True, overflow="ellipsis")


class _Writer:
    """File for rich to draw into: the channel itself, in the thread that may wait for it."""

    def __init__(self, channel: OutputStream) -> None:
        self._channel = channel
        self.encoding = channel.encoding

    def write(self, text: str) -> int:
        self._channel.write(text)
        return len(text)

    def flush(self) -> None:
        pass

    def isatty(self) -> bool:
        return self._channel.is_terminal


class ProgressView:
    """Shows a test while it runs (`thermo.station.outcome.Observer`).

    On a terminal a bar; else a line every ten percent. The time left is the station's own; where
    the station runs faster than real time, the time at this desk stands beside it. All of it may
    wait for the terminal: `watching` has it done in a thread.

    Parameters
    ----------
    total_s : float
        Expected duration of the whole test, s.
    terminal : Terminal
    live : LiveEstimate, optional
        Whose K0 to show; it must be among the observers before this one.
    """

    def __init__(
        self, total_s: float, terminal: Terminal, live: LiveEstimate | None = None
    ) -> None:
        self._total_s = max(total_s, 1.0)
        self._live = live
        self._terminal = terminal
        self._began_s = time.monotonic()
        self._drawn_s = 0.0
        self._told = 0
        self._done = 0.0
        self._bar: _Bar | None = None
        self._task: TaskID | None = None

    @property
    def lost(self) -> str:
        """Reason why nothing can be shown any more; empty as long as it can."""
        return self._terminal.err.channel.lost

    def start(self) -> None:
        """Draw the bar where somebody looks at a terminal."""
        stream = self._terminal.err
        if stream.isatty():
            self._bar = _Bar(
                TextColumn("{task.description}", markup=False),
                BarColumn(bar_width=12),
                TextColumn("{task.percentage:>3.0f} % {task.fields[note]}", markup=False),
                console=Console(file=cast("TextIO", _Writer(stream.channel))),
                auto_refresh=False,
                redirect_stdout=False,
                redirect_stderr=False,
                transient=True,
            )
            self._bar.start()
            self._task = self._bar.add_task("starting", total=1.0, note="")
            stream.show_by(self._print)

    def stop(self) -> None:
        """Take the bar away."""
        if self._bar is not None:
            self._terminal.err.show_by(None)
            self._bar.stop()
            self._bar = None

    def on_reading(self, run: int, rows: Sequence[ReadingRow]) -> None:
        """See nothing in it: the live estimate does."""

    def on_event(self, event: Event) -> None:
        """Tell what went wrong, at once."""
        if event.kind in WORTH_SHOWING:
            self._line(f"run {event.run}: {event.kind}: {event.text}")

    def on_progress(self, progress: TestProgress) -> None:
        """Move on."""
        share = min(max(1.0 - progress.left_s / self._total_s, 0.0), 1.0)
        self._done = max(self._done, share)
        where = f"run {max(progress.run, 1)} of {progress.runs}, {progress.phase}"
        if progress.chamber_c is not None:
            where += f" {progress.chamber_c:+.1f} °C"
        if self._bar is not None and self._task is not None:
            self._bar.below = self._estimate().removeprefix(" · ")
            note = f"· {self._left(progress)}"
            self._draw(self._task, completed=self._done, description=where, note=note)
        elif int(100 * self._done) >= self._told + STEP:
            self._told = int(100 * self._done) // STEP * STEP
            self._line(f"{self._told} %: {where}; {self._left(progress)}{self._estimate()}")

    def tell(self, text: str) -> None:
        """Say what is being done when the test is over."""
        if self._bar is not None and self._task is not None:
            self._bar.below = ""
            self._drawn_s = 0.0
            self._draw(self._task, completed=1.0, description=text, note="")
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
        """Tell K0 and K1 where they can be compared over the test: at one temperature."""
        values = self._live.values() if self._live else ()
        if not values:
            return ""
        told = [
            f"{v.serial} K0 {value_and_sigma(v.k0_ref_ug, v.k0_ref_sigma_ug)} µg, "
            f"K1 {value_and_sigma(1e6 * (v.k1_ref - 1.0), v.k1_ref_sigma_ppm)} ppm from nominal"
            for v in values[:SHOWN]
        ]
        return copied(f" · at {values[0].t_ref_c:g} °C: {' · '.join(told)}")

    def _draw(self, task: TaskID, *, completed: float, description: str, note: str) -> None:
        if self._bar is None:
            return
        self._bar.update(task, completed=completed, description=description, note=note)
        if time.monotonic() >= self._drawn_s + FRAME_S:
            self._drawn_s = time.monotonic()
            self._bar.refresh()

    def _line(self, text: str) -> None:
        self._print(f"{text}\n")

    def _print(self, text: str) -> None:
        if self._bar is not None:
            self._bar.console.print(text.removesuffix("\n"), markup=False, highlight=False)
        else:
            self._terminal.err.channel.write(text)


class _Beginning:
    """Tells the shell that a test has begun: in the test's own thread, at once."""

    def __init__(self, shell: Shell) -> None:
        self._shell = shell

    def on_reading(self, run: int, rows: Sequence[ReadingRow]) -> None:
        """Nothing to do."""

    def on_progress(self, progress: TestProgress) -> None:
        """Nothing to do."""

    def on_event(self, event: Event) -> None:
        """See the first."""
        if not self._shell.late_signals.begun:
            self._shell.late_signals.begun = True
            self._shell.held.go_live()


@dataclass(frozen=True, slots=True)
class Watch:
    """The observers of a test that is shown on the terminal."""

    observers: tuple[Observer, ...]
    tell: Callable[[str], None]


@contextmanager
def watching(total_s: float, live: LiveEstimate | None = None) -> Generator[Watch]:
    """Show a test on the terminal without ever holding it up.

    Parameters
    ----------
    total_s : float
        Expected duration of the whole test, s.
    live : LiveEstimate, optional
        Follows the test in its own thread, for its time is bounded; its K0 are shown.

    Yields
    ------
    Watch
        The test's observers, and what says in a few words what is done when it is over.
    """
    shell = current_shell()
    worker = shell.terminal.detach()
    view = ProgressView(total_s, shell.terminal, live)
    worker.post(view.start, "result")
    mine = (live,) if live is not None else ()
    try:
        yield Watch(
            observers=(*mine, _Beginning(shell), DetachedObserver(view, worker)),
            tell=lambda text: worker.post(lambda: view.tell(text), "result"),
        )
    finally:
        worker.post(view.stop, "result")
