"""Opening a serial port or a serial server's TCP port, and what may go wrong with one."""

import contextlib
import socket
import termios
from typing import Literal
from urllib.parse import urlsplit

import serial
from serial.urlhandler import protocol_socket

from drivers.errors import LinkError

Flow = Literal["none", "xon_xoff", "rts_cts"]

# what pyserial and the system raise for a port that is not there, gone, or mistyped
PORT_ERRORS = (OSError, termios.error, ValueError, TypeError)


class _SocketPort(protocol_socket.Serial):
    """pyserial's TCP port without its waiting.

    A command is not held back until the one before it was acknowledged (40 ms for each), and
    closing does not sleep 0.3 s.
    """

    _socket: socket.socket

    def open(self) -> None:
        super().open()
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def close(self) -> None:
        if self.is_open:
            self.is_open = False
            with contextlib.suppress(OSError):
                self._socket.shutdown(socket.SHUT_RDWR)
            self._socket.close()


AnyPort = serial.Serial | _SocketPort


def open_port(where: str, baud: int, flow: Flow, write_timeout_s: float) -> AnyPort:
    """Open a port for one user.

    Parameters
    ----------
    where : str
        As `address` returns it.
    baud : int
        Bit rate, 1/s.
    flow : {"none", "xon_xoff", "rts_cts"}
        Flow control.
    write_timeout_s : float
        How long the other side may hold up a command, real seconds.

    Returns
    -------
    AnyPort

    Raises
    ------
    PORT_ERRORS
        One of these, if it cannot be opened or somebody else has it.
    """
    make = _SocketPort if where.startswith("socket://") else serial.Serial
    port: AnyPort = make(
        baudrate=baud,
        write_timeout=write_timeout_s,
        xonxoff=flow == "xon_xoff",
        rtscts=flow == "rts_cts",
        exclusive=True,  # two readers would take each other's replies
    )
    port.port = where
    port.open()
    return port


def address(url: str, name: str) -> str:
    """Turn a station file's URL into pyserial's.

    Raises
    ------
    LinkError
        If it is neither ``serial:///dev/...`` nor ``socket://host:port``.
    """
    with contextlib.suppress(ValueError):  # a port that is no number, a bracket left open
        parts = urlsplit(url)
        if parts.scheme == "serial" and not parts.netloc and parts.path.startswith("/"):
            return parts.path
        if parts.scheme == "socket" and parts.hostname and parts.port:
            return f"socket://{parts.netloc}"
    raise LinkError(f"{name}: url {url!r}, expected serial:///dev/... or socket://host:port")


def error_text(err: BaseException) -> str:
    """Return an error's text on one line."""
    return " ".join(str(err).split()) or type(err).__name__
