"""Files that the browser may have: results of jobs, a report as PDF, recorded runs of tests."""

import tempfile
from collections.abc import Callable
from pathlib import Path

from fastapi import FastAPI
from starlette.background import BackgroundTask
from starlette.concurrency import run_in_threadpool
from starlette.responses import FileResponse, PlainTextResponse, Response

from accelbench.panel.jobs import Jobs
from accelbench.shell.browser_print import print_pdf
from errormodel.errors import WorkbenchError
from thermo.store.files import export_recorded
from thermo.store.store import open_store

TABLES = ("csv", "parquet")
SHOWN = (".html", ".txt")  # opened in the browser; the others are saved


def add_downloads(app: FastAPI, jobs: Jobs, store: str) -> None:
    """Add the addresses of results and recorded runs; the guard asks for the log-in.

    Parameters
    ----------
    app : FastAPI
    jobs : Jobs
    store : str
        URL of the store.
    """

    async def result(job: str, name: str) -> Response:
        def find() -> Response:
            path = jobs.file(job, name)
            kind = "inline" if path.suffix in SHOWN else "attachment"
            return FileResponse(path, filename=name, content_disposition_type=kind)

        return await run_in_threadpool(_or_refusal, find)

    async def pdf(job: str) -> Response:
        def make() -> Response:
            content = print_pdf(jobs.file(job, "report.html").read_bytes())
            shown = {"content-disposition": f'inline; filename="{job}.pdf"'}
            return Response(content, media_type="application/pdf", headers=shown)

        return await run_in_threadpool(_or_refusal, make)

    async def recorded(test_id: str, suffix: str) -> Response:
        def export() -> Response:
            if suffix not in TABLES:
                raise WorkbenchError(f"{suffix}: expected {' or '.join(TABLES)}")
            with tempfile.NamedTemporaryFile(suffix=f".{suffix}", delete=False) as file:
                path = Path(file.name)
            with open_store(store, existing=True) as opened:
                made = [e.path for e in export_recorded(opened, test_id, path)]
            name = f"{test_id}.{suffix}"
            return FileResponse(made[0], filename=name, background=BackgroundTask(_forget, made))

        return await run_in_threadpool(_or_refusal, export)

    app.add_api_route("/result/{job}/report.pdf", pdf, include_in_schema=False)
    app.add_api_route("/result/{job}/{name}", result, include_in_schema=False)
    app.add_api_route("/recorded/{test_id}.{suffix}", recorded, include_in_schema=False)


def _or_refusal(make: Callable[[], Response]) -> Response:
    try:
        return make()
    except WorkbenchError as err:
        return PlainTextResponse(f"{err}\n", status_code=404)


def _forget(paths: list[Path]) -> None:
    for path in paths:
        for one in (path, path.with_suffix(".toml")):
            one.unlink(missing_ok=True)
