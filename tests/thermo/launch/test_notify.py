"""Notices: each kind arrives at a webhook on this machine, though that was away at first."""

import json
import stat
import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from errormodel.errors import InputError
from tests.thermo.launch.test_dead_controllers import wait_until
from thermo.launch.notify import NoticeSender, NotifyConfig, deliver, read_notify
from thermo.store.operation.alarm_kinds import ALARM_KINDS
from thermo.store.operation.alarms import raise_alarm
from thermo.store.operation.notices import list_notices
from thermo.store.store import open_store

pytest.importorskip("apprise", reason="Apprise is not installed: pip install accelbench[panel]")


class Webhook:
    """Takes notices in a thread of its own; `away` refuses them as a server out of order does."""

    def __init__(self) -> None:
        self.away = False
        self.refused = 0
        self.taken: list[str] = []
        hook = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers["Content-Length"]))
                if hook.away:
                    hook.refused += 1
                else:
                    hook.taken.append(json.loads(body)["message"])
                self.send_response(503 if hook.away else 200)
                self.end_headers()

            def log_message(self, *_: object) -> None:
                pass

        self._server = HTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"json://127.0.0.1:{self._server.server_port}"

    @contextmanager
    def serving(self):
        thread = threading.Thread(target=self._server.serve_forever, args=(0.02,), daemon=True)
        thread.start()
        try:
            yield self
        finally:
            self._server.shutdown()
            thread.join()
            self._server.server_close()


@pytest.fixture
def webhook():
    with Webhook().serving() as made:
        yield made


def test_every_kind_arrives_once_though_the_receiver_was_away(webhook, tmp_path):
    path = tmp_path / "store.sqlite"
    webhook.away = True
    with open_store(path) as store:
        for kind in ALARM_KINDS:
            raise_alarm(store, kind, f"it is {kind}")
        with NoticeSender(str(path), NotifyConfig(urls=(webhook.url,))):
            wait_until(lambda: webhook.refused >= len(ALARM_KINDS))
            (first, *_) = list_notices(store, waiting_only=True)
            assert "127.0.0.1" in first.last_error
            webhook.away = False
            wait_until(lambda: not list_notices(store, waiting_only=True))
        assert {n.state for n in list_notices(store)} == {"sent"}
    assert len(ALARM_KINDS) >= 12
    assert sorted(t.split(":")[0] for t in webhook.taken) == sorted(
        k.title for k in ALARM_KINDS.values()
    )


def test_of_two_receivers_only_the_one_that_has_not_got_it_is_told_again(tmp_path):
    path, sent, broken = tmp_path / "store.sqlite", list[str](), {"b://y"}

    def fake(url: str, title: str, body: str) -> str:
        if url in broken:
            broken.discard(url)
            return f"{url}: refused"
        sent.append(url)
        return ""

    with open_store(path) as store:
        raise_alarm(store, "finished", "done")
        raise_alarm(store, "late", "slot 3")
        config = NotifyConfig(urls=("a://x", "b://y"), kinds=("finished",))
        with NoticeSender(str(path), config, deliver=fake):
            wait_until(lambda: not list_notices(store, waiting_only=True))
        assert [n.state for n in list_notices(store)] == ["sent", "unwanted"]
    assert sent == ["a://x", "b://y"]


def test_what_could_not_be_sent_waits_for_the_next_sender(tmp_path):
    path = tmp_path / "store.sqlite"
    with open_store(path) as store:
        raise_alarm(store, "finished", "done")
        config = NotifyConfig(urls=("a://x",))
        sender = NoticeSender(str(path), config, deliver=lambda *_: "refused")
        sender.start()
        wait_until(lambda: list_notices(store)[0].last_error == "refused")
        sender.close(patience_s=0.0)
        assert [n.state for n in list_notices(store)] == ["waiting"]
        with NoticeSender(str(path), config, deliver=lambda *_: ""):
            wait_until(lambda: list_notices(store)[0].state == "sent")


def test_an_address_s_secrets_are_not_told(webhook):
    assert deliver("json://user:secret@127.0.0.1:1/", "t", "x")
    assert "secret" not in deliver("json://user:secret@127.0.0.1:1/", "t", "x")
    assert "secret" not in deliver("nosuch://user:secret@h", "t", "x")


def test_a_file_that_is_wrong_is_refused_with_its_key(tmp_path, monkeypatch):
    path = tmp_path / "notify.toml"
    path.write_text('[notify]\nurls = ["json://h"]\nkinds = ["finnished"]\n', encoding="utf-8")
    with pytest.raises(InputError, match=r"notify\.kinds"):
        read_notify(path)
    path.write_text("[notify]\nurls = []\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"notify\.urls"):
        read_notify(path)
    path.write_text('[notify]\nurls = ["json://h"]\n', encoding="utf-8")
    path.chmod(stat.S_IRUSR | stat.S_IWUSR)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "none"))
    assert read_notify() is None
    found = read_notify(path)
    assert found is not None
    assert found.urls == ("json://h",)
