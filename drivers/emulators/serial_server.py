"""A line-oriented instrument on a real pseudo-terminal or TCP socket, able to misbehave.

URLs: ``serial:///some/path`` makes a symbolic link to the pseudo-terminal there, ``serial://auto``
in a directory of its own; ``socket://host:port`` listens, port 0 picks a free one. One thread
serves them; a late reply holds up everything behind it, as it does in an instrument.
"""

import contextlib
import logging
import os
import selectors
import socket
import threading
from pathlib import Path
from typing import Protocol
from urllib.parse import urlsplit

from drivers.emulators.faults import FaultPlan
from drivers.emulators.pseudo_terminal import WRITE_LIMIT_S, PseudoTerminal

log = logging.getLogger(__name__)

SPLIT_PAUSE_S = 0.05
LINE_LIMIT = 65536
CTRL_C = 0x03


class Responder(Protocol):
    """The instrument behind the line."""

    def respond(self, line: str) -> str | None:
        """Do what a line says; return the reply without its end, or None."""
        ...

    def refuse(self) -> None:
        """Put an error where the instrument keeps its errors."""
        ...


class _Plug(Protocol):
    """Source and sink of the bytes of one connection."""

    def fileno(self) -> int: ...
    def read(self) -> bytes: ...
    def write(self, data: bytes) -> None: ...


