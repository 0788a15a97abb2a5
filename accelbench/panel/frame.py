"""The frame of every page: navigation, alarms, running tests with their abort, the key Esc."""

import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from datetime import datetime
from html import escape
from importlib.resources import files

from nicegui import ui
from starlette.requests import Request

from accelbench.panel.access.sessions import Visitor
from accelbench.panel.access.users import may
from accelbench.panel.context import PanelContext
from accelbench.panel.watch import Snapshot
from accelbench.panel.work import in_thread, tell

PAGES = (
    ("Tests", "/"),
    ("Plan", "/plan"),
    ("Queue", "/queue"),
    ("Alarms", "/alarms"),
    ("Results", "/results"),
    ("History", "/history"),
)
# dark enough for white letters on them (WCAG's 4.5)
COLOURS = {
    "primary": "#00558c",
    "positive": "#00664a",
    "negative": "#9b0020",
    "warning": "#7a4a00",
}
TICK_S = 0.5
OLD_S = 3.0  # the store's reader looks four times a second; after this it is called silent

CSS = files("accelbench.panel").joinpath("page.css").read_text(encoding="utf-8")


def visitor_of(request: Request) -> Visitor:
    """Return who asks for a page; the guard has let nobody else through."""
    visitor = request.scope["accelbench.visitor"]
    assert isinstance(visitor, Visitor)
    return visitor


@contextmanager
def frame(context: PanelContext, request: Request, title: str, here: str) -> Generator[Visitor]:
    """Make the frame of a page; what is made inside is its content."""
    visitor = visitor_of(request)
    ui.page_title(f"{title} · accelbench")
    ui.add_css(CSS)
    ui.colors(**COLOURS)
    dark = ui.dark_mode(visitor.is_dark)
    abort = AbortDialog(context, visitor)
    with ui.header().classes("bar"):
        ui.label("accelbench").classes("brand")
        for name, path in PAGES:
            link = ui.link(name, path)
            if path == here:
                link.classes("here").props("aria-current=page")
        ui.space()
        if may(visitor.role, "operate"):
            abort.button()
        _who(context, visitor, dark)
    notes = ui.html("", sanitize=False).classes("w-full").props("role=status aria-live=polite")

    def tick() -> None:
        if not context.sessions.holds(visitor):
            ui.navigate.to("/login")
            return
        snapshot = context.watch.snapshot
        notes.set_content(_notes(snapshot))
        abort.update(snapshot)

    ui.timer(TICK_S, tick)
    with ui.column().classes("w-full gap-3").props("role=main"):
        yield visitor
    tick()


def _who(context: PanelContext, visitor: Visitor, dark: ui.dark_mode) -> None:
    def turn() -> None:
        visitor.is_dark = not visitor.is_dark
        dark.set_value(visitor.is_dark)

    ui.button(icon="contrast", on_click=turn).props(
        "flat round dense color=white aria-label='Light or dark'"
    ).tooltip("Light or dark")
    ui.label(f"{visitor.name} · may {visitor.role}").classes("note").style("color:#c9d4dd")
    if context.sessions.everybody is None:
        with ui.element("form").props("method=post action=/logout"):
            ui.button("Log out").props("flat dense color=white type=submit")


