"""Replies and checks of the ESP301's tests."""

from drivers.devices import IndexingHead

FAULTS_OF_A_CONNECTION = ("dropped_connection", "late_reply")  # they differ with the port
NO_ERROR = b"0, 451322, NO ERROR DETECTED\r\n"
VERSION = "ESP301 Version 3.0.1 6/1/99"
RESOLUTION_DEG = 5.1e-6  # five decimals are sent


def satisfies(device: IndexingHead) -> IndexingHead:
    return device


def settle(bench, head) -> None:
    bench.wait(60.0)
    assert not head.is_moving()
