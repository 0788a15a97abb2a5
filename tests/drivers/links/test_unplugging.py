"""A serial port unplugged and plugged in, and the port server that the tests use."""

import os
import time

import pytest

from drivers.clock import SteppedClock
from drivers.emulators.faults import FaultPlan
from drivers.emulators.pseudo_terminal import PseudoTerminal
from drivers.emulators.serial_server import SerialServer
from drivers.errors import LinkError
from tests.drivers.links.scripted_port import Flood, ask, link_to


def test_a_line_put_in_anothers_place_leads_somewhere_at_every_moment(tmp_path, monkeypatch):
    line = PseudoTerminal(tmp_path / "tty")
    close, led_somewhere = os.close, []

    def close_and_look(end):
        close(end)
        led_somewhere.append(line.path.exists())

    with monkeypatch.context() as patched:
        patched.setattr(os, "close", close_and_look)
        line.replace()
    line.close()
    assert led_somewhere == [True, True]


def unplug(server) -> str:
    """Pull the cable: the link stays, what it led to is gone."""
    pty = server._pty
    server._forget(pty)
    pty.hang_up()
    return str(pty.path)


def test_an_unplugged_port_is_a_link_error_and_plugging_in_heals_it(scripted):
    port = scripted({"WHO?": ["me"], "A?": ["1"]})
    link = link_to(port.url, timeout_s=0.1)
    assert ask(link, "A?") == "1"
    unplug(port.server)
    with pytest.raises(LinkError) as caught:
        ask(link, "A?")
    assert "\n" not in str(caught.value)
    with pytest.raises(LinkError, match="cannot be opened"):
        ask(link, "A?")
    port.server._pty.replace()
    port.server._remember(port.server._pty)
    port.server._wake()
    assert ask(link, "A?") == "1"
    assert link.counters.reconnects >= 1
    link.close()


def test_a_port_unplugged_while_waiting_for_the_answer(scripted):
    port = scripted({"WHO?": ["me"], "A?": [None]})
    link = link_to(port.url, timeout_s=5.0, retries=0)
    respond = port.script.respond

    def pull(line):
        if line == "A?":
            unplug(port.server)
        return respond(line)

    port.script.respond = pull
    started = time.monotonic()
    with pytest.raises(LinkError, match="port is gone"):
        ask(link, "A?")
    assert time.monotonic() - started < 2.0, "a dead port is noticed before the time limit"
    link.close()


def test_a_server_that_goes_away_and_comes_back():
    class Me:
        def respond(self, line):
            return "me"

        def refuse(self):
            pass

    faults = FaultPlan([], "head", SteppedClock())
    server = SerialServer("socket://127.0.0.1:0", Me(), faults)
    server.start()
    link = link_to(server.url, timeout_s=0.2)
    assert ask(link, "A?") == "me"
    address = server.url
    server.close()
    with pytest.raises(LinkError):
        ask(link, "A?")
    again = SerialServer(address, Me(), faults)
    again.start()
    assert ask(link, "A?") == "me"
    link.close()
    again.close()


# ---- the port server


def test_link_is_made_where_asked_and_removed_again(tmp_path):
    path = tmp_path / "bus" / "meter"
    server = SerialServer(f"serial://{path}", Flood(), FaultPlan([], "head", SteppedClock()))
    server.start()
    assert server.url == f"serial://{path}"
    assert os.path.realpath(path).startswith("/dev/pts/")
    server.close()
    server.close()
    assert not path.is_symlink()


def test_link_left_by_a_killed_emulator_is_replaced_but_a_file_is_not(tmp_path):
    path = tmp_path / "meter"
    path.symlink_to("/dev/pts/no-such")
    server = SerialServer(f"serial://{path}", Flood(), FaultPlan([], "head", SteppedClock()))
    server.start()
    assert path.exists()
    server.close()
    path.write_text("precious")
    with pytest.raises(FileExistsError):
        server.start()
    assert path.read_text() == "precious"


def test_a_taken_address_is_refused():
    faults = FaultPlan([], "head", SteppedClock())
    first = SerialServer("socket://127.0.0.1:0", Flood(), faults)
    first.start()
    second = SerialServer(first.url, Flood(), faults)
    with pytest.raises(OSError, match="in use"):
        second.start()
    first.close()


@pytest.mark.parametrize("url", ["", "serial://", "socket://host", "modbus+tcp://127.0.0.1:0"])
def test_server_urls_of_no_known_kind(url):
    with pytest.raises(ValueError, match="expected serial:///path"):
        SerialServer(url, Flood(), FaultPlan([], "head", SteppedClock()))
