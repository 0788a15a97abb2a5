"""The page as a server."""

import logging
import signal
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress

import uvicorn
from fastapi import FastAPI
from nicegui import ui

from accelbench.panel.access.guard import Guard
from accelbench.panel.access.login import add_login
from accelbench.panel.access.sessions import Sessions, Visitor
from accelbench.panel.access.users import read_users
from accelbench.panel.actions import Actions
from accelbench.panel.context import PanelContext
from accelbench.panel.downloads import add_downloads
from accelbench.panel.pages import alarms, history, live, plan, queue, results, tests
from accelbench.panel.runner_process import RunnerProcess
from accelbench.panel.settings import LOOPBACK, PanelSettings
from accelbench.panel.watch import StoreWatch
from errormodel.errors import InputError
from thermo.store.store import open_store

PAGES = (tests, live, plan, queue, alarms, results, history)
KEEP_S = 2.0  # between two looks at whether somebody works on the queue


def serve(settings: PanelSettings, *, ready: Callable[[str], None]) -> None:
    """Serve the page until the process is stopped; tests that run go on.

    Parameters
    ----------
    settings : PanelSettings
    ready : callable
        Told the address once the page can be opened.

    Raises
    ------
    InputError
        If the file of users is wrong, or the port is taken.
    StoreError
        If the store does not answer.
    """
    users = None if settings.users is None else read_users(settings.users)
    open_store(settings.store).close()
    everybody = Visitor(settings.name, "administer") if users is None else None
    sessions = Sessions(everybody)
    context = PanelContext(
        settings=settings,
        sessions=sessions,
        actions=Actions(settings, sessions),
        watch=StoreWatch(settings.store),
    )
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    add_login(app, sessions, users, context.actions.log)
    add_downloads(app, context.actions.jobs, settings.store)
    for page in PAGES:
        page.register(context)
    ui.run_with(
        app,
        title="accelbench",
        favicon=_ICON,
        dark=None,
        language="en-US",
        reconnect_timeout=30.0,
        show_welcome_message=False,
    )
    hosts = LOOPBACK if settings.is_loopback else None
    server = _Server(
        uvicorn.Config(
            Guard(app, sessions, hosts),
            host=settings.host,
            port=settings.port,
            log_level="warning",
            access_log=False,
            server_header=False,
            proxy_headers=False,
            timeout_graceful_shutdown=2,
            ws_max_size=1_000_000,
        )
    )
    server.when_ready = lambda: ready(f"http://{settings.host}:{server.port}/")
    runner, stop = RunnerProcess(settings.store, settings.notify), threading.Event()
    keeper = threading.Thread(target=_keep, args=(context.watch, runner, stop), daemon=True)
    context.watch.start()
    keeper.start()
    try:
        with _sigterm_as_ctrl_c(), suppress(KeyboardInterrupt):
            server.run()
    except SystemExit:  # uvicorn's way to say that the port cannot be had
        where = f"{settings.host}:{settings.port}"
        raise InputError(where, "", "cannot be listened on; choose another --port") from None
    finally:
        stop.set()
        keeper.join(15.0)
        runner.stop()
        context.watch.stop()


@contextmanager
def _sigterm_as_ctrl_c() -> Generator[None]:
    """Have SIGTERM end the page as Ctrl-C does, so that what it has started is stopped, too."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


class _Server(uvicorn.Server):
    """A server that tells when it can be reached."""

    when_ready: Callable[[], None] = staticmethod(lambda: None)
    port = 0

    async def startup(self, sockets: list[object] | None = None) -> None:  # type: ignore[override]
        await super().startup(sockets)  # type: ignore[arg-type]
        if self.started:
            self.port = self.servers[0].sockets[0].getsockname()[1]
            self.when_ready()


def _keep(watch: StoreWatch, runner: RunnerProcess, stop: threading.Event) -> None:
    """See to it that somebody works on the queue for as long as the page is served."""
    while not stop.wait(KEEP_S):
        snapshot = watch.snapshot
        if snapshot.problem:
            continue
        try:
            runner.keep(there=snapshot.runner)
        except OSError as err:
            logging.getLogger(__name__).warning("nobody works on the queue: %s", err)


_ICON = (
    "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 32 32'><rect width='32' height='32' "
    "rx='5' fill='#22303c'/><path d='M5 22 C10 22 12 9 17 9 S23 20 27 20' fill='none' "
    "stroke='#56b4e9' stroke-width='3'/></svg>"
)
