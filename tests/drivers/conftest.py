"""Emulated serial instruments, a plant to put them on, and a wire with a script."""

import contextlib
import socket
import threading
from collections.abc import Iterator

import pytest

from drivers.clock import SteppedClock
from drivers.digitisers.keysight_34970a import ScanningMultimeter
from drivers.emulators.faults import FaultPlan
from drivers.emulators.motion import HeadEmulator
from drivers.emulators.multimeter import MultimeterEmulator
from drivers.emulators.serial_server import SerialServer
from drivers.heads.newport_esp301 import MotionHead
from drivers.station import DigitiserConfig, HeadConfig

TIMEOUT_S = 0.08
RETRIES = 5  # so many that a busy machine does not use them up
LATE_S = 0.3  # later than any question here waits, a scan's 0.04 s per channel included


class BenchPlant:
    """Air at the set point, a head of constant speed, voltages that tell channel and time."""

    def __init__(self) -> None:
        self.air_c = 25.0
        self.open_channels: set[int] = set()
        self._move = (0.0, 0.0, 0.0, 1.0)  # since, from, to, speed
        self._lock = threading.Lock()

    def drive_chamber(
        self, now_s: float, start_c: float, target_c: float, rate_c_per_s: float
    ) -> None:
        self.air_c = target_c

    def break_away(self, now_s: float, rate_c_per_s: float | None) -> None:
        pass

    def air_temp_c(self, now_s: float) -> float:
        return self.air_c

    def turn_head(self, now_s: float, target_deg: float, speed_deg_per_s: float) -> None:
        here = self.head_deg(now_s)
        with self._lock:
            self._move = (now_s, here, target_deg, speed_deg_per_s)

    def stop_head(self, now_s: float) -> None:
        here = self.head_deg(now_s)
        with self._lock:
            self._move = (now_s, here, here, 1.0)

    def head_deg(self, now_s: float) -> float:
        since, here, to, speed = self._move
        way = min(abs(to - here), speed * max(now_s - since, 0.0))
        return here + way if to > here else here - way

    def head_is_moving(self, now_s: float) -> bool:
        return self.head_deg(now_s) != self._move[2]

    def channel_value(self, now_s: float, channel: int) -> float:
        """Return channel/100 V plus 1e-4 V/s, or 100 times the channel in ohm for thermistors."""
        if channel in self.open_channels:
            return float("inf")
        return channel / 100.0 + 1e-4 * (now_s % 1e4) if channel % 100 <= 10 else 100.0 * channel


class SerialBench:
    """One emulated instrument, its driver and what they live in."""

    def __init__(self, kind: str, url: str, *, late_s: float = LATE_S) -> None:
        self.clock = SteppedClock(50.0)
        self.plant = BenchPlant()
        self.faults = FaultPlan([], kind, self.clock, late_s=late_s)
        made = {"digitiser": MultimeterEmulator, "head": HeadEmulator}[kind]
        self.emulator = made(self.plant, self.clock, self.faults, url=url)
        self.emulator.start()
        self.opened: list[ScanningMultimeter | MotionHead] = []
        self.kind = kind

    def open(self, **more):
        settings = {"url": self.emulator.url, "timeout_s": TIMEOUT_S, "baud": 115200}
        settings |= {"retries": RETRIES} | more
        if self.kind == "digitiser":
            device = ScanningMultimeter(DigitiserConfig(**settings), clock=self.clock)
        else:
            device = MotionHead(HeadConfig(**settings))
        self.opened.append(device)
        return device

    def wait(self, seconds: float) -> None:
        self.clock.sleep_until_s(self.clock.now_s() + seconds)

    def close(self) -> None:
        for device in self.opened:
            device.close()
        self.emulator.close()


class Script:
    """A responder that knows its replies beforehand and keeps what it was sent.

    `replies` maps a line to its replies, used up one by one, the last for ever; None is silence.
    Lines that are not in it are answered with nothing.
    """

    def __init__(self, replies: dict[str, list[str | None]]) -> None:
        self.replies = {line: list(answers) for line, answers in replies.items()}
        self.sent: list[str] = []

    def respond(self, line: str) -> str | None:
        self.sent.append(line)
        answers = self.replies.get(line)
        if not answers:
            return None
        return answers.pop(0) if len(answers) > 1 else answers[0]

    def refuse(self) -> None:
        raise AssertionError("a script refuses by what it replies")


class ScriptedPort:
    """A script on a pseudo-terminal."""

    def __init__(self, replies: dict[str, list[str | None]]) -> None:
        self.script = Script(replies)
        faults = FaultPlan([], "head", SteppedClock())
        self.server = SerialServer("serial://auto", self.script, faults)
        self.server.start()

    @property
    def url(self) -> str:
        return self.server.url

    @property
    def sent(self) -> list[str]:
        return self.script.sent


@pytest.fixture(params=["serial://auto", "socket://127.0.0.1:0"], ids=["pty", "tcp"])
def url(request) -> str:
    return request.param


@pytest.fixture
def multimeter(url) -> Iterator[SerialBench]:
    bench = SerialBench("digitiser", url)
    yield bench
    bench.close()


@pytest.fixture
def head_bench(url) -> Iterator[SerialBench]:
    bench = SerialBench("head", url)
    yield bench
    bench.close()


@pytest.fixture
def pty_multimeter() -> Iterator[SerialBench]:
    bench = SerialBench("digitiser", "serial://auto")
    yield bench
    bench.close()


@pytest.fixture
def pty_head() -> Iterator[SerialBench]:
    bench = SerialBench("head", "serial://auto")
    yield bench
    bench.close()


@pytest.fixture
def scripted():
    """Return a function that puts a script on a port."""
    ports: list[ScriptedPort] = []

    def make(replies: dict[str, list[str | None]]) -> ScriptedPort:
        ports.append(ScriptedPort(replies))
        return ports[-1]

    yield make
    for port in ports:
        port.server.close()


class Transcript:
    """A TCP port that holds the other side to an exact conversation.

    `steps` are (bytes expected, bytes answered). After the first departure it answers no more;
    `finish` returns what was received and fails on anything unsaid or said too much.
    """

    def __init__(self, steps: list[tuple[bytes, bytes]]) -> None:
        self.steps = steps
        self.received = bytearray()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"socket://127.0.0.1:{self._listener.getsockname()[1]}"
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        with self._listener, contextlib.suppress(OSError):
            connection, _ = self._listener.accept()
            with connection:
                connection.settimeout(5.0)
                for expected, answer in self.steps:
                    start = len(self.received)
                    while len(self.received) - start < len(expected):
                        data = connection.recv(len(expected) - len(self.received) + start)
                        if not data:
                            return
                        self.received += data
                    if bytes(self.received[start:]) != expected:
                        return
                    connection.sendall(answer)
                while data := connection.recv(4096):
                    self.received += data

    def finish(self) -> None:
        self._thread.join(timeout=5.0)
        assert bytes(self.received) == b"".join(expected for expected, _ in self.steps)


@pytest.fixture
def transcript():
    """Return a function that starts a transcript."""
    return Transcript
