"""The link itself, and the port server it is tried against."""

import os
import re
import time

import pytest

from drivers.clock import SteppedClock
from drivers.emulators.faults import FaultPlan
from drivers.emulators.pseudo_terminal import PseudoTerminal
from drivers.emulators.serial_server import SerialServer
from drivers.errors import DeviceError, LinkError, ProtocolError
from drivers.links.serial_link import SerialLink


class Script:
    """Replies by question, used up one by one, the last for ever."""

    def __init__(self, replies):
        self.replies = replies

    def respond(self, line):
        answers = self.replies[line]
        return answers.pop(0) if len(answers) > 1 else answers[0]

    def refuse(self):
        pass


FENCE = ("WHO?", re.compile("me"))


def link_to(url, **more):
    settings = {"name": "probe", "baud": 9600, "timeout_s": 0.2, "retries": 1, "fences": [FENCE]}
    return SerialLink(url, **(settings | more))


def ask(link, question, **more):
    def exchange():
        link.send(question)
        return link.receive()

    return link.transact(question, exchange, **more)


@pytest.mark.parametrize(
    "url",
    [
        "",
        "/dev/ttyUSB0",
        "serial://",
        "serial://dev/ttyUSB0",
        "socket://localhost",
        "socket://localhost:99999",
        "socket://:5025",
        "socket://[::1:5025",
        "http://localhost:80",
        "modbus+tcp://127.0.0.1:502",
    ],
)
def test_urls_that_lead_nowhere_are_refused_in_a_line(url):
    with pytest.raises(LinkError, match="expected serial:///dev/") as caught:
        link_to(url)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("url", ["serial:///no/such/port", "socket://127.0.0.1:1"])
def test_a_port_that_is_not_there_fails_at_once(url):
    started = time.monotonic()
    with pytest.raises(LinkError, match="cannot be opened") as caught:
        link_to(url, timeout_s=5.0).open()
    assert "\n" not in str(caught.value)
    assert time.monotonic() - started < 2.0


def test_a_port_that_is_no_serial_port_is_refused(tmp_path):
    file = tmp_path / "notes"
    file.write_text("no port")
    with pytest.raises(LinkError, match="cannot be opened"):
        link_to(f"serial://{file}").open()


def test_two_links_cannot_share_a_port(scripted):
    port = scripted({"WHO?": ["me"]})
    first = link_to(port.url)
    first.open()
    with pytest.raises(LinkError, match="lock"):
        link_to(port.url).open()
    first.close()


def test_nothing_is_sent_by_opening_and_closing(scripted):
    port = scripted({})
    link = link_to(port.url)
    link.open()
    link.close()
    link.close()
    assert port.sent == []


def test_first_question_is_the_fence(scripted):
    port = scripted({"WHO?": ["me"], "A?": ["1"]})
    link = link_to(port.url)
    assert ask(link, "A?") == "1"
    assert ask(link, "A?") == "1"
    assert port.sent == ["WHO?", "A?", "A?"]
    link.close()


def test_the_second_fence_is_tried_when_the_first_is_not_understood(scripted):
    port = scripted({"AGAIN?": ["me"], "A?": ["1"]})
    link = link_to(port.url, fences=[FENCE, ("AGAIN?", FENCE[1])], timeout_s=0.1)
    assert ask(link, "A?") == "1"
    assert port.sent == ["WHO?", "AGAIN?", "A?"]
    link.close()


def test_an_interrupted_exchange_leaves_the_link_out_of_step(scripted):
    """Ctrl-C between question and answer: what is asked while shutting down gets its own answer."""
    port = scripted({"WHO?": ["me"], "A?": ["stale"], "B?": ["fresh"]})
    link = link_to(port.url)

    def interrupted():
        link.send("A?")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        link.transact("A?", interrupted)
    assert ask(link, "B?", retries=0) == "fresh"
    assert port.sent == ["WHO?", "A?", "WHO?", "B?"]
    link.close()


def test_a_question_that_must_not_be_repeated_is_not(scripted):
    port = scripted({"WHO?": ["me"], "GO": [None]})
    link = link_to(port.url, timeout_s=0.05)
    with pytest.raises(LinkError):
        ask(link, "GO", retries=0)
    assert port.sent.count("GO") == 1
    assert link.counters.retries == 0
    link.close()


