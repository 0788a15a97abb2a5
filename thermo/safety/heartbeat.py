"""Tell a service manager (systemd) that the controller lives."""

import contextlib
import os
import socket


def notify_service(*lines: str) -> None:
    """Tell the service manager (systemd) how things are; nothing where there is none.

    Never waits and never fails: a manager that does not listen is its own affair.

    Parameters
    ----------
    *lines : str
        As sd_notify(3) takes them: "READY=1", "WATCHDOG=1", "STATUS=…".
    """
    where = os.environ.get("NOTIFY_SOCKET", "")
    if not where or where[0] not in "/@":
        return
    address = "\0" + where[1:] if where[0] == "@" else where
    with (
        contextlib.suppress(OSError),
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager,
    ):
        manager.setblocking(False)
        manager.sendto("\n".join(lines).encode(), address)


def watchdog_s() -> float | None:
    """Return after how long without a beat the service manager acts, s; None: it does not."""
    try:
        return int(os.environ["WATCHDOG_USEC"]) / 1e6
    except (KeyError, ValueError):
        return None
