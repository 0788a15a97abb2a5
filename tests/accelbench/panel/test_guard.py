"""What never reaches the page: foreign hosts and origins, no log-in, too much at once."""

import asyncio
from pathlib import Path

import pytest

pytest.importorskip("argon2", reason="pip install 'accelbench[panel]' has the page tested")

from accelbench.panel.access.guard import MOST_BODY, Guard
from accelbench.panel.access.sessions import IDLE_S, LONGEST_S, NotAllowedError, Sessions, Visitor
from accelbench.panel.access.users import (
    LONGEST_WAIT_S,
    LoginLimit,
    add_user,
    check_password,
    read_users,
)
from accelbench.panel.folders import TomlFolder
from accelbench.panel.settings import PanelSettings
from errormodel.errors import InputError

HOST = "127.0.0.1:8300"


def answer(
    sessions: Sessions,
    *,
    kind: str = "http",
    method: str = "GET",
    path: str = "/",
    hosts: tuple[str, ...] | None = ("127.0.0.1", "localhost"),
    body: bytes = b"",
    **headers: str,
) -> tuple[int, dict[str, str]]:
    """Ask through a guard and return status and headers; 200 is the page's own answer."""
    sent: list[dict] = []

    async def app(scope, receive, send):
        if scope["type"] == "websocket":
            await send({"type": "websocket.accept"})
            return
        more = True
        while more:
            more = (await receive()).get("more_body", False)
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b"the page"})

    pieces = [body[k : k + 500_000] for k in range(0, len(body), 500_000)] or [b""]

    async def receive():
        piece = pieces.pop(0)
        return {"type": "http.request", "body": piece, "more_body": bool(pieces)}

    async def send(message):
        sent.append(message)

    given = {"host": HOST} | headers
    scope = {
        "type": kind,
        "method": method,
        "path": path,
        "headers": [(k.replace("_", "-").encode(), v.encode()) for k, v in given.items()],
    }
    asyncio.run(Guard(app, sessions, hosts)(scope, receive, send))
    first = sent[0]
    if first["type"].startswith("websocket"):
        return (101 if first["type"] == "websocket.accept" else first["code"]), {}
    return first["status"], {k.decode(): v.decode() for k, v in first["headers"]}


@pytest.fixture
def everybody() -> Sessions:
    return Sessions(Visitor("me", "administer"))


def test_the_page_is_given_with_strict_headers(everybody) -> None:
    status, headers = answer(everybody)
    assert status == 200
    assert "frame-ancestors 'none'" in headers["content-security-policy"]
    assert "default-src 'self'" in headers["content-security-policy"]
    assert headers["x-content-type-options"] == "nosniff"


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8300", "127.0.0.1.evil.example", ""]
)
def test_another_name_of_this_machine_is_refused(everybody, host) -> None:
    assert answer(everybody, host=host)[0] == 421


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:9999", None])
@pytest.mark.parametrize(("kind", "method"), [("websocket", "GET"), ("http", "POST")])
def test_a_page_of_another_origin_can_change_nothing(everybody, kind, method, origin) -> None:
    headers = {} if origin is None else {"origin": origin}
    assert answer(everybody, kind=kind, method=method, **headers)[0] in (403, 4403)
    assert answer(everybody, kind=kind, method=method, origin=f"http://{HOST}")[0] in (101, 200)


@pytest.mark.parametrize("length", [str(MOST_BODY + 1), None])
def test_a_body_that_is_too_large_is_refused_whether_it_says_so_or_not(everybody, length) -> None:
    headers = {"origin": f"http://{HOST}"} | ({} if length is None else {"content_length": length})
    body = bytes(MOST_BODY + 1)
    assert answer(everybody, method="POST", body=body, **headers)[0] == 413


def test_without_a_log_in_there_is_the_log_in_page_and_nothing_else() -> None:
    sessions = Sessions()
    status, headers = answer(sessions)
    assert (status, headers["location"]) == (303, "/login")
    assert answer(sessions, path="/login")[0] == 200
    own = {"origin": f"http://{HOST}"}
    assert answer(sessions, kind="websocket", path="/_nicegui_ws/socket.io/", **own)[0] == 4403
    upload = "/_nicegui/client/x/upload/1"
    assert answer(sessions, method="POST", path=upload, **own)[0] == 401
    token = sessions.begin("ann", "view")
    assert answer(sessions, cookie=f"accelbench_session={token}")[0] == 200
    assert answer(sessions, cookie="accelbench_session=" + "A" * 43)[0] == 303
    sessions.end(token)
    assert answer(sessions, cookie=f"accelbench_session={token}")[0] == 303


