"""The emulated controllers' server: noise, halves, crowds."""

import os
import random
import socket
import struct
import threading
import time

import pytest

from drivers.clock import SteppedClock
from drivers.emulators.chambers import ChamberEmulator
from drivers.emulators.faults import FaultPlan
from drivers.emulators.modbus_frames import answer, crc16, take_rtu
from tests.drivers.ideal_plant import IdealPlant

READ_PV = bytes.fromhex("01 03 0001 0001")
READ_PV += crc16(READ_PV).to_bytes(2, "little")
PV = bytes.fromhex("01 03 02 00ea")  # 23.4 °C
PV += crc16(PV).to_bytes(2, "little")


@pytest.fixture
def emulator(request):
    clock = SteppedClock()
    faults = FaultPlan([], "chamber", clock)
    model, transport = request.param
    with ChamberEmulator(model, IdealPlant(air_c=23.4), clock, faults, transport=transport) as e:
        yield e


def connect(emulator) -> socket.socket:
    host, _, port = emulator.url.rpartition("//")[2].partition(":")
    return socket.create_connection((host, int(port)), timeout=2)


def ask_tcp(client: socket.socket, pdu: str, number: int = 1) -> bytes:
    body = b"\1" + bytes.fromhex(pdu)
    client.sendall(number.to_bytes(2, "big") + b"\0\0" + len(body).to_bytes(2, "big") + body)
    reply = client.recv(300)
    assert reply[:4] == number.to_bytes(2, "big") + b"\0\0"
    assert len(reply) == 6 + int.from_bytes(reply[4:6], "big")
    return reply[7:]


f4t_tcp = pytest.mark.parametrize("emulator", [("watlow_f4t", "tcp")], indirect=True)
eurotherm_rtu_tcp = pytest.mark.parametrize(
    "emulator", [("eurotherm_3504", "rtu+tcp")], indirect=True
)


@f4t_tcp
@pytest.mark.parametrize(
    ("request_pdu", "reply_pdu"),
    [
        ("01 0000 0001", "81 01"),  # no such function
        ("2b 0e 01 00", "ab 01"),
        ("03 0000 0001", "83 02"),  # no such register
        ("03 0ade 0000", "83 03"),  # none asked for
        ("03 0ade 007e", "83 03"),  # too many
        ("03 0ade", "83 03"),  # half a request
        ("06 0b04 0001", "86 02"),  # the temperature is read-only
        ("06 0aea 0007", "86 03"),  # no such ramp action
        ("06 0ade 0007", "86 03"),  # half a float
        ("10 0ade 0002 04 0000 43fa", "90 03"),  # 500 °C
        ("10 0ade 0002 04 0000 7fc0", "90 03"),  # nan
        ("10 0ade 0002 03 0000 00", "90 03"),  # sizes that disagree
        ("03 0aea 0002", "03 04 003e 0000"),  # an enumeration and the register behind it
        ("04 0aea 0001", "04 02 003e"),
    ],
)
def test_refusals(emulator, request_pdu, reply_pdu):
    with connect(emulator) as client:
        assert ask_tcp(client, request_pdu) == bytes.fromhex(reply_pdu)


@f4t_tcp
def test_several_clients_at_once_and_one_after_another(emulator):
    wrong = []

    def client(value: float) -> None:
        words = struct.pack(">f", value)
        for number in range(1, 30):
            with connect(emulator) as link:
                for _ in range(2):
                    if ask_tcp(link, "03 0b04 0002", number)[:2] != b"\3\4":
                        wrong.append(number)
                pdu = f"10 0aee 0002 04 {words[2:].hex()} {words[:2].hex()}"
                if ask_tcp(link, pdu, number) != bytes.fromhex("10 0aee 0002"):
                    wrong.append(number)

    threads = [threading.Thread(target=client, args=(v,)) for v in (1.0, 2.0, 3.0)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []


@f4t_tcp
def test_garbage_on_tcp_costs_its_sender_the_connection_and_nobody_else(emulator):
    rng = random.Random(7)
    for _ in range(30):
        with connect(emulator) as client:
            client.sendall(rng.randbytes(rng.randint(1, 200)))
    with connect(emulator) as client:
        client.sendall(bytes.fromhex("0001 0000 00"))  # and half a frame, then gone
    with connect(emulator) as client:
        assert ask_tcp(client, "03 0aea 0001") == bytes.fromhex("03 02 003e")


@eurotherm_rtu_tcp
def test_rtu_finds_its_way_back_after_noise(emulator):
    rng = random.Random(8)
    with connect(emulator) as client:
        for _ in range(15):
            client.sendall(rng.randbytes(rng.randint(1, 40)))
            time.sleep(0.07)  # longer than a frame may pause: what was begun is given up
            client.sendall(READ_PV)
            heard = b""
            while not heard.endswith(PV):
                heard += client.recv(256)


@eurotherm_rtu_tcp
def test_rtu_takes_a_request_in_pieces_and_two_at_once(emulator):
    with connect(emulator) as client:
        for byte in READ_PV:
            client.sendall(bytes((byte,)))
        assert client.recv(256) == PV
        client.sendall(READ_PV * 2)
        heard = b""
        while len(heard) < 2 * len(PV):
            heard += client.recv(256)
        assert heard == PV * 2


@eurotherm_rtu_tcp
def test_other_units_and_broadcasts_are_not_answered(emulator):
    other = b"\2" + READ_PV[1:-2]
    everybody = bytes.fromhex("00 06 0002 0190")  # 40 °C
    with connect(emulator) as client:
        for body in (other, everybody):
            client.sendall(body + crc16(body).to_bytes(2, "little"))
        ask = bytes.fromhex("01 03 0002 0001")
        client.sendall(ask + crc16(ask).to_bytes(2, "little"))
        assert client.recv(256)[:5] == bytes.fromhex("01 03 02 0190")


@pytest.mark.parametrize("emulator", [("eurotherm_3504", "rtu")], indirect=True)
def test_a_dropped_pseudo_terminal_comes_back_under_its_path(emulator):
    path = emulator.url.removeprefix("modbus+rtu://")
    before = os.readlink(path)
    emulator._server._faults.inject("dropped_connection")
    port = os.open(path, os.O_RDWR | os.O_NOCTTY)
    os.write(port, READ_PV)
    deadline_s = time.monotonic() + 2
    while os.readlink(path) == before and time.monotonic() < deadline_s:
        time.sleep(0.005)
    os.close(port)
    port = os.open(path, os.O_RDWR | os.O_NOCTTY)
    os.write(port, READ_PV)
    heard = b""
    while len(heard) < len(PV):
        heard += os.read(port, 256)
    os.close(port)
    assert heard == PV


def test_random_bytes_never_break_the_framing_or_the_bank():
    rng = random.Random(9)
    clock = SteppedClock()
    for model in ("watlow_f4t", "watlow_f4", "eurotherm_3504"):
        emulator = ChamberEmulator(model, IdealPlant(), clock, FaultPlan([], "chamber", clock))
        for _ in range(1500):
            buffer = bytearray(rng.randbytes(rng.randint(0, 30)))
            take_rtu(buffer, idle=True)
            assert not buffer
            function = rng.choice((3, 6, 6, 6, 16, rng.randrange(256)))
            address = rng.choice((rng.randrange(65536), 4000, 4001, 4002, 4003, 1217, 300, 2782, 2))
            clock.sleep_until_s(clock.now_s() + 1)
            rest = struct.pack(">HH", address, rng.choice((1, 2, 3, 5, rng.randrange(65536))))
            reply = answer(emulator.controller, bytes((function,)) + rest)
            assert reply[0] in (function, function | 0x80)
