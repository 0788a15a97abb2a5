"""The page Tests: what runs now, and every test of the store, searched."""

from html import escape

from nicegui import ui
from starlette.requests import Request

from accelbench.panel.context import PanelContext
from accelbench.panel.frame import frame, local_time, table
from accelbench.panel.watch import Snapshot
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
        with frame(context, request, "Tests", "/"):
            running = ui.html("", sanitize=False).classes("w-full")
            with ui.element("div").classes("card"):
                ui.html("<h2>All tests</h2>", sanitize=False)
                with ui.row().classes("items-end"):
                    words = ui.input("Search name, id, outcome").classes("w-64")
                    status = ui.select(["any", *STATUS], value="any", label="Status")
                found = ui.html("", sanitize=False).classes("w-full")
            shown: list[object] = []

            def refresh() -> None:
                snapshot = context.watch.snapshot
                running.set_content(_running(snapshot))
                now = [snapshot.tests, words.value, status.value]
                if now != shown:
                    shown[:] = now
                    found.set_content(
                        _tests(snapshot.tests, str(words.value or ""), str(status.value))
                    )

            ui.timer(0.5, refresh)
            refresh()


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


def _tests(tests: tuple[TestSummary, ...], words: str, status: str) -> str:
    wanted = words.lower().split()
    rows = [
        [
            f"<a href='/test/{escape(t.id)}'>{escape(t.id)}</a>",
            escape(t.name),
            f"<span class='{STATUS[t.status][0]}'>{STATUS[t.status][1]}</span>",
            local_time(t.created_utc),
            str(t.runs),
            f"{t.readings:,}".replace(",", "\u2009"),
            escape(t.outcome),
        ]
        for t in reversed(tests)
        if status in ("any", t.status)
        and all(w in f"{t.id} {t.name} {t.outcome}".lower() for w in wanted)
    ]
    if not rows:
        return "<div class=note>no test</div>"
    more = f"<div class=note>{len(rows) - SHOWN} older ones are not shown</div>"
    columns = ["test", "name", "status", "begun", "runs", "readings", "how it ended"]
    shown = table(columns, rows[:SHOWN], numbers=(4, 5))
    return shown + (more if len(rows) > SHOWN else "")
