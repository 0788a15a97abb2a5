"""Channels and checks of the 34970A's tests."""

import pytest

from drivers.devices import Digitiser, ScanChannel

VOLT = ScanChannel(number=101, quantity="voltage", full_scale=10.0)
VOLT2 = ScanChannel(number=203, quantity="voltage", full_scale=3.0)
OHM = ScanChannel(number=111, quantity="resistance", full_scale=400e3)
CHANNELS = (OHM, VOLT2, VOLT)  # not the order they are scanned in
TIMEOUT_S = 0.08
FAULTS_OF_A_CONNECTION = ("dropped_connection", "late_reply")  # they differ with the port
NO_ERROR = b'+0,"No error"\r\n'
IDENTITY = b"HEWLETT-PACKARD,34970A,0,13-2-2\r\n"


def satisfies(device: Digitiser) -> Digitiser:
    return device


def expected_value(bench, channel: ScanChannel, offset_s: float) -> float:
    return bench.plant.channel_value(bench.clock.now_s() + offset_s, channel.number)


def check_scan(bench, readings) -> None:
    """Each reading is of its own channel and of its own time, to the digits sent."""
    assert [r.channel for r in readings] == [c.number for c in CHANNELS]
    for channel, reading in zip(CHANNELS, readings, strict=True):
        assert reading.ok
        # nine digits are sent
        assert reading.value == pytest.approx(
            expected_value(bench, channel, reading.offset_s), rel=2e-9
        )
