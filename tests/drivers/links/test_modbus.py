"""The link: what it takes for an answer, and what it says when there is none."""

import socket
import subprocess
import sys
import threading

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.emulators.modbus_frames import crc16
from drivers.errors import LinkError, ProtocolError
from drivers.links.barrier import Barrier
from drivers.links.modbus import BadReplyError, check_reply, parse_modbus_url
from drivers.links.modbus_link import ModbusLink, RefusalError
from drivers.station import LinkConfig

READ_TCP = bytes.fromhex("0009 0000 0006 01 03 0064 0002")
READ_RTU = bytes.fromhex("01 03 0064 0002")
READ_RTU += crc16(READ_RTU).to_bytes(2, "little")


def rtu(text: str) -> bytes:
    body = bytes.fromhex(text)
    return body + crc16(body).to_bytes(2, "little")


def test_crc_of_published_frames():
    # the check value of CRC-16/MODBUS, and the example frames of the maker's guide to exceptions
    assert crc16(b"123456789") == 0x4B37
    assert rtu("01 02 00 01 00 02") == bytes.fromhex("01 02 00 01 00 02 A8 0B")
    assert rtu("01 82 01") == bytes.fromhex("01 82 01 81 60")
    assert rtu("01 06 00 07 2E E0") == bytes.fromhex("01 06 00 07 2E E0 24 23")
    assert rtu("01 86 03") == bytes.fromhex("01 86 03 02 61")


@pytest.mark.parametrize(
    "reply", ["0009 0000 0007 01 03 04 0001 0002", "0009 0000 0003 01 83 02", "0009 0000 00", ""]
)
def test_answers_and_their_beginnings_pass(reply):
    check_reply(READ_TCP, bytes.fromhex(reply), rtu=False)


@pytest.mark.parametrize(
    ("reply", "wrong"),
    [
        ("0008 0000 0007 01 03 04 0001 0002", "another transaction"),
        ("0009 0001 0007 01 03 04 0001 0002", "another protocol"),
        ("0009 0000 0007 02 03 04 0001 0002", "another unit"),
        ("0009 0000 0007 01 04 04 0001 0002", "another function"),
        ("0009 0000 0005 01 03 02 0001", "another size"),
        ("0009 0000 0007 01 03 02 0001 0002", "another byte count"),
        ("0009 0000 0007 01 03 04 0001 0002 00", "a byte too many"),
        ("0009 0000 0003 01 84 02", "another function's exception"),
        ("ff", "noise"),
    ],
)
def test_what_is_no_answer_is_refused(reply, wrong):
    with pytest.raises(BadReplyError):
        check_reply(READ_TCP, bytes.fromhex(reply), rtu=False)


def test_rtu_answers_are_checked_to_the_crc():
    good = rtu("01 03 04 0001 0002")
    for size in range(len(good) + 1):
        check_reply(READ_RTU, good[:size], rtu=True)
    check_reply(READ_RTU, rtu("01 83 02"), rtu=True)
    for at in range(len(good)):
        for bit in range(8):
            spoiled = bytearray(good)
            spoiled[at] ^= 1 << bit
            with pytest.raises(BadReplyError):
                check_reply(READ_RTU, bytes(spoiled), rtu=True)


@settings(deadline=None)  # how busy the machine is proves nothing
@given(st.binary(max_size=300))
def test_no_bytes_break_the_check(reply):
    for request, kind in ((READ_TCP, False), (READ_RTU, True)):
        try:
            check_reply(request, reply, rtu=kind)
        except BadReplyError:
            pass
        else:
            assert len(reply) <= 13


@pytest.mark.parametrize(
    ("url", "expected"),
    [
        ("modbus+tcp://10.0.0.7:1502", ("tcp", "10.0.0.7", 1502)),
        ("modbus+tcp://chamber", ("tcp", "chamber", 502)),
        ("modbus+tcp://[::1]:502/", ("tcp", "::1", 502)),
        ("modbus+rtu+tcp://moxa:4001", ("rtu+tcp", "moxa", 4001)),
        ("modbus+rtu:///dev/ttyUSB0", ("rtu", "/dev/ttyUSB0", 0)),
    ],
)
def test_urls(url, expected):
    end = parse_modbus_url(url)
    assert (end.transport, end.host, end.port) == expected


@pytest.mark.parametrize(
    "url",
    ["", "tcp://a:1", "modbus+tcp://", "modbus+tcp://a:99999", "modbus+tcp://a:x", "modbus+rtu://",
     "modbus+rtu:///", "modbus+rtu://host:4001", "modbus+tcp://a/b", "modbus+tcp:///dev/ttyUSB0",
     "http://[", "serial:///dev/ttyUSB0"],
)  # fmt: skip
def test_urls_that_lead_nowhere(url):
    with pytest.raises(ValueError, match="expected modbus"):
        parse_modbus_url(url)


def link_to(url: str, **more) -> ModbusLink:
    config = LinkConfig(url=url, **({"timeout_s": 0.1, "retries": 1} | more))
    return ModbusLink(config, name="chamber", barrier=Barrier(address=0), before_write=lambda: None)


