"""The page Tests: what runs now, and every test of the store, searched."""

from functools import partial
from html import escape
from typing import cast

from nicegui import ui
from starlette.requests import Request

from accelbench.panel.access.sessions import Visitor
from accelbench.panel.access.users import may
from accelbench.panel.context import PanelContext
from accelbench.panel.frame import frame, local_time, table
from accelbench.panel.jobs import KINDS
from accelbench.panel.watch import Snapshot
from accelbench.panel.work import in_thread, tell
from thermo.planning.text import duration_text
from thermo.store.operation.controllers import ControllerBeat
from thermo.store.records import TestSummary

SHOWN = 200
STATUS = {
    "running": ("good", "▶ running"),
    "finished": ("good", "✔ finished"),
    "interrupted": ("warn", "▲ interrupted"),
    "failed": ("bad", "✖ failed"),
}


def register(context: PanelContext) -> None:
    """Add the page."""

    @ui.page("/")
    def tests_page(request: Request) -> None:
        with frame(context, request, "Tests", "/") as visitor:
            _TestsPage(context, visitor)


class _TestsPage:
    """The elements of one open page."""

    def __init__(self, context: PanelContext, visitor: Visitor) -> None:
        self._context, self._visitor = context, visitor
        self._client = ui.context.client
        self._shown: tuple[object, ...] = ()
        self._running = ui.html("", sanitize=False).classes("w-full")
        if may(visitor.role, "operate"):
            with ui.element("div").classes("card"):
                self._make_evaluation()
        with ui.element("div").classes("card"):
            ui.html("<h2>All tests</h2>", sanitize=False)
            with ui.row().classes("items-end"):
                self._words = ui.input("Search serial, name, person, date, outcome")
                self._words.classes("w-80")
                self._status = ui.select(["any", *STATUS], value="any", label="Status").classes(
                    "w-40"
                )
            self._found = ui.html("", sanitize=False).classes("w-full")
        ui.timer(0.5, self._refresh)
        self._refresh()

    def _make_evaluation(self) -> None:
        ui.html("<h2>Evaluate tests</h2>", sanitize=False)
        self._ticked = ui.select([], label="Tick tests", multiple=True, value=[])
        self._ticked.classes("w-full").props("dense use-chips")
        with ui.row():
            for kind, (title, _, _) in KINDS.items():
                button = ui.button(title, on_click=partial(self._evaluate, kind))
                button.props("unelevated dense")
            ui.link("Results", "/results")

    async def _evaluate(self, kind: str) -> None:
        tests = tuple(cast(list[str], self._ticked.value or []))
        actions = self._context.actions
        outcome = await in_thread(actions.evaluate, self._visitor, kind, tests)
        tell(outcome, self._client)
        if outcome.done:
            with self._client:
                ui.navigate.to("/results")

    def _refresh(self) -> None:
        snapshot = self._context.watch.snapshot
        self._running.set_content(_running(snapshot))
        now = (snapshot.tests, snapshot.serials, self._words.value, self._status.value)
        if now == self._shown:
            return
        self._shown = now
        words, status = str(self._words.value or ""), str(self._status.value)
        self._found.set_content(_tests(snapshot, words, status))
        if may(self._visitor.role, "operate"):
            with_readings = [t for t in reversed(snapshot.tests) if t.readings]
            options = {
                t.id: f"{t.id} {t.name} {snapshot.serials.get(t.id, '')}" for t in with_readings
            }
            ticked = cast(list[str], self._ticked.value or [])
            kept = [t for t in ticked if t in options]
            self._ticked.set_options(options, value=kept)


def _running(snapshot: Snapshot) -> str:
    if not snapshot.running:
        text = "No test runs. <a href='/plan'>Plan one</a>, or start one from the "
        return f"<div class=card>{text}<a href='/queue'>queue</a>.</div>"
    return "<div class='grid two'>" + "".join(_card(b) for b in snapshot.running) + "</div>"


def _card(beat: ControllerBeat) -> str:
    fields = [
        ("phase", beat.phase),
        ("run", f"{beat.run} of {beat.runs}"),
        ("chamber", temperature(beat.chamber_c)),
        ("set point", temperature(beat.commanded_c)),
        ("time left", duration_text(beat.left_s)),
        ("end", "not known" if beat.end_utc is None else local_time(beat.end_utc)),
    ]
    figures = "".join(
        f"<div class=figure><div class=name>{name}</div><div class=value>{escape(value)}</div>"
        "</div>"
        for name, value in fields
    )
    link = f"<a href='/test/{escape(beat.test_id)}'>{escape(beat.test_id)}</a>"
    return f"<div class=card><h2>▶ {link}</h2><div class=figures>{figures}</div></div>"


def temperature(value: float | None) -> str:
    """Return a temperature with its unit."""
    return "–" if value is None else f"{value:.2f} °C"


def _tests(snapshot: Snapshot, words: str, status: str) -> str:
    wanted = words.lower().split()
    people = {p.test_id: p.planned_by for p in snapshot.planned if p.test_id}

    def text(test: TestSummary) -> str:
        known = (test.id, test.name, test.outcome, local_time(test.created_utc))
        found = (*known, snapshot.serials.get(test.id, ""), people.get(test.id, ""))
        return " ".join(found).lower()

    rows = [
        [
            f"<a href='/test/{escape(t.id)}'>{escape(t.id)}</a>",
            escape(t.name),
            escape(snapshot.serials.get(t.id, "")),
            escape(people.get(t.id, "")),
            f"<span class='{STATUS[t.status][0]}'>{STATUS[t.status][1]}</span>",
            local_time(t.created_utc),
            str(t.runs),
            f"{t.readings:,}".replace(",", "\u2009"),
            escape(t.outcome),
            _downloads(t) if t.readings else "",
        ]
        for t in reversed(snapshot.tests)
        if status in ("any", t.status) and all(w in text(t) for w in wanted)
    ]
    if not rows:
        return "<div class=note>no test</div>"
    more = f"<div class=note>{len(rows) - SHOWN} older ones are not shown</div>"
    columns = [
        "test", "name", "serials", "planned by", "status", "begun", "runs", "readings",
        "how it ended", "readings as",
    ]  # fmt: skip
    shown = table(columns, rows[:SHOWN], numbers=(6, 7))
    return shown + (more if len(rows) > SHOWN else "")


def _downloads(test: TestSummary) -> str:
    name = escape(test.id)
    kinds = ("csv", "parquet")
    return " · ".join(f"<a href='/recorded/{name}.{kind}' download>{kind}</a>" for kind in kinds)
