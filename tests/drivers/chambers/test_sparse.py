"""Controllers with hardly a register: what the maps call optional refused with exception 2.

The loops here were written apart from the emulators, and know nothing but a set point that goes
somewhere at a rate.
"""

import math
import socket
import struct
import threading
import time

import pytest

from drivers.chambers.open import open_chamber
from drivers.errors import DeviceError, ProtocolError
from drivers.station import ChamberConfig


def floats(value: float) -> list[int]:
    high, low = struct.unpack(">HH", struct.pack(">f", value))
    return [low, high]


def from_floats(words: list[int]) -> float:
    return struct.unpack(">f", struct.pack(">HH", words[1], words[0]))[0]


class Course:
    """A set point on its way."""

    def __init__(self) -> None:
        self.minute = self.since = 0.0
        self.start = self.target = 23.0
        self.rate = math.inf

    def now(self) -> float:
        way = self.target - self.start
        done = math.inf if math.isinf(self.rate) else self.rate * (self.minute - self.since)
        return self.target if done >= abs(way) else self.start + math.copysign(done, way)

    def go(self, target: float, rate: float) -> None:
        self.start, self.since, self.target, self.rate = self.now(), self.minute, target, rate


class SparseF4T:
    """Temperature, set point, its limits, ramp and control mode, and nothing else."""

    model = "watlow_f4t"
    confirmed = "Modbus in °C"

    def __init__(self) -> None:
        self.course = Course()
        self.kept = {2730: [10], 2794: [62], 2796: [57], 2798: floats(1.0)}

    def read(self, address: int) -> list[int] | None:
        shown = {2820: self.course.now(), 2782: self.course.target, 2774: -70.0, 2776: 180.0}
        return floats(shown[address]) if address in shown else self.kept.get(address)

    def write(self, address: int, words: list[int]) -> bool:
        if address == 2782:
            ramps = self.kept[2794] != [62]
            self.course.go(from_floats(words), from_floats(self.kept[2798]) if ramps else math.inf)
        elif address in self.kept:
            self.kept[address] = words
            if self.kept[2794] == [62]:
                self.course.go(self.course.target, math.inf)
        return address == 2782 or address in self.kept


class Sparse3504:
    """Registers 1, 2, 5, 35 and 75, and cells that keep what is written and mean nothing."""

    model = "eurotherm_3504"
    confirmed = "decimals = 1, °C"

    def __init__(self, idle_cells: tuple[int, ...] = ()) -> None:
        self.course = Course()
        self.rate = 0
        self.idle = dict.fromkeys(idle_cells, 0)

    def read(self, address: int) -> list[int] | None:
        now, target = round(10 * self.course.now()), round(10 * self.course.target)
        shown = {1: now, 2: target, 5: now, 35: self.rate, 75: 0} | self.idle
        return [shown[address] & 0xFFFF] if address in shown else None

    def write(self, address: int, words: list[int]) -> bool:
        if address == 35:
            self.rate = words[0]
        if address in (2, 35):
            raw = words[0] - 0x10000 if words[0] > 0x7FFF else words[0]
            target = raw / 10 if address == 2 else self.course.target
            self.course.go(target, self.rate / 10 or math.inf)
        elif address in self.idle:
            self.idle[address] = words[0]
        return address in (2, 35) or address in self.idle


class Server:
    """A Modbus TCP server for one client at a time, with manners of its own."""

    def __init__(self, bank, *, delay_s=0.0, closes=False, unit=None) -> None:
        self.bank, self.delay_s, self.closes, self.unit = bank, delay_s, closes, unit
        self.refused_once: set[int] = set()  # addresses to be refused before they are answered
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"modbus+tcp://127.0.0.1:{self.listener.getsockname()[1]}"
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def run(self) -> None:
        while True:
            try:
                client, _ = self.listener.accept()
            except OSError:
                return
            with client, client.makefile("rb") as stream:
                while head := stream.read(7):
                    reply = self.answer(stream.read(int.from_bytes(head[4:6], "big") - 1))
                    time.sleep(self.delay_s)
                    unit = head[6] if self.unit is None else self.unit
                    size = (len(reply) + 1).to_bytes(2, "big")
                    client.sendall(head[:4] + size + bytes([unit]) + reply)
                    if self.closes:
                        break

    def answer(self, pdu: bytes) -> bytes:
        function, address = pdu[0], int.from_bytes(pdu[1:3], "big")
        if address in self.refused_once:
            self.refused_once.remove(address)
            return bytes([function | 0x80, 2])
        if function == 3:
            words = self.bank.read(address)
            if words is None or len(words) != int.from_bytes(pdu[3:5], "big"):
                return b"\x83\x02"
            return bytes([3, 2 * len(words)]) + struct.pack(f">{len(words)}H", *words)
        data = pdu[3:5] if function == 6 else pdu[6:]
        taken = self.bank.write(address, list(struct.unpack(f">{len(data) // 2}H", data)))
        return pdu[:5] if taken else bytes([function | 0x80, 2])

    def close(self) -> None:
        self.listener.shutdown(socket.SHUT_RDWR)
        self.listener.close()
        self.thread.join(5)


