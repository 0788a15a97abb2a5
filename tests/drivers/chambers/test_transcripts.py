"""The bytes of each chamber on each kind of wire, to the last one.

Requests and replies stand here as hexadecimal PDUs, worked out by hand from the makers' tables; a
peer on a real socket or pseudo-terminal plays them and fails at the first departure.
"""

import os
import select
import socket
import threading
import tty

import pytest

from drivers.chambers.open import open_chamber
from drivers.station import ChamberConfig


def crc(data: bytes) -> bytes:
    """CRC by long division, written out on its own."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = (value >> 1) ^ (0xA001 * (value & 1))
    return value.to_bytes(2, "little")


def ask(address: str, *words: str) -> list[tuple[str, str]]:
    """Read registers."""
    size = 2 * len(words)
    return [(f"03{address}{len(words):04x}", f"03{size:02x}" + "".join(words))]


def put(address: str, *words: str) -> list[tuple[str, str]]:
    """Write registers and read them back."""
    if len(words) == 1:
        frame = f"06{address}{words[0]}"
        return [(frame, frame), *ask(address, *words)]
    head = f"10{address}{len(words):04x}"
    return [(f"{head}{2 * len(words):02x}" + "".join(words), head), *ask(address, *words)]


def do(address: str, word: str) -> list[tuple[str, str]]:
    """Write a register that is not read back."""
    return [(f"06{address}{word}",) * 2]


NAME = ("0041", "0043", "0043", "0045", "004c", "0042", "0045", "004e", "0043", "0048")

F4T_UNITS = ask("1a4a", "000f")  # the TCP port works in °C
F4T_RTU_UNITS = ask("3700", "000f")
F4T_STILL = [
    *F4T_UNITS,
    *ask("0ad6", "0000", "c25c"),  # limits −55
    *ask("0ad8", "0000", "42aa"),  # and 85
]
F4T_IDENTIFY = [
    *F4T_STILL,
    *ask("0b04", "0000", "41bc"),  # it is 23.5 °C
    *ask("0ade", "0000", "41bc"),
    *ask("0afa", "0000", "41bc"),  # set point in force and static set point are the same
]
F4T_HOLD = [
    *F4T_STILL,
    *ask("40b8", "003d"),  # profile state: none
    *put("0ade", "0000", "c222"),  # −40.5, low word first
    *put("0aea", "003e"),  # ramp action off
    *put("0aaa", "000a"),  # automatic
    *ask("0afa", "0000", "c222"),  # the loop goes by it
]
F4T_RAMP = [
    *F4T_STILL,
    *ask("0b04", "0000", "41bc"),  # it is 23.5 °C
    *ask("2c18", "003d"),  # no error at the limit's input
    *ask("40b8", "003d"),
    *put("0ade", "0000", "41bc"),  # start at 23.5
    *put("0aea", "003e"),
    *put("0aaa", "000a"),
    *ask("0afa", "0000", "41bc"),  # the set point in force has come there
    *put("0aec", "0039"),  # per minute
    *put("0aee", "0000", "3fc0"),  # 1.5
    *put("0aea", "0055"),  # ramp on a new set point
    *put("0ade", "0000", "41f0"),  # 30
    *ask("0afa", "0000", "41bd"),  # on its way
]
F4T_SAFE = [
    *F4T_STILL,
    *ask("40b8", "0095"),  # a profile runs
    *do("40b6", "0094"),  # terminate
    *ask("40b8", "003d"),
    *put("0ade", "0000", "41c8"),  # 25
    *put("0aea", "003e"),
    *ask("0aaa", "0036"),  # in manual
    *put("0aaa", "000a"),
    *ask("0afa", "0000", "41c8"),  # the loop goes by it
]
EUROTHERM_SCALE = [
    *ask("8004", "41bc", "0000"),  # 23.5 as a float, high word first
    *ask("0002", "00eb"),
    *ask("8002", "41bc", "0000"),
    *ask("0001", "00eb"),
]
EUROTHERM_IDENTIFY = [
    *EUROTHERM_SCALE,
    *ask("0001", "00eb"),
    *ask("0002", "00eb"),
    *ask("0005", "00eb"),  # set point in force and target are the same
]
EUROTHERM_HOLD = [
    *EUROTHERM_SCALE,
    *ask("144b", "0001"),  # no program runs
    *ask("0114", "0000"),  # local set point
    *put("0002", "fe6b"),  # −40.5
    *put("0023", "0000"),  # no rate limit
    *put("004e", "0001"),  # disabled besides
    *put("0111", "0000"),  # automatic
    *ask("0005", "fe6b"),  # the loop goes by it
]
EUROTHERM_RAMP = [
    *EUROTHERM_SCALE,
    *ask("0001", "00eb"),  # 23.5
    *ask("004b", "0000"),  # no sensor break
    *ask("144b", "0001"),
    *ask("0114", "0000"),
    *put("0002", "00eb"),
    *put("0023", "0000"),
    *put("004e", "0001"),
    *put("0111", "0000"),
    *ask("0005", "00eb"),  # the working set point has come there
    *put("0023", "000f"),  # 1.5 °C/min
    *put("004e", "0000"),  # rate limit in force
    *put("0002", "012c"),  # 30
    *ask("0005", "00eb"),  # on its way
]
EUROTHERM_SAFE = [
    *EUROTHERM_SCALE,
    *ask("144b", "0002"),  # a program runs
    *do("146d", "0001"),  # reset
    *ask("144b", "0001"),
    *ask("0114", "0001"),  # a remote set point
    *put("0114", "0000"),
    *put("0002", "00fa"),  # 25
    *put("0023", "0000"),
    *put("004e", "0001"),
    *put("0111", "0000"),
    *ask("0005", "00fa"),  # the loop goes by it
]
F4_SCALE = [
    *ask("0385", "0001"),  # °C
    *ask("025e", "0001"),  # one decimal
    *ask("025a", "fdda"),  # limits −55
    *ask("025b", "0352"),  # and 85
]
F4_IDENTIFY = [
    *F4_SCALE,
    *ask("0064", "00eb"),  # 23.5
    *ask("012c", "00eb"),
]
F4_HOLD = [
    *F4_SCALE,
    *ask("00c8", "0001"),  # no profile runs
    *put("012c", "fe6b"),  # −40.5
]
F4_RAMP = [
    *F4_SCALE,
    *ask("0064", "00eb"),  # 23.5
    *ask("0065", "0000"),  # no input error
    *ask("00c8", "0001"),
    *put("012c", "00eb"),  # static set point
    *ask("04c2", "0028"),  # 40 profiles free: ours is not there
    *ask("04c2", "0028"),
    *do("0fa2", "0001"),  # create
    *ask("04c2", "0027"),
    *ask("0fa0", "0001"),  # it is number 1
    *put("0fa1", "0001"),
    *do("0fa2", "0002"),  # insert a step before the end
    *put("0fa1", "0002"),
    *ask("0fa3", "0005"),
    *put("0fa1", "0001"),
    *ask("0fa3", "0003"),
    *put("0dac", *NAME),
    *put("0fa0", "0001"),
    *put("0fa1", "0002"),
    *ask("0fa3", "0005"),
    *put("0fa1", "0001"),
    *put("0fa3", "0002"),  # ramp by rate
    *put("0fcb", "000f"),  # 1.5 °C/min
    *put("0fcc", "012c"),  # to 30
    *put("0fac", "0000"),  # no wait
    *put("0fd0", "0000"),  # no guaranteed soak
    *put("0fa1", "0002"),
    *put("0fdc", "0000"),  # the end holds
    *put("0fa0", "0001"),
    *put("0fa1", "0001"),
    *do("0fa2", "0005"),  # start
    *ask("00c8", "0002"),
]
F4_SAFE = [
    *F4_SCALE,
    *put("012c", "00fa"),
    *do("04c1", "0001"),  # terminate
    *ask("00c8", "0001"),
    *put("012c", "00fa"),
]
BARRIERS = {  # what an RTU line is brought into step with: an unusual number of registers
    "watlow_f4t": ask("0ad6", "0000", "c25c", "0000"),
    "watlow_f4": ask("077c", "000c", "001e", "0000"),
    "eurotherm_3504": ask("0001", "00eb", "00eb", "0000"),
}
TEMPERATURES = {  # asked for once more, to be told
    "watlow_f4t": ask("0b04", "0000", "41bc"),
    "watlow_f4": ask("0064", "00eb"),
    "eurotherm_3504": ask("0001", "00eb"),
}
SCRIPTS = {
    "watlow_f4t": (F4T_IDENTIFY, F4T_HOLD, F4T_RAMP, F4T_SAFE),
    "watlow_f4": (F4_IDENTIFY, F4_HOLD, F4_RAMP, F4_SAFE),
    "eurotherm_3504": (EUROTHERM_IDENTIFY, EUROTHERM_HOLD, EUROTHERM_RAMP, EUROTHERM_SAFE),
}
CALLS = {
    "identify": lambda chamber: None,
    "hold": lambda chamber: chamber.hold_temp_c(-40.5),
    "ramp": lambda chamber: chamber.ramp_to_c(30.0, 1.5),
    "safe": lambda chamber: chamber.make_safe(25.0),
}


class Scripted:
    """A peer that knows one conversation and takes note of the first departure."""

    def __init__(self, transport: str, script: list[tuple[str, str]]) -> None:
        self.framed = [
            (self.frame(transport, q, n), self.frame(transport, a, n))
            for n, (q, a) in enumerate(script, start=1)
        ]
        self.fault = ""
        if transport == "rtu":
            self.ours, self.theirs = os.openpty()
            tty.setraw(self.theirs)
            self.url = f"modbus+rtu://{os.ttyname(self.theirs)}"
            target = self.play_pty
        else:
            self.listener = socket.create_server(("127.0.0.1", 0))
            self.url = f"modbus+{transport}://127.0.0.1:{self.listener.getsockname()[1]}"
            target = self.play_socket
        self.thread = threading.Thread(target=target, daemon=True)
        self.thread.start()

    @staticmethod
    def frame(transport: str, pdu: str, number: int) -> bytes:
        body = b"\x07" + bytes.fromhex(pdu)  # unit 7
        if transport == "tcp":
            return number.to_bytes(2, "big") + b"\0\0" + len(body).to_bytes(2, "big") + body
        return body + crc(body)

    def play_socket(self) -> None:
        self.listener.settimeout(5)
        client, _ = self.listener.accept()
        client.settimeout(5)
        with client:
            self.play(client.recv, client.sendall)
            client.settimeout(0.3)
            try:
                more = client.recv(256)
            except TimeoutError:
                more = b""
        if more and not self.fault:
            self.fault = f"after the end came {more.hex(' ')}"

    def play_pty(self) -> None:
        def read(size: int) -> bytes:
            if not select.select([self.ours], [], [], 5)[0]:
                raise TimeoutError
            return os.read(self.ours, size)

        self.play(read, lambda data: os.write(self.ours, data))

    def play(self, read, send) -> None:
        for n, (question, reply) in enumerate(self.framed):
            heard = b""
            try:
                while len(heard) < len(question):
                    heard += read(len(question) - len(heard)) or b"?"
            except TimeoutError:
                pass
            if heard != question:
                self.fault = f"question {n}: {heard.hex(' ')}, expected {question.hex(' ')}"
                return
            send(reply)

    def finish(self) -> None:
        self.thread.join(6)
        if self.url.startswith("modbus+rtu:///"):
            os.close(self.ours)
            os.close(self.theirs)
        else:
            self.listener.close()
        assert not self.thread.is_alive()
        assert self.fault == ""


@pytest.mark.parametrize("transport", ["tcp", "rtu", "rtu+tcp"])
@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("model", SCRIPTS)
def test_bytes(model, call, transport):
    script = [] if transport == "tcp" else [*BARRIERS[model]]
    script += SCRIPTS[model][0]
    if call != "safe":  # which recognises the controller itself
        script += TEMPERATURES[model]
    if call != "identify":
        script += SCRIPTS[model][list(CALLS).index(call)]
    if transport != "tcp":  # each port of an F4T has a unit of its own
        script = [F4T_RTU_UNITS[0] if step == F4T_UNITS[0] else step for step in script]
    wire = Scripted(transport, script)
    # a departure shows as silence, so the time limit is only for failing tests
    config = ChamberConfig(model=model, url=wire.url, unit_id=7, retries=0, timeout_s=2.0)
    chamber = open_chamber(config)
    try:
        if call != "safe":
            assert "23.5 °C" in chamber.identify()
        result = CALLS[call](chamber)
        assert result is None or result.verified
        assert chamber.counters.exchanges == len(script)
    finally:
        chamber.close()
        wire.finish()
