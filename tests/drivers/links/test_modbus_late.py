"""Late replies on a line that does not say what a reply answers.

The slave here answers every request in its order, each with its own address as the value, and is
often slower than the master's patience. Its replies go to whoever is connected when they are
ready, as a serial server's or a real line's do. Nobody may ever see another register's value.
"""

import os
import queue
import random
import select
import socket
import threading
import time
import tty

import pytest

from drivers.emulators.modbus_frames import crc16, take_rtu
from drivers.errors import LinkError, ProtocolError
from drivers.links.barrier import Barrier
from drivers.links.modbus_link import ModbusLink
from drivers.station import LinkConfig

TIMEOUT_S = 0.018
DELAYS_S = (0.0,) * 12 + (0.024, 0.03, 0.05, 0.12)


class SlowSlave:
    """An RTU slave behind a pseudo-terminal or a serial server."""

    def __init__(self, transport: str, seed: int) -> None:
        self.rng = random.Random(seed)
        self.requests: queue.Queue[bytes] = queue.Queue()
        self.over = threading.Event()
        self.client: socket.socket | None = None
        self.buffer = bytearray()
        if transport == "rtu":
            self.ours, self.theirs = os.openpty()
            tty.setraw(self.theirs)
            self.url = f"modbus+rtu://{os.ttyname(self.theirs)}"
            listen = self.listen_pty
        else:
            self.listener = socket.create_server(("127.0.0.1", 0))
            self.listener.settimeout(0.02)
            self.url = f"modbus+rtu+tcp://127.0.0.1:{self.listener.getsockname()[1]}"
            listen = self.listen_tcp
        self.transport = transport
        self.threads = [threading.Thread(target=t, daemon=True) for t in (listen, self.work)]
        for thread in self.threads:
            thread.start()

    def listen_pty(self) -> None:
        while not self.over.is_set():
            if select.select([self.ours], [], [], 0.02)[0]:
                self.take(os.read(self.ours, 256))

    def listen_tcp(self) -> None:
        while not self.over.is_set():
            try:
                client, _ = self.listener.accept()
            except TimeoutError:
                continue
            client.settimeout(0.02)
            self.client = client
            with client:
                while not self.over.is_set():
                    try:
                        data = client.recv(256)
                    except TimeoutError:
                        continue
                    except OSError:
                        break
                    if not data:
                        break
                    self.take(data)

    def take(self, data: bytes) -> None:
        self.buffer += data
        while (request := take_rtu(self.buffer, idle=False)) is not None:
            self.requests.put(request[1])

    def work(self) -> None:
        while not self.over.is_set():
            try:
                pdu = self.requests.get(timeout=0.02)
            except queue.Empty:
                continue
            time.sleep(self.rng.choice(DELAYS_S))
            body = bytes((1, 3, 2 * pdu[4])) + pdu[1:3] * pdu[4]
            self.send(body + crc16(body).to_bytes(2, "little"))

    def send(self, frame: bytes) -> None:
        try:
            if self.transport == "rtu":
                os.write(self.ours, frame)
            elif self.client is not None:
                self.client.sendall(frame)
        except OSError:
            pass

    def close(self) -> None:
        self.over.set()
        for thread in self.threads:
            thread.join()
        if self.transport == "rtu":
            os.close(self.ours)
            os.close(self.theirs)
        else:
            self.listener.close()


@pytest.mark.parametrize("transport", ["rtu", "rtu+tcp"])
@pytest.mark.parametrize("retries", [0, 2])
def test_every_answer_is_to_its_own_question(transport, retries):
    slave = SlowSlave(transport, seed=retries)
    config = LinkConfig(url=slave.url, timeout_s=TIMEOUT_S, retries=retries, baud=115200)
    link = ModbusLink(
        config, name="slave", barrier=Barrier(address=9999), before_write=lambda: None
    )
    answered = 0
    try:
        for n in range(50):
            address = 100 + n
            try:
                assert link.read(address, 1) == (address,)
                answered += 1
            except (LinkError, ProtocolError):
                continue
    finally:
        link.close()
        slave.close()
    assert answered >= 10
    assert link.counters.timeouts + link.counters.bad_replies >= 5, "it was put to the test"