def test_every_repeated_question_is_logged_and_counted(scripted, caplog):
    port = scripted({"WHO?": ["me"], "A?": [None, None, "1"]})
    link = link_to(port.url, timeout_s=0.2, retries=3)
    assert ask(link, "A?") == "1"
    assert link.counters.retries == link.counters.timeouts == link.counters.reconnects == 2
    assert link.counters.by_command["A?"] == 3
    assert link.counters.last_fault.startswith("A?: ")
    assert sum("asking again" in r.getMessage() for r in caplog.records) == 2
    link.close()


def test_a_refusal_is_passed_on_without_dropping_the_link(scripted):
    port = scripted({"WHO?": ["me"], "A?": ["1"]})
    link = link_to(port.url)

    def refuse():
        ask_once = ask(link, "A?")
        raise DeviceError(f"no, {ask_once}")

    with pytest.raises(DeviceError):
        link.transact("X", refuse)
    assert link.counters.reconnects == 0
    assert ask(link, "A?") == "1"
    link.close()


@pytest.mark.parametrize(
    "reply", ["gar\tbled", "de\x7fl", "nul\x00"], ids=["control", "delete", "nul"]
)
def test_control_characters_are_no_answer(scripted, reply):
    port = scripted({"WHO?": ["me"], "A?": [reply, "1"]})
    link = link_to(port.url)
    with pytest.raises(ProtocolError, match="garbled"):
        ask(link, "A?", retries=0)
    assert ask(link, "A?") == "1"
    link.close()


def test_empty_lines_are_passed_over(scripted):
    port = scripted({"WHO?": ["me"], "A?": ["\r\n\r\n1"]})
    link = link_to(port.url)
    assert ask(link, "A?") == "1"
    link.close()


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\n\r", b"\r\r\n"], ids=repr)
@pytest.mark.parametrize("url", ["serial://auto", "socket://127.0.0.1:0"])
def test_ends_of_lines_that_others_send(url, end):
    replies = Script({"WHO?": ["me"], "A?": ["1", "2"]})
    server = SerialServer(url, replies, FaultPlan([], "head", SteppedClock()), reply_end=end)
    server.start()
    link = link_to(server.url, timeout_s=2.0)
    assert [ask(link, "A?"), ask(link, "A?"), ask(link, "A?")] == ["1", "2", "2"]
    assert link.counters.retries == 0
    link.close()
    server.close()


def test_a_lone_carriage_return_is_told_of():
    replies = Script({"WHO?": ["me"]})
    faults = FaultPlan([], "head", SteppedClock())
    server = SerialServer("serial://auto", replies, faults, reply_end=b"\r")
    server.start()
    link = link_to(server.url, retries=0)
    with pytest.raises(LinkError, match=r"only b'me\\r' without a line feed"):
        ask(link, "A?")
    link.close()
    server.close()


def test_what_clears_an_instrument_is_a_line_of_its_own(scripted):
    """One that does not know the clearing byte must still understand the fence after it."""
    port = scripted({"WHO?": [None, "me"], "A?": ["1"]})
    link = link_to(port.url, timeout_s=0.1, retries=3, clear=b"\x02")
    assert ask(link, "A?") == "1"
    assert port.sent == ["WHO?", "\x02", "WHO?", "A?"]
    link.close()


def test_a_line_nobody_asked_for_is_noticed_before_the_next_question(scripted):
    port = scripted({"WHO?": ["me"], "A?": ["1\r\n2", "3"]})
    link = link_to(port.url, retries=1)
    assert ask(link, "A?") == "1"
    time.sleep(0.02)  # real: the second line is on its way
    assert ask(link, "A?") == "3"
    assert link.counters.bad_replies == 1
    link.close()


class Flood:
    """Answers one question with a line that never ends."""

    def respond(self, line):
        return "x" * 70_000 if line == "A?" else "me"

    def refuse(self):
        pass


def test_a_line_that_never_ends_is_given_up():
    server = SerialServer("socket://127.0.0.1:0", Flood(), FaultPlan([], "head", SteppedClock()))
    server.start()
    link = link_to(server.url, timeout_s=5.0, retries=0)
    with pytest.raises(ProtocolError, match="without a line end"):
        ask(link, "A?")
    link.close()
    server.close()


# ---- unplugging


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