@pytest.fixture
def closed_port():
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    return port


@pytest.mark.parametrize("scheme", ["modbus+tcp", "modbus+rtu+tcp"])
def test_a_refused_connection_is_one_line_with_the_url(closed_port, scheme):
    url = f"{scheme}://127.0.0.1:{closed_port}"
    link = link_to(url)
    with pytest.raises(LinkError, match="refused") as caught:
        link.read(100, 1)
    assert url in str(caught.value)
    assert "\n" not in str(caught.value)
    assert (link.counters.retries, link.counters.exchanges) == (1, 0)


@pytest.mark.parametrize("path", ["/dev/no-such-port", "/dev/null", "/tmp"])
def test_a_path_that_is_no_serial_port(path):
    with pytest.raises(LinkError, match="cannot open modbus"):
        link_to(f"modbus+rtu://{path}").read(100, 1)


def test_a_closed_link_stays_closed(closed_port):
    link = link_to(f"modbus+tcp://127.0.0.1:{closed_port}")
    link.close()
    link.close()
    with pytest.raises(LinkError, match="was closed"):
        link.read(100, 1)


class OneReply:
    """A TCP peer that answers each connection's first question with fixed bytes."""

    def __init__(self, *replies: bytes) -> None:
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"modbus+tcp://127.0.0.1:{self.listener.getsockname()[1]}"
        self.heard: list[bytes] = []
        self.thread = threading.Thread(target=self.serve, args=(replies,), daemon=True)
        self.thread.start()

    def serve(self, replies) -> None:
        held = self.held = []
        for reply in replies:
            client, _ = self.listener.accept()
            held.append(client)
            self.heard.append(client.recv(256))
            if reply:
                client.sendall(reply)

    def __enter__(self):
        return self

    def __exit__(self, *_) -> None:
        self.thread.join(3)
        for client in self.held:
            client.close()
        self.listener.close()


def test_the_transaction_number_goes_on_over_a_new_link():
    late = bytes.fromhex("0001 0000 0005 01 03 02 0bad")
    good = bytes.fromhex("0003 0000 0005 01 03 02 600d")
    with OneReply(b"", late, good) as peer:
        link = link_to(peer.url, retries=2)
        assert link.read(100, 1) == (0x600D,)
        link.close()
    assert [heard[:2] for heard in peer.heard] == [b"\0\1", b"\0\2", b"\0\3"]
    assert (link.counters.timeouts, link.counters.bad_replies) == (1, 1)
    assert (link.counters.retries, link.counters.reconnects) == (2, 2)


def test_a_command_that_must_not_be_repeated_is_sent_once():
    with OneReply(b"") as peer:
        link = link_to(peer.url, retries=5)
        with pytest.raises(LinkError, match=r"no reply in 0\.1 s"):
            link.write(100, [1], repeatable=False)
        link.close()
    assert len(peer.heard) == 1
    assert link.counters.retries == 0


@pytest.mark.parametrize(
    ("code", "words"),
    [(1, "illegal function"), (2, "illegal data address"), (3, "illegal data value"),
     (4, "device failure"), (99, "unknown exception")],
)  # fmt: skip
def test_exceptions_are_told_in_words_and_not_repeated(code, words):
    with OneReply(bytes.fromhex("0001 0000 0003 01 83") + bytes((code,))) as peer:
        link = link_to(peer.url)
        with pytest.raises(RefusalError, match=words):
            link.read(100, 1, what="temperature")
        link.close()
    assert link.counters.retries == 0


def test_a_controller_without_function_6_is_written_to_with_16():
    refused = bytes.fromhex("0001 0000 0003 01 86 01")
    with OneReply(refused + b"") as peer:
        link = link_to(peer.url, retries=0)
        with pytest.raises(LinkError):  # the peer answers once only
            link.write(0x1234, [0x5678])
        link.close()
        assert peer.held[0].recv(256) == bytes.fromhex("0002 0000 0009 01 10 1234 0001 02 5678")


def test_half_a_reply_is_no_silence():
    with OneReply(bytes.fromhex("0001 0000 0005 01 03 02 0b")) as peer:
        link = link_to(peer.url, retries=0)
        with pytest.raises(ProtocolError, match="not complete"):
            link.read(100, 1)
        link.close()


def test_the_library_says_nothing_on_stderr(closed_port):
    program = (
        "import logging; logging.basicConfig(level=logging.DEBUG)\n"
        "from drivers.links.modbus_link import ModbusLink\n"
        "from drivers.chambers.maps import Barrier\n"
        "from drivers.station import LinkConfig\n"
        "import socket\n"
        "mute = socket.create_server(('127.0.0.1', 0))\n"
        "url = 'modbus+tcp://127.0.0.1:%d' % mute.getsockname()[1]\n"
        "config = LinkConfig(url=url, timeout_s=0.05, retries=0)\n"
        "link = ModbusLink(config, name='x', barrier=Barrier(address=0), before_write=list)\n"
        "try: link.read(1, 1)\n"
        "except Exception as e: print(type(e).__name__)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout.strip() == "LinkError"
    assert done.stderr == ""
