"""The page Plan: choose, upload or fill in a sequence, see what it does, put it into the queue."""

from datetime import UTC, datetime, timedelta
from html import escape

from nicegui import events, ui
from starlette.requests import Request

from accelbench.panel.access.sessions import Visitor
from accelbench.panel.access.users import may
from accelbench.panel.actions import Outcome
from accelbench.panel.charts import plan_chart
from accelbench.panel.context import PanelContext
from accelbench.panel.folders import MOST_BYTES
from accelbench.panel.form import FIELDS, sequence_text
from accelbench.panel.frame import figure, frame, local_time
from accelbench.panel.work import in_thread, tell
from accelbench.shell.foreseen_plan import foresee_plan, plan_text
from errormodel.errors import WorkbenchError
from thermo.planning.plan import Plan
from thermo.planning.text import duration_text

EMULATED = "emulated: no instruments"


def register(context: PanelContext) -> None:
    """Add the page."""

    @ui.page("/plan")
    def plan_page(request: Request) -> None:
        with frame(context, request, "Plan a test", "/plan") as visitor:
            _PlanPage(context, visitor)


class _PlanPage:
    """The elements of one open page."""

    def __init__(self, context: PanelContext, visitor: Visitor) -> None:
        self._context, self._visitor = context, visitor
        self._client = ui.context.client
        self._folder, self._actions = context.actions.sequences, context.actions
        ui.html("<h1>Plan a test</h1>", sanitize=False)
        with ui.element("div").classes("grid two"):
            with ui.element("div").classes("card"):
                self._choices()
            with ui.element("div").classes("card"):
                self._makers()
        self._result = ui.column().classes("w-full gap-3")

    # ---- what is chosen

    def _choices(self) -> None:
        ui.html("<h2>1 · Sequence and station</h2>", sanitize=False)
        names = self._folder.names()
        self._sequence = ui.select(names, label="Sequence", value=names[0] if names else None)
        stations = [EMULATED, *self._actions.stations.names()]
        self._station = ui.select(stations, label="Station", value=EMULATED)
        self._speed = ui.input(
            "Time multiple (emulated only; empty: as fast as can be)", value="60"
        )
        self._after = ui.input("Start by itself after the good end of planned test (number)")
        for one in (self._sequence, self._station, self._speed, self._after):
            one.classes("w-full").props("dense")
        with ui.row():
            ui.button("Show the plan", on_click=self._show).props("unelevated")
            if may(self._visitor.role, "operate"):
                self._put = ui.button("Put into the queue", on_click=self._queue)
                self._put.props("unelevated color=positive")

    def _makers(self) -> None:
        if not may(self._visitor.role, "operate"):
            ui.label("Making files needs the role operate.").classes("note")
            return
        ui.html("<h2>or make a sequence</h2>", sanitize=False)
        with ui.expansion("Fill in a form").classes("w-full"):
            self._inputs: dict[str, ui.input] = {}
            with ui.element("div").classes("grid two"):
                for field in FIELDS:
                    one = ui.input(field.label, value=field.start).classes("w-full")
                    one.props(f'dense hint="{escape(field.meaning)}"')
                    self._inputs[field.key] = one
            self._name = ui.input("Keep as file", value="my-test.toml").classes("w-64")
            ui.button("Make the file", on_click=self._make).props("unelevated")
        with ui.expansion("Upload a file").classes("w-full"):
            ui.label("A sequence, TOML, 1 MB at the most; it is read as data only.").classes("note")
            ui.upload(
                label="Sequence .toml",
                auto_upload=True,
                max_file_size=MOST_BYTES,
                on_upload=self._uploaded,
                on_rejected=lambda: ui.notify("larger than 1 MB", type="negative"),
            ).props("accept=.toml flat bordered").classes("w-full")

    # ---- what is made

    async def _make(self) -> None:
        try:
            text = sequence_text({key: str(one.value or "") for key, one in self._inputs.items()})
        except WorkbenchError as err:
            tell(Outcome(done=False, said=str(err)), self._client)
            return
        await self._keep(str(self._name.value or ""), text)

    async def _uploaded(self, event: events.UploadEventArguments) -> None:
        try:
            text = (await event.file.read()).decode("utf-8")
        except UnicodeDecodeError:
            tell(Outcome(done=False, said=f"{event.file.name}: not UTF-8 text"), self._client)
            return
        await self._keep(event.file.name, text)

    async def _keep(self, name: str, text: str) -> None:
        outcome = await in_thread(self._actions.save_sequence, self._visitor, name, text)
        tell(outcome, self._client)
        if outcome.done:
            self._sequence.set_options(self._folder.names(), value=name)
            await self._show()

    # ---- what is shown and planned

    def _chosen(self) -> tuple[str, str | None]:
        station = str(self._station.value)
        return str(self._sequence.value or ""), None if station == EMULATED else station

    async def _show(self) -> None:
        self._result.clear()
        try:
            job = await in_thread(self._actions.job, *self._chosen())
        except WorkbenchError as err:
            with self._result:
                ui.html(
                    f"<div class='strip bad'><b>✖ No plan</b> · {escape(str(err))}</div>",
                    sanitize=False,
                )
            return
        with self._result:
            self._picture(job.plan)
            with ui.element("div").classes("card"):
                ui.html("<h2>What it will show, and what it cannot</h2>", sanitize=False)
                text = ui.html("<div class=note>foreseeing the test …</div>", sanitize=False)
                text.classes("w-full")
        foreseen = await in_thread(foresee_plan, job.plan)
        lines = "\n".join(plan_text(job.plan, foreseen))
        text.set_content(f"<pre class=file tabindex=0>{escape(lines)}</pre>")

    def _picture(self, plan: Plan) -> None:
        with ui.element("div").classes("card"):
            with ui.element("div").classes("figures"):
                low, high = plan.chamber_limits_c
                one, other = plan.accelerometer_limits_c
                figure("duration", duration_text(plan.total_s))
                figure("real instruments, started now, end", _end(plan))
                figure("runs", str(plan.runs))
                figure("readings", str(plan.readings))
                figure("chamber limits", f"{low:g} to {high:g} °C")
                figure("accelerometer limits", f"{one:g} to {other:g} °C")
            run = plan.run(1)
            step = max(1, run.time_s.size // 1500)
            hours = [leg.start_s / 3600 for leg in plan.legs] + [plan.legs[-1].end_s / 3600]
            temps = [leg.start_c for leg in plan.legs] + [plan.legs[-1].end_c]
            angles = [
                [float(t) / 3600, float(a)]
                for t, a in zip(run.time_s[::step], run.position_deg[::step], strict=True)
            ]
            ui.echart(plan_chart(hours, temps, angles)).classes("w-full").style("height:380px")
            ui.label("The first run; time from its first reading.").classes("note")
        sequence, _ = self._chosen()
        with ui.expansion(f"The file {sequence}").classes("w-full card"):
            text = self._folder.file(sequence).read_text(encoding="utf-8")
            ui.html(f"<pre class=file tabindex=0>{escape(text)}</pre>", sanitize=False)

    async def _queue(self) -> None:
        sequence, station = self._chosen()
        try:
            speed = _optional(str(self._speed.value or ""), "Time multiple")
            after = _optional(str(self._after.value or ""), "planned test")
        except ValueError as err:
            tell(Outcome(done=False, said=str(err)), self._client)
            return
        outcome = await in_thread(
            self._actions.plan,
            self._visitor,
            sequence,
            station,
            speed,
            None if after is None else int(after),
        )
        tell(outcome, self._client)
        if outcome.done:
            ui.navigate.to("/queue")


def _optional(text: str, label: str) -> float | None:
    """Return a number above 0; None for an empty field."""
    if not text.strip():
        return None
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < float("inf"):
        raise ValueError(f"{label}: {text!r}, expected a number above 0 or nothing")
    return value


def _end(plan: Plan) -> str:
    return local_time((datetime.now(UTC) + timedelta(seconds=plan.total_s)).isoformat())