def test_log_ins_expire_when_idle_and_in_the_end() -> None:
    now = [0.0]
    sessions = Sessions(clock=lambda: now[0])
    token = sessions.begin("ann", "operate")
    visitor = sessions.find(token)
    assert visitor is not None
    while now[0] < LONGEST_S - IDLE_S:
        now[0] += 0.9 * IDLE_S
        assert sessions.find(token) is visitor
    now[0] = LONGEST_S + 1
    assert sessions.find(token) is None
    with pytest.raises(NotAllowedError, match="expired"):
        sessions.need(visitor, "view")
    idle = sessions.find(sessions.begin("bob", "view"))
    now[0] += IDLE_S + 1
    assert not sessions.holds(idle)


def test_a_role_includes_those_before_it() -> None:
    sessions = Sessions()
    seen = sessions.find(sessions.begin("ann", "view"))
    sessions.need(seen, "view")
    with pytest.raises(NotAllowedError, match="may view; this needs operate"):
        sessions.need(seen, "operate")
    sessions.need(sessions.find(sessions.begin("bob", "administer")), "operate")


def test_users_are_kept_as_hashes_and_checked(tmp_path: Path) -> None:
    path = tmp_path / "users.toml"
    add_user(path, "ann", "operate", "correct horse")
    add_user(path, "bob", "view", "battery staple")
    add_user(path, "Ann", "view", "another word")
    assert "horse" not in path.read_text()
    assert path.stat().st_mode & 0o077 == 0
    users = read_users(path)
    assert [u.name for u in users.user] == ["bob", "Ann"]
    assert check_password(users, "ANN", "another word").role == "view"
    assert check_password(users, "ann", "correct horse") is None
    assert check_password(users, "nobody", "another word") is None
    with pytest.raises(InputError, match="fewer than 10"):
        add_user(path, "eve", "view", "short")


def test_wrong_log_ins_make_an_address_wait_longer_and_longer() -> None:
    now = [0.0]
    limit = LoginLimit(clock=lambda: now[0])
    waits = []
    for _ in range(14):
        limit.failed("a")
        waits.append(limit.wait_s("a"))
        now[0] += waits[-1]
    assert waits[:5] == [0.0, 0.0, 2.0, 4.0, 8.0]
    assert waits[-1] == LONGEST_WAIT_S
    assert limit.wait_s("b") == 0.0
    limit.succeeded("a")
    limit.failed("a")
    assert limit.wait_s("a") == 0.0


@pytest.mark.parametrize(
    "name",
    [
        "../x.toml",
        "/etc/x.toml",
        "a/b.toml",
        ".x.toml",
        "x.py",
        "x.toml\n",
        "-x.toml",
        "",
        "ü.toml",
    ],
)
def test_no_name_leads_out_of_the_folder(tmp_path: Path, name: str) -> None:
    inside = tmp_path / "inside"
    inside.mkdir()
    (tmp_path / "x.toml").write_text("secret = 1")
    folder = TomlFolder(inside)
    with pytest.raises(InputError):
        folder.file(name)
    with pytest.raises(InputError):
        folder.save(name, "a = 1")


def test_a_link_that_leads_out_of_the_folder_is_not_followed(tmp_path: Path) -> None:
    inside = tmp_path / "inside"
    inside.mkdir()
    (tmp_path / "x.toml").write_text("secret = 1")
    (inside / "y.toml").symlink_to(tmp_path / "x.toml")
    with pytest.raises(InputError, match="leads out"):
        TomlFolder(inside).file("y.toml")
    with pytest.raises(InputError, match="choose another"):
        TomlFolder(inside).save("y.toml", "a = 1")


def test_other_machines_are_let_in_only_with_users(tmp_path: Path) -> None:
    given = {"store": "s.sqlite", "stations": tmp_path, "sequences": tmp_path, "name": "me"}
    PanelSettings(**given)
    with pytest.raises(InputError, match="--users"):
        PanelSettings(**given, host="0.0.0.0")
    PanelSettings(**given, host="0.0.0.0", users=tmp_path / "users.toml")
