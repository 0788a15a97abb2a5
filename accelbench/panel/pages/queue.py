"""The page Queue: arm planned tests, start them, take them out; who works on the queue."""

from functools import partial
from html import escape

from nicegui import ui
from starlette.requests import Request

from accelbench.panel.access.sessions import Visitor
from accelbench.panel.access.users import may
from accelbench.panel.context import PanelContext
from accelbench.panel.frame import frame, local_time, table
from accelbench.panel.work import in_thread, tell
from thermo.launch.arming import Check
from thermo.store.operation.commands import Command
from thermo.store.operation.planned import BEFORE_START, PlannedTest

SHOWN = 40
COLOUR = {
    "planned": "", "armed": "good", "starting": "good", "running": "good", "finished": "good",
    "interrupted": "warn", "refused": "warn", "failed": "bad", "withdrawn": "",
}  # fmt: skip


def register(context: PanelContext) -> None:
    """Add the page."""

    @ui.page("/queue")
    def queue_page(request: Request) -> None:
        with frame(context, request, "Queue", "/queue") as visitor:
            _QueuePage(context, visitor)


class _QueuePage:
    """The elements of one open page."""

    def __init__(self, context: PanelContext, visitor: Visitor) -> None:
        self._context, self._visitor = context, visitor
        self._client = ui.context.client
        self._seen: object = None
        ui.html("<h1>Queue</h1>", sanitize=False)
        self._runner = ui.html("", sanitize=False).classes("w-full")
        self._cards = ui.column().classes("w-full gap-3")
        with ui.element("div").classes("card"):
            ui.html("<h2>Over</h2>", sanitize=False)
            self._over = ui.html("", sanitize=False).classes("w-full")
        with ui.element("div").classes("card"):
            ui.html("<h2>Commands: who asked for what</h2>", sanitize=False)
            self._commands = ui.html("", sanitize=False).classes("w-full")
        self._checks: dict[int, tuple[Check, ...]] = {}
        ui.timer(0.5, self._tick)
        self._tick()

    def _tick(self) -> None:
        snapshot = self._context.watch.snapshot
        now = (snapshot.planned, snapshot.commands, snapshot.runner, tuple(self._checks))
        if now == self._seen:
            return
        self._seen = now
        if not snapshot.runner:
            self._runner.set_content(
                "<div class='strip warn'><b>▲ Nobody works on the queue</b> · the page starts it "
                "within seconds; from a terminal: accelbench control serve</div>"
            )
        else:
            self._runner.set_content(
                "<div class=note>A test starts by hand, or by itself after the good end of the one "
                "before it. After a failed or aborted one nothing starts by itself.</div>"
            )
        self._show_open(
            tuple(p for p in snapshot.planned if p.state in (*BEFORE_START, "starting", "running"))
        )
        self._over.set_content(_over(snapshot.planned))
        self._commands.set_content(_commands(snapshot.commands))

    def _show_open(self, planned: tuple[PlannedTest, ...]) -> None:
        self._cards.clear()
        with self._cards:
            if not planned:
                ui.html(
                    "<div class=card>The queue is empty. <a href='/plan'>Plan a test</a>.</div>",
                    sanitize=False,
                )
            for one in planned:
                self._card(one)

    def _card(self, one: PlannedTest) -> None:
        station = "emulated" if one.station_json is None else "with a station file"
        speed = "" if one.speed is None else f", {one.speed:g} times real time"
        after = "" if one.after_id is None else f", after {one.after_id} has ended well"
        with ui.element("div").classes("card").props(f"data-planned={one.number}"):
            ui.html(
                f"<h2>{one.number} · {escape(one.name)} "
                f"<span class='{COLOUR[one.state]}'>{one.state}</span></h2>"
                f"<div class=note>{station}{speed}{after}; planned by {escape(one.planned_by)}, "
                f"{local_time(one.planned_utc)}</div>",
                sanitize=False,
            )
            if one.outcome:
                ui.html(f"<div class='strip warn'>{escape(one.outcome)}</div>", sanitize=False)
            if one.number in self._checks:
                ui.html(_checks(self._checks[one.number]), sanitize=False).classes("w-full")
            with ui.row():
                self._buttons(one)

    def _buttons(self, one: PlannedTest) -> None:
        if one.test_id is not None:
            ui.link("Show the test", f"/test/{one.test_id}")
        if not may(self._visitor.role, "operate") or one.state not in BEFORE_START:
            return
        if one.state == "armed":
            start = ui.button("Start", on_click=partial(self._start, one.number))
            start.props("unelevated color=positive icon=play_arrow")
            ui.button("Check again", on_click=partial(self._arm, one.number), color=None).props(
                "flat"
            )
        else:
            arm = ui.button("Check and arm", on_click=partial(self._arm, one.number))
            arm.props("unelevated")
        ui.button("Take out", on_click=partial(self._withdraw, one.number), color=None).props(
            "flat"
        )

    # ---- actions

    async def _arm(self, number: int) -> None:
        ui.notify("Looking at instruments, disk, store and limits; nothing is commanded …")
        checks, outcome = await in_thread(self._context.actions.arm, self._visitor, number)
        self._checks[number] = checks
        self._seen = None
        tell(outcome, self._client)

    async def _start(self, number: int) -> None:
        ui.notify("Starting …")
        outcome = await in_thread(self._context.actions.start, self._visitor, number)
        tell(outcome, self._client)
        if outcome.done:
            with self._client:
                ui.navigate.to(f"/test/{outcome.said.rpartition(' ')[2]}")

    async def _withdraw(self, number: int) -> None:
        tell(await in_thread(self._context.actions.withdraw, self._visitor, number), self._client)


def _checks(checks: tuple[Check, ...]) -> str:
    rows = [
        [
            f"<b class={'good' if c.passed else 'bad'}>{'✔' if c.passed else '✖'} "
            f"{escape(c.name)}</b>",
            escape(c.found),
            escape(c.remedy),
        ]
        for c in checks
    ]
    return table(["check", "found", "what to do"], rows)


def _over(planned: tuple[PlannedTest, ...]) -> str:
    rows = [
        [
            str(p.number),
            escape(p.name),
            f"<span class='{COLOUR[p.state]}'>{p.state}</span>",
            f"<a href='/test/{escape(p.test_id)}'>{escape(p.test_id)}</a>" if p.test_id else "–",
            local_time(p.changed_utc),
            escape(p.outcome),
        ]
        for p in reversed(planned)
        if p.state not in (*BEFORE_START, "starting", "running")
    ]
    if not rows:
        return "<div class=note>none yet</div>"
    columns = ["number", "name", "state", "test", "since", "why"]
    return table(columns, rows[:SHOWN], numbers=(0,))


def _planned(command: Command) -> str:
    number = command.arguments.get("planned")
    return f"planned {number:.0f}" if isinstance(number, float) else "–"


def _commands(commands: tuple[Command, ...]) -> str:
    rows = [
        [
            local_time(c.asked_utc),
            escape(c.who),
            escape(c.action.replace("_", " ")),
            escape(c.test_id or _planned(c)),
            escape(c.state),
            escape(str(c.arguments.get("reason", ""))),
            escape(c.outcome),
        ]
        for c in reversed(commands)
    ]
    if not rows:
        return "<div class=note>none yet</div>"
    return table(["asked", "who", "what", "of", "state", "reason", "what came of it"], rows)
