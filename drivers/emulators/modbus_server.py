"""A small Modbus server made of bytes alone, for emulated controllers.

It shares no code with the client: what one gets wrong the other notices. TCP, RTU on a
pseudo-terminal and RTU over TCP; it misbehaves on the wire as its fault plan says.
"""

import logging
import os
import select
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Literal

from drivers.emulators.faults import FaultPlan
from drivers.emulators.modbus_frames import Bank, answer, crc16, take_rtu, word_at
from drivers.emulators.pseudo_terminal import PseudoTerminal

log = logging.getLogger(__name__)

Transport = Literal["tcp", "rtu+tcp", "rtu"]
SPLIT_PAUSE_S = 0.03  # real: long against a character, short against any asker's patience
GAP_S = 0.05  # real: an RTU frame that does not go on for so long is given up
SEND_S = 5.0  # real: a client that takes nothing for so long is given up
DEVICE_FAILURE = 4


class ModbusServer:
    """Serves one register bank on one transport, every client in a thread of its own.

    Parameters
    ----------
    bank : Bank
        Must be thread-safe.
    faults : FaultPlan
        What goes wrong on the wire.
    transport : "tcp", "rtu+tcp" or "rtu"
    unit_id : int
        The unit it answers to.
    host, port
        Where to listen; port 0 takes a free one.
    path : Path or None
        For "rtu": a symbolic link to be made to the pseudo-terminal. It stays when the line is
        dropped and another pseudo-terminal takes its place. None: in a directory of its own.
    """

    def __init__(
        self,
        bank: Bank,
        faults: FaultPlan,
        *,
        transport: Transport = "tcp",
        unit_id: int = 1,
        host: str = "127.0.0.1",
        port: int = 0,
        path: Path | None = None,
    ) -> None:
        self._bank, self._faults = bank, faults
        self._transport, self._unit_id = transport, unit_id
        self._address = (host, port)
        self._path = path
        self._stop = threading.Event()
        self._threads: list[threading.Thread] = []
        self._spawning = threading.Lock()
        self._wake: tuple[int, int] | None = None  # a pipe that becomes readable at the end
        self._listener: socket.socket | None = None
        self._pty: PseudoTerminal | None = None

    @property
    def url(self) -> str:
        """URL for clients; known once started."""
        if self._pty is not None:
            return f"modbus+rtu://{self._pty.path}"
        if self._listener is None:
            raise RuntimeError("the server was not started")
        host, port = self._listener.getsockname()[:2]
        return f"modbus+{self._transport}://{host}:{port}"

    def start(self) -> None:
        """Open the port and serve."""
        self._wake = os.pipe()
        if self._transport == "rtu":
            self._pty = PseudoTerminal(self._path)
            self._spawn(self._serve_pty, self._pty)
            return
        self._listener = socket.create_server(self._address)
        self._spawn(self._accept, self._listener)

    def close(self) -> None:
        """Stop serving and release the port; harmless when done twice."""
        self._stop.set()
        if self._wake is not None:
            os.write(self._wake[1], b"!")
            while (thread := self._newest()) is not None:
                thread.join()
            for end in self._wake:
                os.close(end)
            self._wake = None
        if self._listener is not None:
            self._listener.close()
        if self._pty is not None:
            self._pty.close()

    def _spawn(self, target: Callable[..., None], *args: object) -> None:
        # a client may be let in while another thread ends the serving
        with self._spawning:
            thread = threading.Thread(target=target, args=args, daemon=True)
            thread.start()
            self._threads = [*(t for t in self._threads if t.is_alive()), thread]

    def _newest(self) -> threading.Thread | None:
        with self._spawning:
            return self._threads.pop() if self._threads else None

    def _readable(self, port: int, patience_s: float | None = None) -> bool:
        """Wait for bytes; False after `patience_s` without any, and when serving is over."""
        if self._wake is None or self._stop.is_set():
            return False
        wake = self._wake[0]
        ready = select.select([port, wake], [], [], patience_s)[0]
        return port in ready and wake not in ready

    # ---- TCP

    def _accept(self, listener: socket.socket) -> None:
        while self._readable(listener.fileno()):
            try:
                client, _ = listener.accept()
            except OSError:  # the client was gone before it was let in
                continue
            client.settimeout(SEND_S)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._spawn(self._serve_socket, client)

    def _serve_socket(self, client: socket.socket) -> None:
        serve = self._on_tcp if self._transport == "tcp" else self._on_rtu
        buffer = bytearray()
        with client, suppress(OSError):
            while not self._stop.is_set():
                idle = not self._readable(client.fileno(), GAP_S if buffer else None)
                if not idle:
                    data = client.recv(4096)
                    if not data:
                        return
                    buffer += data
                if not serve(buffer, client.sendall, idle=idle):
                    return

    def _on_tcp(self, buffer: bytearray, send: Callable[[bytes], None], *, idle: bool) -> bool:
        """Answer the whole TCP requests in the buffer; False: the connection is to be closed."""
        while len(buffer) >= 7:
            protocol, length = word_at(buffer, 2), word_at(buffer, 4)
            if protocol != 0 or not 2 <= length <= 254:
                return False  # out of step for good: there is no way to find the next frame
            if len(buffer) < 6 + length:
                return True
            head, unit, pdu = bytes(buffer[:2]), buffer[6], bytes(buffer[7 : 6 + length])
            del buffer[: 6 + length]
            if unit not in (self._unit_id, 0, 255):
                continue

            def frame(reply: bytes, broken: bool, head: bytes = head, unit: int = unit) -> bytes:
                number = (word_at(head, 0) ^ (0x5A5A if broken else 0)).to_bytes(2, "big")
                size = (len(reply) + 1).to_bytes(2, "big")
                return number + b"\0\0" + size + bytes((unit,)) + reply

            if not self._reply(pdu, frame, send):
                return False
        return True

    # ---- RTU

    def _on_rtu(self, buffer: bytearray, send: Callable[[bytes], None], *, idle: bool) -> bool:
        """Answer the whole RTU requests in the buffer; False: the line is to be dropped."""
        while (request := take_rtu(buffer, idle=idle)) is not None:
            unit, pdu = request
            if unit == 0:
                answer(self._bank, pdu)  # broadcast: done, and not answered
            if unit != self._unit_id or unit == 0:
                continue

            def frame(reply: bytes, broken: bool, unit: int = unit) -> bytes:
                body = bytes((unit,)) + reply
                return body + (crc16(body) ^ (0x0101 if broken else 0)).to_bytes(2, "little")

            if not self._reply(pdu, frame, send):
                return False
        return True

    def _serve_pty(self, pty: PseudoTerminal) -> None:
        buffer = bytearray()
        while not self._stop.is_set():
            idle = not self._readable(pty.fileno(), GAP_S if buffer else None)
            if not idle:
                with suppress(BlockingIOError):
                    buffer += pty.read()
            if not self._on_rtu(buffer, pty.write, idle=idle):
                buffer.clear()
                pty.replace()

    # ---- what goes wrong

    def _reply(
        self,
        pdu: bytes,
        frame: Callable[[bytes, bool], bytes],
        send: Callable[[bytes], None],
    ) -> bool:
        """Answer one request, spoiled if it is to be; False: drop the connection."""
        fault = self._faults.take_reply_fault()
        if fault == "exception":
            send(frame(bytes((pdu[0] | 0x80, DEVICE_FAILURE)), False))
            return True
        reply = frame(answer(self._bank, pdu), fault == "broken_crc")
        if fault == "silence":
            return True
        if fault == "late_reply":
            self._stop.wait(self._faults.late_s)
        if fault in ("split_frame", "dropped_connection"):
            half = len(reply) // 2
            send(reply[:half])
            if fault == "dropped_connection":
                return False
            time.sleep(SPLIT_PAUSE_S)
            reply = reply[half:]
        send(reply)
        return True
