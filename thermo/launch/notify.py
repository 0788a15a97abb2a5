"""Notices to people elsewhere, sent by Apprise out of the store until each has arrived.

See docs/decisions/0013-notices-by-apprise.md.
"""

import hashlib
import io
import logging
import os
import stat
import threading
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from errormodel.errors import StoreError
from errormodel.io.toml import read_toml
from thermo.store.operation.alarm_kinds import ALARM_KINDS, Kind
from thermo.store.operation.notices import (
    Notice,
    list_notices,
    not_sent,
    sent,
    take_notice,
    unwanted,
)
from thermo.store.store import Store, open_store

log = logging.getLogger(__name__)

LOOK_S = 1.0  # between two looks for notices, real s
TITLE = "accelbench"

# sends one text to one address; returns why it could not, empty when it could
Deliver = Callable[[str, str, str], str]


class NotifyConfig(BaseModel):
    """Receivers of notices: Apprise addresses, and the kinds of alarm (all if not given)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    urls: Annotated[tuple[Annotated[str, Field(min_length=1)], ...], Field(min_length=1)]
    kinds: tuple[Kind, ...] | None = None


class NotifyFile(BaseModel):
    """A file with the section [notify]."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    notify: NotifyConfig


def default_notify_file() -> Path:
    """Return where the file is looked for: ``accelbench/notify.toml`` of the user's settings."""
    settings = os.environ.get("XDG_CONFIG_HOME") or str(Path.home() / ".config")
    return Path(settings) / "accelbench/notify.toml"


def read_notify(path: Path | str | None = None) -> NotifyConfig | None:
    """Read who is told.

    Parameters
    ----------
    path : path, optional
        If not given, the user's file, if there is one.

    Returns
    -------
    NotifyConfig or None
        None: nobody.

    Raises
    ------
    InputError
        Naming the file and the key that is wrong.
    """
    if path is None:
        path = default_notify_file()
        if not path.is_file():
            return None
    config = read_toml(path, NotifyFile).notify
    if Path(path).stat().st_mode & (stat.S_IRGRP | stat.S_IROTH):
        log.warning("%s: others can read it, and its addresses may hold passwords: chmod 600", path)
    return config


def deliver(url: str, title: str, body: str) -> str:
    """Send a text to one address by Apprise.

    Returns
    -------
    str
        Why it could not be sent, without the address's secrets; empty when it was.
    """
    try:
        import apprise
    except ImportError:
        return "needs Apprise: install accelbench[panel]"
    with (
        warnings.catch_warnings(),
        apprise.LogCapture(level=logging.WARNING, fmt="%(message)s") as said,
    ):
        warnings.simplefilter("ignore", DeprecationWarning)  # its modules are loaded at first use
        sender = apprise.Apprise()
        if not sender.add(url):
            return f"{url.partition('://')[0]}://…: no address that Apprise knows"
        done = sender.notify(title=title, body=body)
    if done:
        return ""
    shown = sender.urls(privacy=True)[0].partition("?")[0]
    assert isinstance(said, io.StringIO)
    lines = said.getvalue().strip().splitlines()
    return f"{shown}: {lines[-1] if lines else 'not taken'}"


def address_digest(url: str) -> str:
    """Return a name for an address that tells nothing of its secrets."""
    return hashlib.sha256(url.encode()).hexdigest()[:12]


class NoticeSender:
    """Sends a store's notices from a thread of its own, again and again until each has arrived.

    Several may work on one store. A context manager.

    Parameters
    ----------
    store_url : str
    config : NotifyConfig or None
        None: nothing is sent and the notices wait.
    deliver : callable
        Sends one text to one address.
    """

    def __init__(
        self, store_url: str, config: NotifyConfig | None, *, deliver: Deliver = deliver
    ) -> None:
        self._url = store_url
        self._config = config
        self._deliver = deliver
        self._give_up_s: float | None = None
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Begin to send."""
        if self._config is None or self._thread is not None:
            return
        self._thread = threading.Thread(target=self._work, name="notices", daemon=True)
        self._thread.start()

    def close(self, patience_s: float = 10.0) -> None:
        """Go on until everything is sent, at most so many real seconds; the rest waits."""
        self._give_up_s = time.monotonic() + patience_s
        self._closing.set()
        if self._thread is not None:
            self._thread.join(patience_s + LOOK_S)

    def __enter__(self) -> "NoticeSender":
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _work(self) -> None:
        while True:
            left = True
            try:
                with open_store(self._url, existing=True) as store:
                    left = self._send_until_closing(store)
            except StoreError as err:
                log.info("notices: %s", err)
            except Exception:
                log.exception("notices: an error of the program")
            if self._is_over(left=left):
                return
            time.sleep(LOOK_S)

    def _send_until_closing(self, store: Store) -> bool:
        """Send while there is anything to do; return whether notices are left."""
        while True:
            while not self._is_over(left=True) and (notice := take_notice(store)) is not None:
                self.send(store, notice)
            if self._closing.is_set():
                left = bool(list_notices(store, waiting_only=True))
                if self._is_over(left=left):
                    return left
                time.sleep(LOOK_S)
            else:
                self._closing.wait(LOOK_S)

    def _is_over(self, *, left: bool) -> bool:
        """Return True when it is closing and nothing is left, or the patience is at its end."""
        if not self._closing.is_set() or self._give_up_s is None:
            return False
        return not left or time.monotonic() >= self._give_up_s

    def send(self, store: Store, notice: Notice) -> None:
        """Try to send one notice to everybody who has not got it yet."""
        assert self._config is not None
        kinds = self._config.kinds
        if kinds is not None and notice.kind in ALARM_KINDS and notice.kind not in kinds:
            unwanted(store, notice)
            return
        done, errors = set(notice.delivered), list[str]()
        for url in self._config.urls:
            name = address_digest(url)
            if name in done:
                continue
            try:
                error = self._deliver(url, TITLE, notice.text)
            except Exception as err:  # one address must not keep the others from being told
                log.exception("notices: an error of the program")
                error = type(err).__name__
            if error:
                errors.append(error)
            else:
                done.add(name)
        if errors:
            log.info("notice %d: %s", notice.number, errors)
            not_sent(store, notice, frozenset(done), "; ".join(errors))
        else:
            sent(store, notice, frozenset(done))
