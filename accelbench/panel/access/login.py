"""The log-in page: plain HTML without scripts, so that nothing of the page runs before a log-in."""

from html import escape
from importlib.resources import files
from string import Template
from urllib.parse import parse_qs

from fastapi import FastAPI
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response

from accelbench.panel.access.sessions import COOKIE, LONGEST_S, Sessions
from accelbench.panel.access.users import LoginLimit, UserFile, check_password
from accelbench.panel.action_log import ActionLog
from accelbench.panel.frame import CSS

PAGE = Template(files("accelbench.panel.access").joinpath("login.html").read_text(encoding="utf-8"))
MOST_FORM = 10_000  # bytes


def add_login(app: FastAPI, sessions: Sessions, users: UserFile | None, log: ActionLog) -> None:
    """Add the log-in and log-out pages.

    Parameters
    ----------
    app : FastAPI
    sessions : Sessions
    users : UserFile or None
        None: there are none, and nobody has to log in.
    log : ActionLog
    """
    limit = LoginLimit()

    async def show(request: Request) -> Response:
        if users is None or sessions.find(request.scope.get("accelbench.token")):
            return RedirectResponse("/", status_code=303)
        return _page("")

    async def log_in(request: Request) -> Response:
        if users is None:
            return RedirectResponse("/", status_code=303)
        address = request.client.host if request.client else "unknown"
        wait_s = limit.wait_s(address)
        if wait_s > 0:
            text = f"Too many wrong log-ins from this address: wait {wait_s:.0f} s."
            return _page(text, status=429)
        body = await request.body()
        given = parse_qs(body[:MOST_FORM].decode("utf-8", "replace"))
        name, password = given.get("name", [""])[0][:64], given.get("password", [""])[0]
        user = await run_in_threadpool(check_password, users, name, password)
        if user is None:
            limit.failed(address)
            log.write(name, "log in", "refused", address=address)
            return _page("Name or password is wrong.", status=401)
        limit.succeeded(address)
        log.write(user.name, "log in", "done", address=address)
        response = RedirectResponse("/", status_code=303)
        response.set_cookie(
            COOKIE,
            sessions.begin(user.name, user.role),
            max_age=int(LONGEST_S),
            httponly=True,
            samesite="strict",
            secure=request.url.scheme == "https",
        )
        return response

    async def log_out(request: Request) -> Response:
        token = request.scope.get("accelbench.token")
        visitor = sessions.find(token)
        if visitor is not None and users is not None:
            log.write(visitor.name, "log out", "done")
        sessions.end(token)
        response = RedirectResponse("/login", status_code=303)
        response.delete_cookie(COOKIE)
        return response

    app.add_api_route("/login", show, methods=["GET"], include_in_schema=False)
    app.add_api_route("/login", log_in, methods=["POST"], include_in_schema=False)
    app.add_api_route("/logout", log_out, methods=["POST"], include_in_schema=False)


def _page(note: str, status: int = 200) -> HTMLResponse:
    shown = f"<div class='strip bad' role=alert>✖ {escape(note)}</div>" if note else ""
    headers = {"cache-control": "no-store"}
    return HTMLResponse(PAGE.substitute(css=CSS, note=shown), status_code=status, headers=headers)
