"""Beats that a service manager hears."""

import os
import signal
import socket
import time

import pytest

from drivers.devices import SafeResult
from tests.thermo.station.processes.guard_bench import running, until


def test_a_service_manager_hears_a_sitting_s_beats(bench, sitting, tmp_path, monkeypatch):
    where = str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(where)
        manager.settimeout(30)
        monkeypatch.setenv("NOTIFY_SOCKET", where)
        monkeypatch.setenv("WATCHDOG_USEC", "1000")
        sitting.start("T", {}, tmp_path / "g.json")
        sitting.beat()
        assert manager.recv(4096) == b"READY=1\nSTATUS=test T"
        assert manager.recv(4096) == b"WATCHDOG=1"
        sitting.end(SafeResult(verified=True, steps=()))


@pytest.mark.slow
def test_a_service_manager_hears_the_test_begin_and_its_heart(bench, tmp_path):
    where = str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(where)
        manager.settimeout(60)
        with running(bench, NOTIFY_SOCKET=where) as controller:
            assert manager.recv(4096).startswith(b"READY=1")
            for _ in range(3):
                assert manager.recv(4096) == b"WATCHDOG=1"
            os.kill(controller.process.pid, signal.SIGSTOP)
            until(controller.is_stopped)
            manager.setblocking(False)
            with pytest.raises(BlockingIOError):  # noqa: PT012
                while True:  # what was sent before
                    manager.recv(4096)
            time.sleep(2 * 0.5)  # two beats' time
            with pytest.raises(BlockingIOError):
                manager.recv(4096)