class SerialServer:
    """Serve one instrument's lines.

    Parameters
    ----------
    url : str
        See the module.
    responder : Responder
        What answers.
    faults : FaultPlan
        How the replies are spoiled.
    reply_end : bytes
        What ends a reply.

    Raises
    ------
    ValueError
        If the URL is of no known kind.
    """

    def __init__(
        self, url: str, responder: Responder, faults: FaultPlan, *, reply_end: bytes = b"\r\n"
    ) -> None:
        self._wanted = _target(url)
        self._responder = responder
        self._faults = faults
        self._end = reply_end
        self._selector = selectors.DefaultSelector()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._wake_r, self._wake_w = -1, -1
        self._pty: PseudoTerminal | None = None
        self._listener: socket.socket | None = None
        self._buffers: dict[_Plug, bytearray] = {}
        self.url = url

    def start(self) -> None:
        """Open the port and serve.

        Raises
        ------
        OSError
            If the address is taken or the link cannot be made.
        """
        self._stop.clear()
        self._wake_r, self._wake_w = os.pipe()
        self._selector.register(self._wake_r, selectors.EVENT_READ, None)
        try:
            if isinstance(self._wanted, Path):
                wanted = None if self._wanted.name == "auto" else self._wanted
                self._pty = PseudoTerminal(wanted)
                self.url = f"serial://{self._pty.path}"
                self._remember(self._pty)
            else:
                self._listen(*self._wanted)
        except OSError:
            self.close()
            raise
        self._thread = threading.Thread(target=self._serve, name=f"serve {self.url}", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop serving and remove what was made; harmless when done twice."""
        self._stop.set()
        self._wake()
        if self._thread is not None:
            self._thread.join(timeout=10.0)
            self._thread = None
        for plug in list(self._buffers):
            self._forget(plug)
        if self._listener is not None:
            self._listener.close()
            self._listener = None
        if self._pty is not None:
            self._pty.close()
            self._pty = None
        for fd in (self._wake_r, self._wake_w):
            if fd >= 0:
                with contextlib.suppress(KeyError):
                    self._selector.unregister(fd)
                os.close(fd)
        self._wake_r, self._wake_w = -1, -1

    # ---- ports

    def _wake(self) -> None:
        """Let the serving thread look at its ports anew."""
        if self._wake_w >= 0:
            with contextlib.suppress(OSError):
                os.write(self._wake_w, b"x")

    def _listen(self, host: str, port: int) -> None:
        self._listener = socket.create_server((host, port))
        self._listener.setblocking(False)
        self._selector.register(self._listener, selectors.EVENT_READ, self._listener)
        self.url = f"socket://{host}:{self._listener.getsockname()[1]}"

    def _remember(self, plug: _Plug) -> None:
        self._buffers[plug] = bytearray()
        self._selector.register(plug.fileno(), selectors.EVENT_READ, plug)

    def _forget(self, plug: _Plug) -> None:
        self._buffers.pop(plug, None)
        with contextlib.suppress(KeyError, ValueError, OSError):
            self._selector.unregister(plug.fileno())
        if isinstance(plug, _Connection):
            plug.close()

    def _drop(self, plug: _Plug) -> None:
        """Do to the asker what a pulled cable does, and plug it in again."""
        self._forget(plug)
        if isinstance(plug, PseudoTerminal):
            plug.replace()
            self._remember(plug)

    # ---- serving

    def _serve(self) -> None:
        while not self._stop.is_set():
            for key, _ in self._selector.select():
                if self._stop.is_set():
                    return
                if key.data is None:
                    os.read(self._wake_r, 64)
                elif key.data is self._listener and self._listener is not None:
                    with contextlib.suppress(OSError):
                        self._remember(_Connection(self._listener.accept()[0], self._stop))
                elif key.data in self._buffers:
                    self._read(key.data)

    def _read(self, plug: _Plug) -> None:
        try:
            data = plug.read()
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._drop(plug)
            return
        buffer = self._buffers[plug]
        for byte in data:
            if byte == CTRL_C:  # serial device clear
                buffer.clear()
            elif byte not in b"\r\n":
                buffer.append(byte)
            elif buffer:
                line = buffer.decode("ascii", "replace")
                buffer.clear()
                self._answer(plug, line)
                if self._stop.is_set() or plug not in self._buffers:
                    return
        if len(buffer) > LINE_LIMIT:
            buffer.clear()

    def _answer(self, plug: _Plug, line: str) -> None:
        try:
            reply = self._responder.respond(line)
        except Exception:
            log.exception("emulated instrument at %s failed on %r", self.url, line)
            return
        if reply is None:
            return
        data = reply.encode("ascii", "replace") + self._end
        fault = self._faults.take_reply_fault()
        if fault is not None:
            log.info("%s: %s instead of %r", self.url, fault, reply)
        if fault == "silence":
            return
        if fault == "exception":
            self._responder.refuse()
            return
        if fault == "dropped_connection":
            self._drop(plug)
            return
        if fault == "broken_crc":
            data = _garbled(reply) + self._end
        if fault == "late_reply" and self._stop.wait(self._faults.late_s):
            return
        # a reader that has gone away is noticed when it is read from
        with contextlib.suppress(OSError):
            if fault == "split_frame":
                plug.write(data[: len(data) // 2])
                self._stop.wait(min(SPLIT_PAUSE_S, self._faults.late_s))
                data = data[len(data) // 2 :]
            plug.write(data)


class _Connection:
    """One TCP connection."""

    def __init__(self, connection: socket.socket, stop: threading.Event) -> None:
        self._socket = connection
        self._stop = stop
        connection.settimeout(WRITE_LIMIT_S)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def fileno(self) -> int:
        return self._socket.fileno()

    def read(self) -> bytes:
        return self._socket.recv(4096)

    def write(self, data: bytes) -> None:
        self._socket.sendall(data)

    def close(self) -> None:
        self._socket.close()


def _target(url: str) -> Path | tuple[str, int]:
    """Turn a URL into the path of a link or an address to listen at."""
    parts = urlsplit(url)
    if parts.scheme == "serial" and (parts.netloc + parts.path).strip("/") == "auto":
        return Path("auto")
    if parts.scheme == "serial" and not parts.netloc and parts.path.strip("/"):
        return Path(parts.path)
    if parts.scheme == "socket" and parts.hostname and parts.port is not None:
        return parts.hostname, parts.port
    raise ValueError(f"url {url!r}, expected serial:///path, serial://auto or socket://host:port")


def _garbled(reply: str) -> bytes:
    """Set the top bit of every third character, as a wrong bit rate or parity would."""
    return bytes(
        b | 0x80 if i % 3 == 1 or i == 0 else b for i, b in enumerate(reply.encode("ascii"))
    )
