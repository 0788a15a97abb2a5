"""The page of one test: pictures, figures, estimates, health, events; pause, resume, abort."""

from html import escape
from typing import Any

from nicegui import ui
from starlette.requests import Request

from accelbench.panel.access.sessions import Visitor
from accelbench.panel.access.users import may
from accelbench.panel.charts import output_chart, rate_chart, temperature_chart
from accelbench.panel.context import PanelContext
from accelbench.panel.followed import FollowedTest
from accelbench.panel.frame import figure, frame, local_time, table
from accelbench.panel.pages.tests import STATUS, temperature
from accelbench.panel.work import in_thread, tell
from thermo.planning.text import duration_text
from thermo.station.observers.live import LiveValue
from thermo.store.operation.commands import Action
from thermo.store.operation.controllers import ControllerBeat
from thermo.store.records import EventRecord

TICK_S = 0.25
PICTURE_TICKS = 4  # pictures are drawn anew every second


def register(context: PanelContext) -> None:
    """Add the page."""

    @ui.page("/test/{test_id}")
    def live_page(request: Request, test_id: str) -> None:
        with frame(context, request, f"Test {test_id}", "") as visitor:
            _LivePage(context, visitor, test_id)


class _LivePage:
    """The elements of one open page, and their renewal."""

    def __init__(self, context: PanelContext, visitor: Visitor, test_id: str) -> None:
        self._context, self._visitor, self._test_id = context, visitor, test_id
        self._client = ui.context.client
        self._seen: tuple[object, ...] = ()
        self._ticks = 0
        self._charts: dict[str, ui.echart] = {}
        self._head = ui.html("", sanitize=False).classes("w-full")
        self._buttons = ui.row().classes("items-end")
        self._make_buttons()
        with ui.element("div").classes("grid live"):
            with ui.column().classes("w-full gap-3"):
                self._pictures = ui.element("div").classes("card")
                with ui.element("div").classes("card"):
                    self._estimates = ui.html("", sanitize=False).classes("w-full")
                with ui.element("div").classes("card"):
                    ui.html("<h2>Events</h2>", sanitize=False)
                    self._events = ui.html("", sanitize=False).classes("events")
                    self._events.props("tabindex=0 role=region aria-label=Events")
            with ui.column().classes("w-full gap-3"):
                self._figures = self._make_figures()
                with ui.element("div").classes("card"):
                    ui.html("<h2>Instruments</h2>", sanitize=False)
                    self._health = ui.html("", sanitize=False).classes("w-full")
        ui.timer(TICK_S, self._tick)
        self._tick()

    # ---- made once

    def _make_buttons(self) -> None:
        if not may(self._visitor.role, "operate"):
            return
        with self._buttons:
            self._reason = ui.input("Reason (kept with the test)").classes("w-72").props("dense")
            self._pause = ui.button("Pause", on_click=lambda: self._ask("pause"))
            self._go_on = ui.button("Resume", on_click=lambda: self._ask("resume"))
            self._again = ui.button("Go on with this test", on_click=self._resume_test)
            for one in (self._pause, self._go_on, self._again):
                one.props("unelevated dense")

    def _make_figures(self) -> dict[str, Any]:
        names = (
            "phase", "run", "slot", "chamber", "set point", "head", "time left", "expected end",
            "readings", "lateness of a scan", "time multiple",
        )  # fmt: skip
        with ui.element("div").classes("card"):
            ui.html("<h2>Now</h2>", sanitize=False)
            with ui.element("div").classes("figures"):
                return {name: figure(name) for name in names}

    def _make_charts(self, test: FollowedTest) -> None:
        with self._pictures:
            for name, options, height in (
                ("temperature", temperature_chart(test), "330px"),
                ("rate", rate_chart(test), "190px"),
                ("output", output_chart(test), "260px"),
            ):
                chart = ui.echart(options).classes("w-full").style(f"height:{height}")
                self._charts[name] = chart
            self._drawn = ui.label("").classes("note")

    # ---- renewed

    def _tick(self) -> None:
        snapshot = self._context.watch.snapshot
        test = self._context.watch.follow(self._test_id)
        if not isinstance(test, FollowedTest):
            self._head.set_content(f"<h1>{escape(test or 'reading the test …')}</h1>")
            return
        beat, alive = snapshot.beat(self._test_id)
        self._head.set_content(_head(test, beat, alive=alive))
        self._enable(test, beat, alive=alive)
        if beat is not None:
            for name, value in _now(beat, test).items():
                self._figures[name](value)
            self._health.set_content(_health(beat, alive=alive))
        if not self._charts:
            self._make_charts(test)
        self._ticks += 1
        if self._seen != (test.version,) and self._ticks % PICTURE_TICKS == 0:
            self._seen = (test.version,)
            self._draw(test)

    def _draw(self, test: FollowedTest) -> None:
        for name, make in (
            ("temperature", temperature_chart),
            ("rate", rate_chart),
            ("output", output_chart),
        ):
            series = make(test)["series"]
            self._charts[name].run_chart_method("setOption", {"series": series}, timeout=10)
            # what a page that connects anew is given
            self._charts[name].options["series"] = series
        every = f"every {test.stride}th scan is drawn; " if test.stride > 1 else ""
        self._drawn.set_text(f"{every}time is the programme's, with approaches and rests")
        self._estimates.set_content(_estimates(test.estimates(), test))
        self._events.set_content(_events(tuple(test.events)))

    def _enable(self, test: FollowedTest, beat: ControllerBeat | None, *, alive: bool) -> None:
        if not may(self._visitor.role, "operate"):
            return
        runs = alive and beat is not None and beat.state == "running"
        paused = runs and beat is not None and beat.phase == "pause"
        self._pause.set_visibility(runs and not paused)
        self._go_on.set_visibility(paused)
        self._again.set_visibility(not runs and test.record.status == "interrupted")
        self._reason.set_visibility(runs)

    # ---- actions

    async def _ask(self, action: Action) -> None:
        actions = self._context.actions
        reason = str(self._reason.value or "")
        outcome = await in_thread(actions.control, self._visitor, action, self._test_id, reason)
        tell(outcome, self._client)

    async def _resume_test(self) -> None:
        test = self._context.watch.follow(self._test_id)
        if not isinstance(test, FollowedTest):
            return
        rule = test.plan.sequence.after_gap
        what = (
            f"The interrupted segment is repeated after {rule.resoak_min:g} min at its start."
            if rule.gap_rule == "resoak"
            else f"It goes on where it was; after more than {rule.max_gap_s:g} s the segment is "
            f"repeated after {rule.resoak_min:g} min at its start."
        )
        with ui.dialog() as dialog, ui.card().classes("card"):
            ui.html("<h2>Go on with this test?</h2>", sanitize=False)
            ui.label(what)
            with ui.row():
                ui.button("Go on", on_click=lambda: dialog.submit(True))
                ui.button("Leave it", on_click=lambda: dialog.submit(False), color=None).props(
                    "flat"
                )
        if await dialog:
            ui.notify("Starting …")
            outcome = await in_thread(
                self._context.actions.resume_test, self._visitor, self._test_id
            )
            tell(outcome, self._client)
        dialog.delete()