class AbortDialog:
    """Abort from every page, by button or Esc: it asks once and acts at once."""

    def __init__(self, context: PanelContext, visitor: Visitor) -> None:
        self._context = context
        self._visitor = visitor
        self._client = ui.context.client
        self._running: tuple[str, ...] = ()
        self._button: ui.button | None = None
        with ui.dialog() as self._dialog, ui.card().classes("card"):
            ui.html("<h2>Abort a running test?</h2>", sanitize=False)
            ui.label(
                "The chamber goes to its safe temperature, read back. The test can be resumed."
            )
            self._choice = ui.select([], label="Test").classes("w-full")
            self._reason = ui.input("Reason (kept with the test)").classes("w-full")
            with ui.row():
                ui.button("Abort now", color="negative", on_click=self._abort).props("autofocus")
                ui.button("Let it run", on_click=self._dialog.close, color=None).props("flat")
        if may(visitor.role, "operate"):
            ui.keyboard(on_key=self._key, ignore=[])

    def button(self) -> None:
        """Make the button that opens it; it cannot be pressed while no test runs."""
        self._button = ui.button("Abort (Esc)", color="negative", on_click=self.open)
        self._button.props("dense unelevated icon=stop").set_enabled(False)

    def update(self, snapshot: Snapshot) -> None:
        """Take over which tests run."""
        running = tuple(b.test_id for b in snapshot.running)
        if running == self._running:
            return
        self._running = running
        self._choice.set_options(list(running), value=running[0] if running else None)
        if self._button is not None:
            self._button.set_enabled(bool(running))

    def open(self, test_id: str | None = None) -> None:
        """Ask."""
        if self._running:
            self._choice.set_value(test_id if test_id in self._running else self._running[0])
            self._dialog.open()

    def _key(self, event: object) -> None:
        key, action = getattr(event, "key", None), getattr(event, "action", None)
        pressed = action is not None and action.keydown and not action.repeat
        if key is not None and key.escape and pressed and not self._dialog.value:
            self.open()

    async def _abort(self) -> None:
        test_id = self._choice.value
        self._dialog.close()
        if test_id:
            ui.notify(f"Aborting {test_id} …", type="warning")
            control, reason = self._context.actions.control, str(self._reason.value or "")
            outcome = await in_thread(control, self._visitor, "abort", str(test_id), reason)
            tell(outcome, self._client)


def _notes(snapshot: Snapshot) -> str:
    """Return the strips below the bar: the store, alarms, running tests."""
    parts: list[str] = []
    age_s = time.monotonic() - snapshot.looked_s
    if snapshot.problem:
        parts.append(_strip("bad", "✖ Store", snapshot.problem))
    elif age_s > OLD_S:
        parts.append(_strip("bad", "✖ Page", f"nothing new from the store for {age_s:.0f} s"))
    for alarm in snapshot.alarms[-4:]:
        about = alarm.about
        mark = {"danger": ("bad", "✖"), "warning": ("warn", "▲"), "news": ("good", "✔")}
        colour, sign = mark[about.weight]
        text = f"{alarm.text} <i>{escape(about.remedy)}</i> <a href='/alarms'>Acknowledge</a>"
        parts.append(_strip(colour, f"{sign} {about.title}", text, safe=alarm.text))
    if len(snapshot.alarms) > 4:
        more = len(snapshot.alarms) - 4
        parts.append(_strip("warn", "▲ Alarms", f"{more} more are open: see the page Alarms"))
    return "".join(parts)


def _strip(colour: str, head: str, text: str, *, safe: str | None = None) -> str:
    """Return a coloured strip; `safe` is the part of `text` that is still to be escaped."""
    body = escape(text) if safe is None else text.replace(safe, escape(safe), 1)
    return (
        f"<div class='strip {colour}' style='margin-top:6px'><b>{escape(head)}</b> · {body}</div>"
    )


def figure(name: str, value: str = "–") -> Callable[[str], object]:
    """Make a named figure and return what sets its value."""
    with ui.element("div").classes("figure"):
        ui.label(name).classes("name")
        label = ui.label(value).classes("value")
    return label.set_text


def table(columns: list[str], rows: list[list[str]], *, numbers: tuple[int, ...] = ()) -> str:
    """Return a plain table; cells are HTML, columns in `numbers` stand on the right."""

    def cell(kind: str, k: int, text: str) -> str:
        return f"<{kind}{' class=n' if k in numbers else ''}>{text}</{kind}>"

    head = "".join(cell("th", k, escape(c)) for k, c in enumerate(columns))
    body = "".join(
        "<tr>" + "".join(cell("td", k, c) for k, c in enumerate(row)) + "</tr>" for row in rows
    )
    return (
        f"<div class=scroll tabindex=0><table class=plain><thead><tr>{head}</tr></thead>"
        f"<tbody>{body}</tbody></table></div>"
    )


def local_time(utc: str | None) -> str:
    """Return a moment of the store on this machine's clock, to the second."""
    if not utc:
        return "–"
    return f"{datetime.fromisoformat(utc).astimezone():%Y-%m-%d %H:%M:%S}"