@pytest.fixture
def serve():
    """Return a function that opens a chamber on a bank of registers."""
    opened = []

    def make(bank, **manners):
        server = Server(bank, **manners)
        config = ChamberConfig(
            model=bank.model, url=server.url, timeout_s=2.0, confirmed=bank.confirmed
        )
        chamber = open_chamber(config)
        opened.extend((chamber, server))
        return chamber, server

    yield make
    for one in opened:
        one.close()


BANKS = {
    "F4T": SparseF4T,
    "3504": Sparse3504,
    "3504 with cells that mean nothing": lambda: Sparse3504((78, 273, 276, 5195)),
}


@pytest.fixture(params=BANKS)
def bank(request):
    return BANKS[request.param]()


@pytest.mark.parametrize("manners", [{}, {"closes": True}, {"delay_s": 0.01}], ids=str)
def test_it_goes_where_it_is_sent_at_the_rate_it_is_given(serve, bank, manners):
    chamber, _ = serve(bank, **manners)
    assert "23 °C" in chamber.identify()
    assert chamber.read_alarms() == ()
    chamber.hold_temp_c(30.0)
    assert bank.course.now() == 30.0
    assert chamber.read_setpoint_c() == chamber.read_temp_c() == 30.0
    for target, rate in ((40.0, 1.0), (-20.5, 2.0)):  # the second on the way of the first
        start = bank.course.now()
        chamber.ramp_to_c(target, rate)
        bank.course.minute += 3.0
        assert bank.course.now() == pytest.approx(start + math.copysign(3 * rate, target - start))
    result = chamber.make_safe(25.0)
    assert result.verified, result.steps
    assert bank.course.now() == 25.0, "at once: no ramp is left"


def test_what_is_missing_is_logged_once(serve, caplog):
    chamber, _ = serve(Sparse3504())
    chamber.identify()
    for _ in range(3):
        chamber.hold_temp_c(30.0)
    for name in ("ramp_disable", "control_mode", "remote_select", "program_state"):
        told = [r for r in caplog.records if name in r.getMessage() and "without" in r.getMessage()]
        assert len(told) == 1


def test_a_moving_set_point_without_a_register_is_not_guessed(serve):
    chamber, _ = serve(SparseF4T())
    chamber.identify()
    chamber.ramp_to_c(40.0, 1.0)
    with pytest.raises(DeviceError, match="no register here tells the set point"):
        chamber.read_setpoint_c()
    assert chamber.read_temp_c() == 23.0


def test_a_single_refusal_does_not_make_a_register_missing(serve):
    chamber, server = serve(Sparse3504((78, 273)))
    server.refused_once = {78}
    assert "ramp_disable" in chamber.read_settings()
    server.refused_once = {78}  # known to be there by now
    with pytest.raises(DeviceError, match="ramp_disable at 78: refused with exception 2"):
        chamber.read_settings()
    assert "ramp_disable" in chamber.read_settings()


def test_making_safe_asks_again_for_what_was_missing(serve):
    bank = Sparse3504()
    chamber, _ = serve(bank)
    assert "control_mode" not in chamber.read_settings()
    bank.idle[273] = 1  # manual: it was there after all
    result = chamber.make_safe(25.0)
    assert result.verified, result.steps
    assert bank.idle[273] == 0


def test_an_answer_of_another_unit_is_none(serve, bank):
    chamber, _ = serve(bank, unit=9)
    with pytest.raises(ProtocolError, match="unit 9 answered, expected 1"):
        chamber.read_temp_c()
    assert not chamber.make_safe(25.0).verified
