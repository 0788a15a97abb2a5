"""The drivers against a server nobody here wrote: pymodbus's own, with a block of registers."""

import asyncio
import struct
import threading

import pytest
from pymodbus.framer import FramerType
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from drivers.chambers import watch as chamber_watch
from drivers.chambers.open import open_chamber
from drivers.errors import DeviceError, LimitError, RecognitionError
from drivers.station import ChamberConfig


def low_first(value: float) -> list[int]:
    high, low = struct.unpack(">HH", struct.pack(">f", value))
    return [low, high]


PREFILLED = {
    "watlow_f4t": {
        1328: [15], 2730: [10], 2774: low_first(-70.0), 2776: low_first(180.0),
        2782: low_first(23.0),
        2794: [62], 2796: [57], 2798: low_first(1.0), 2810: low_first(23.0),
        2820: low_first(-12.5), 16568: [61],
    },
    "watlow_f4": {
        100: [-125 & 0xFFFF], 200: [1], 300: [230], 602: [-700 & 0xFFFF], 603: [1800], 606: [1],
        901: [1], 1218: [40],
    },
    "eurotherm_3504": {1: [-125 & 0xFFFF], 2: [230], 5: [230], 78: [1], 5195: [1]},
}  # fmt: skip


CONFIRMED = {"eurotherm_3504": "decimals = 1, °C"}  # no floats there that would show it
WORKING = {2782: 2810, 2: 5}  # what the loop goes by follows the set point where it is written


async def follow(function, start, address, count, registers, values) -> None:
    """Do on a write what is all that these loops do."""
    if values and address in WORKING:
        at = WORKING[address] - start
        registers[at : at + count] = values


class ForeignServer:
    """pymodbus's server in a thread of its own."""

    def __init__(self, registers: dict[int, list[int]], framer: FramerType, action=follow) -> None:
        values = [0] * max(5300, *(address + 100 for address in registers), 0)
        for address, words in registers.items():
            values[address : address + len(words)] = words
        self.device = SimDevice(
            id=1,
            simdata=[SimData(0, values=values, datatype=DataType.REGISTERS)],
            action=action,
        )
        self.framer = framer
        self.started = threading.Event()
        self.loop = asyncio.new_event_loop()
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()
        assert self.started.wait(5)

    def run(self) -> None:
        asyncio.set_event_loop(self.loop)
        self.loop.run_until_complete(self.serve())
        self.loop.close()

    async def serve(self) -> None:
        self.server = ModbusTcpServer(self.device, framer=self.framer, address=("127.0.0.1", 0))
        await self.server.serve_forever(background=True)
        self.port = self.server.transport.sockets[0].getsockname()[1]
        self.over = asyncio.Event()
        self.started.set()
        await self.over.wait()
        await self.server.shutdown()

    def close(self) -> None:
        self.loop.call_soon_threadsafe(self.over.set)
        self.thread.join(5)
        assert not self.thread.is_alive()


@pytest.fixture(params=["modbus+tcp", "modbus+rtu+tcp"])
def scheme(request):
    return request.param


@pytest.fixture(params=sorted(PREFILLED))
def chamber(request, scheme):
    framer = FramerType.SOCKET if scheme == "modbus+tcp" else FramerType.RTU
    server = ForeignServer(PREFILLED[request.param], framer)
    url = f"{scheme}://127.0.0.1:{server.port}"
    config = ChamberConfig(model=request.param, url=url, confirmed=CONFIRMED.get(request.param))
    chamber = open_chamber(config)
    yield chamber
    chamber.close()
    server.close()


def test_reads_holds_and_makes_safe(chamber):
    assert "-12.5 °C" in chamber.identify()
    assert chamber.read_temp_c() == -12.5
    assert chamber.read_setpoint_c() == 23.0
    assert chamber.read_alarms() == ()
    chamber.hold_temp_c(-40.5)
    result = chamber.make_safe(25.0)
    assert result.verified, result.steps
    assert chamber.counters.retries == 0
    with pytest.raises(LimitError):
        chamber.hold_temp_c(86.0)


def test_ramps_where_registers_alone_make_a_ramp(chamber):
    if "F4," in chamber.identify():
        with pytest.raises(DeviceError, match="create had no effect"):
            chamber.ramp_to_c(30.0, 1.0)
    else:
        chamber.ramp_to_c(30.0, 1.0)
        assert chamber.read_settings()["ramp_rate"] == 1.0
    assert chamber.make_safe(25.0).verified


@pytest.mark.parametrize("model", ["watlow_f4t", "eurotherm_3504"])
def test_a_loop_that_goes_by_another_set_point_is_not_safe(model, monkeypatch):
    """Every register takes what it is told, and the loop goes on elsewhere all the same."""
    monkeypatch.setattr(chamber_watch, "FOLLOW_S", 0.05)
    server = ForeignServer(PREFILLED[model], FramerType.SOCKET, action=None)
    url = f"modbus+tcp://127.0.0.1:{server.port}"
    confirmed = CONFIRMED.get(model)
    chamber = open_chamber(ChamberConfig(model=model, url=url, confirmed=confirmed))
    try:
        result = chamber.make_safe(25.0)
        assert not result.verified
        assert "goes by 23 °C, expected 25 °C" in result.steps[-1]
    finally:
        chamber.close()
        server.close()


def test_a_server_of_zeros_is_not_taken_for_a_chamber_that_obeys():
    """It reads 0 °C and says so; nothing about it is an exception of another kind."""
    server = ForeignServer({}, FramerType.SOCKET)
    url = f"modbus+tcp://127.0.0.1:{server.port}"
    chamber = open_chamber(ChamberConfig(model="watlow_f4", url=url))
    try:
        with pytest.raises(RecognitionError, match="works in °F"):
            chamber.identify()
        with pytest.raises(RecognitionError):
            chamber.ramp_to_c(30.0, 1.0)
    finally:
        chamber.close()
        server.close()
