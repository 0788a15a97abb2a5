"""The page Results: what was made of stored tests, and the life of one accelerometer."""

from html import escape
from typing import Any

from nicegui import ui
from starlette.requests import Request

from accelbench.panel.charts import life_chart
from accelbench.panel.context import PanelContext
from accelbench.panel.frame import frame, local_time, table
from accelbench.panel.jobs import KINDS, JobState
from accelbench.panel.work import in_thread

SHOWN = 100
LOOK_S = 1.0


def register(context: PanelContext) -> None:
    """Add the page."""

    @ui.page("/results")
    def results_page(request: Request) -> None:
        with frame(context, request, "Results", "/results"):
            _ResultsPage(context)


class _ResultsPage:
    """The elements of one open page."""

    def __init__(self, context: PanelContext) -> None:
        self._jobs = context.actions.jobs
        self._seen: object = None
        self._models: list[tuple[JobState, dict[str, Any]]] = []
        ui.html("<h1>Results</h1>", sanitize=False)
        with ui.element("div").classes("card"):
            ui.label("Tick tests on the page Tests and choose what to do with them.").classes(
                "note"
            )
            self._table = ui.html("", sanitize=False).classes("w-full")
        with ui.element("div").classes("card"):
            ui.html("<h2>The life of one accelerometer</h2>", sanitize=False)
            self._serial = ui.select([], label="Serial number", on_change=self._draw)
            self._serial.classes("w-64").props("dense")
            self._life = ui.column().classes("w-full gap-3")
        ui.timer(LOOK_S, self._look)

    async def _look(self) -> None:
        jobs = await in_thread(self._jobs.states)
        if jobs == self._seen:
            return
        self._seen = jobs
        self._table.set_content(_jobs(jobs))
        self._models = await in_thread(self._jobs.models)
        serials = sorted({str(one["serial"]) for _, one in self._models})
        chosen = self._serial.value if self._serial.value in serials else None
        self._serial.set_options(serials, value=chosen or (serials[0] if serials else None))
        self._draw()

    def _draw(self) -> None:
        serial = self._serial.value
        of = [(job, one) for job, one in reversed(self._models) if one["serial"] == serial]
        self._life.clear()
        with self._life:
            if not of:
                ui.label("No fit of a stored test yet.").classes("note")
                return
            for name, unit in (("k0", "µg"), ("k1", str(of[0][1]["output_unit"]) + "/g")):
                points = [
                    (job.tests[0][:15], c["value"], c["sigma"])
                    for job, one in of
                    if (c := one["coefficients"].get(name)) is not None
                ]
                title = f"{name.upper()} of {serial} at {of[0][1]['t_ref_c']:g} °C, 1 sigma"
                chart = ui.echart(life_chart(title, unit, points))
                chart.classes("w-full").style("height:230px")
            rows = [
                [
                    escape(job.tests[0]),
                    _told(one, "k0"),
                    _told(one, "k1"),
                    f"{one['residual_ug']:.3g}",
                    _link(job, "report.html"),
                ]
                for job, one in of
            ]
            columns = ["first test", "K0", "K1", "residual, µg", "report"]
            ui.html(table(columns, rows, numbers=(3,)), sanitize=False).classes("w-full")


def _told(model: dict[str, Any], name: str) -> str:
    found = model["coefficients"].get(name)
    if found is None:
        return "–"
    return escape(f"{found['value']:.8g} ± {found['sigma']:.2g} {found['unit']}")


def _link(job: JobState, name: str) -> str:
    return f"<a href='/result/{job.name}/{escape(name)}' target=_blank>{escape(name)}</a>"


def _jobs(jobs: tuple[JobState, ...]) -> str:
    rows = [
        [
            local_time(job.asked_utc),
            escape(job.who),
            KINDS[job.kind][0],
            ", ".join(f"<a href='/test/{escape(t)}'>{escape(t)}</a>" for t in job.tests),
            _state(job),
            " · ".join(_link(job, name) for name in _names(job)),
        ]
        for job in jobs[:SHOWN]
    ]
    if not rows:
        return "<div class=note>none yet</div>"
    return table(["asked", "who", "what", "tests", "state", "files"], rows)


def _names(job: JobState) -> tuple[str, ...]:
    """Return the files to be had; a report can be had as PDF, too."""
    pdf = ("report.pdf",) if "report.html" in job.files else ()
    return (*job.files[:1], *pdf, *job.files[1:])


def _state(job: JobState) -> str:
    if job.running:
        return f"<span class=good>▶ running</span> {escape(job.last)}"
    if job.code == 0:
        return "<span class=good>✔ done</span>"
    if job.code == 1:
        return "<span class=warn>▲ done; a criterion failed, see the report</span>"
    why = job.last if job.code is not None else "its process is gone"
    return f"<span class=bad>✖ not done</span> {escape(why)}"
