"""The serial link: questions, fences, repeats, lines that nobody asked for."""

import time

import pytest

from drivers.clock import SteppedClock
from drivers.emulators.faults import FaultPlan
from drivers.emulators.serial_server import SerialServer
from drivers.errors import DeviceError, LinkError, ProtocolError
from tests.drivers.links.scripted_port import FENCE, Flood, Script, ask, link_to


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


def test_a_line_that_never_ends_is_given_up():
    server = SerialServer("socket://127.0.0.1:0", Flood(), FaultPlan([], "head", SteppedClock()))
    server.start()
    link = link_to(server.url, timeout_s=5.0, retries=0)
    with pytest.raises(ProtocolError, match="without a line end"):
        ask(link, "A?")
    link.close()
    server.close()
