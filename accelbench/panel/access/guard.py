"""Guard before the page: checks host, origin, log-in and size of every request, sets headers.

- A host name that is not the page's own is refused: a foreign web site could otherwise point a
  name of its own at this machine (DNS rebinding).
- A WebSocket, or a request that may change something, from a page of another origin is refused.
- Without a log-in there is the log-in page and nothing else.
"""

from collections.abc import Awaitable, Callable, MutableMapping
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from typing import Any

from accelbench.panel.access.sessions import COOKIE, Sessions

Message = MutableMapping[str, Any]
Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
Asgi = Callable[[Scope, Receive, Send], Awaitable[None]]

OPEN_PATHS = ("/login", "/logout")
OPEN_PREFIXES = ("/_nicegui/",)  # scripts and styles of the library: no data of the laboratory
SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
MOST_BODY = 2_000_000  # a file that is uploaded, with its envelope

# the library compiles its templates in the browser ('unsafe-eval') and styles elements in place
POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
    "connect-src 'self' ws: wss:; object-src 'none'; base-uri 'self'; form-action 'self'; "
    "frame-ancestors 'none'"
)
HEADERS = (
    (b"content-security-policy", POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    # no-referrer would have browsers send "null" for the origin of the page's own forms
    (b"referrer-policy", b"same-origin"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"permissions-policy", b"camera=(), microphone=(), geolocation=(), usb=(), serial=()"),
)


class _TooLargeError(Exception):
    """A body is larger than anything that the page takes."""


@dataclass(slots=True)
class Guard:
    """ASGI application around the page.

    Parameters
    ----------
    app : ASGI application
    sessions : Sessions
    hosts : tuple of str or None
        Names by which the page may be called, without the port; None: any.
    """

    app: Asgi
    sessions: Sessions
    hosts: tuple[str, ...] | None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        headers = {k.decode("latin-1").lower(): v.decode("latin-1") for k, v in scope["headers"]}
        refusal = self._refusal(scope, headers)
        if refusal is not None:
            await _refuse(scope, send, *refusal)
            return
        scope["accelbench.token"] = token_of(headers)
        visitor = self.sessions.find(scope["accelbench.token"])
        path = str(scope["path"])
        looks = scope["type"] == "http" and scope["method"] in SAFE_METHODS
        is_open = path in OPEN_PATHS or (looks and path.startswith(OPEN_PREFIXES))
        if visitor is None and not is_open:
            await _ask_to_log_in(scope, send, path)
            return
        scope["accelbench.visitor"] = visitor
        await self._pass(scope, receive, send)

    def _refusal(self, scope: Scope, headers: dict[str, str]) -> tuple[int, str] | None:
        host = headers.get("host", "")
        if self.hosts is not None and host_name(host) not in self.hosts:
            return 421, "this page has another name"
        changes = scope["type"] == "websocket" or scope["method"] not in SAFE_METHODS
        origin = headers.get("origin")
        if changes and (origin is None or origin.partition("://")[2] != host):
            return 403, "the request comes from a page of another origin"
        if int(headers.get("content-length") or 0) > MOST_BODY:
            return 413, "too large"
        return None

    async def _pass(self, scope: Scope, receive: Receive, send: Send) -> None:
        taken = 0

        async def limited() -> Message:
            nonlocal taken
            message = await receive()
            if message["type"] == "http.request":
                taken += len(message.get("body", b""))
                if taken > MOST_BODY:
                    raise _TooLargeError
            return message

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                own = {name for name, _ in HEADERS}
                kept = [(k, v) for k, v in message["headers"] if k.lower() not in own]
                message["headers"] = [*kept, *HEADERS]
            await send(message)

        try:
            await self.app(scope, limited, with_headers)
        except _TooLargeError:
            await _refuse(scope, send, 413, "too large")


def token_of(headers: dict[str, str]) -> str | None:
    """Return the session's token among the headers of a request; None if there is none."""
    try:
        found = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
    except CookieError:
        return None
    return None if found is None else found.value


def host_name(host: str) -> str:
    """Return the name in a Host header, without its port."""
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.partition(":")[0].lower()


async def _ask_to_log_in(scope: Scope, send: Send, path: str) -> None:
    if scope["type"] == "http" and scope["method"] == "GET" and "." not in path:
        headers = [(b"location", b"/login"), (b"cache-control", b"no-store"), *HEADERS]
        await send({"type": "http.response.start", "status": 303, "headers": headers})
        await send({"type": "http.response.body", "body": b""})
        return
    await _refuse(scope, send, 401, "log in first")


async def _refuse(scope: Scope, send: Send, status: int, why: str) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 4403, "reason": why})
        return
    headers = [(b"content-type", b"text/plain; charset=utf-8"), *HEADERS]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": f"{why}\n".encode()})