def _head(test: FollowedTest, beat: ControllerBeat | None, *, alive: bool) -> str:
    record = test.record
    colour, text = STATUS[record.status]
    if record.status == "running" and beat is not None and not alive:
        colour, text = "bad", "✖ its controller is gone; the guardian makes the chamber safe"
    elif beat is not None and beat.is_silent and alive:
        colour, text = "bad", f"✖ its controller has not been heard for {beat.age_s:.0f} s"
    outcome = f" · {escape(record.outcome)}" if record.outcome else ""
    return (
        f"<h1>{escape(record.name)} <span class=note>{escape(record.id)}</span></h1>"
        f"<div class='strip {colour}' style='margin-top:6px'><b>{text}</b>{outcome}</div>"
    )


def _now(beat: ControllerBeat, test: FollowedTest) -> dict[str, str]:
    late, most = beat.lateness_s, beat.max_lateness_s
    return {
        "phase": beat.phase if beat.state == "running" else "ended",
        "run": f"{beat.run} of {beat.runs}",
        "slot": f"{beat.slot} of {beat.slots}",
        "chamber": temperature(beat.chamber_c),
        "set point": temperature(beat.commanded_c),
        "head": "–" if beat.position_deg is None else f"{beat.position_deg:.1f}°",
        "time left": duration_text(beat.left_s) if beat.state == "running" else "–",
        "expected end": local_time(beat.end_utc) if beat.state == "running" else "–",
        "readings": f"{test.readings} ({test.flagged} flagged)",
        "lateness of a scan": "–" if late is None else f"{late:.3f} s (most {most or 0.0:.3f} s)",
        "time multiple": "as fast as can be" if beat.speed is None else f"{beat.speed:g}",
    }


def _health(beat: ControllerBeat, *, alive: bool) -> str:
    rows = [
        ("controller", f"process {beat.pid} on {beat.host}" + ("" if alive else ", gone")),
        ("heard", f"{local_time(beat.beat_utc)}"),
        ("links", beat.link or "–"),
        ("guardian", beat.guardian or "–"),
        ("store", beat.store or "–"),
        ("last fault", beat.last_fault or "none"),
    ]
    return table(["", ""], [[f"<b>{name}</b>", escape(text)] for name, text in rows])


def _estimates(values: tuple[LiveValue, ...], test: FollowedTest) -> str:
    t_ref_c = values[0].t_ref_c if values else 25.0
    columns = [
        "accelerometer",
        "now, °C",
        f"K0 at {t_ref_c:g} °C, µg",
        f"K1 at {t_ref_c:g} °C, of nominal",
        "K0 now, µg",
        "readings",
    ]
    rows = [
        [
            escape(v.serial),
            f"{v.temp_c:.2f}",
            f"{v.k0_ref_ug:.1f} ± {v.k0_ref_sigma_ug:.1f}",
            f"{v.k1_ref:.7f} ± {v.k1_ref_sigma_ppm:.1f} ppm",
            f"{v.k0_ug:.1f} ± {v.k0_sigma_ug:.1f}",
            str(v.n),
        ]
        for v in values
    ]
    note = (
        "<div class=note>Live, at the reference temperature: 1 sigma of the scatter, without the "
        "instruments' own errors; extrapolated until that temperature has been passed.</div>"
    )
    head = f"<h2>K0 and K1 of {len(test.serials)} accelerometer(s)</h2>"
    return head + table(columns, rows, numbers=(1, 2, 3, 4, 5)) + note


def _events(events: tuple[EventRecord, ...]) -> str:
    rows = [
        [
            local_time(e.logged_utc),
            "" if e.run is None else str(e.run),
            "" if e.time_s is None else f"{e.time_s / 60:.1f}",
            escape(e.kind),
            escape(e.text),
        ]
        for e in reversed(events)
    ]
    return table(["logged", "run", "min", "kind", "what"], rows, numbers=(1, 2))
