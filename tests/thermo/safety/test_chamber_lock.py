"""One master a chamber: whoever asks, however he spells it, whatever his environment."""

import getpass
import os
import socket
import subprocess
import sys
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from drivers.errors import LinkError
from drivers.station import ChamberConfig
from thermo.safety.chamber_lock import ChamberHeldError, ChamberLock, find_holder, lock_names

ROOT = Path(__file__).parents[3]
URL = "modbus+tcp://127.0.0.1:5020"
NOBODY = 65534
needs_root = pytest.mark.skipif(os.getuid() != 0, reason="only root can become another user")


@pytest.fixture
def salt() -> str:
    return uuid.uuid4().hex


def chamber(url: str = URL, unit_id: int = 1) -> ChamberConfig:
    return ChamberConfig(model="watlow_f4t", url=url, unit_id=unit_id)


def started(salt: str, *args: str, url: str = URL, **environment: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, str(Path(__file__).with_name("lock_process.py")), salt, url, *args],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)} | environment,
    )


def first_line(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


def end(process: subprocess.Popen[str]) -> None:
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.close()
    process.stdout.close()
    process.wait(30)


@contextmanager
def holding(
    salt: str, *args: str, url: str = URL, **environment: str
) -> Iterator[subprocess.Popen[str]]:
    process = started(salt, *args, url=url, **environment)
    try:
        assert first_line(process).startswith("held")
        yield process
    finally:
        end(process)


# ---- what is one chamber


@pytest.mark.parametrize(
    "url",
    [
        "modbus+tcp://localhost:502",
        "modbus+tcp://LOCALHOST",
        "modbus+tcp://127.0.0.1",
        "modbus+tcp://[::1]:502",
        "modbus+tcp://[::ffff:127.0.0.1]",
        "modbus+tcp://0.0.0.0:502",
        "modbus+rtu+tcp://127.0.0.1",
        f"modbus+tcp://{socket.gethostname()}",
    ],
)
def test_every_spelling_of_this_machine_is_one_chamber(url: str) -> None:
    try:
        names = lock_names(chamber(url, unit_id=7))
    except LinkError:
        pytest.skip("this machine's own name has no address here")
    assert set(names) & set(lock_names(chamber("modbus+tcp://127.0.0.1:502")))


def test_this_machine_s_address_in_the_network_is_this_machine() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # sends nothing; picks the address packets would have
        except OSError:
            pytest.skip("no network but the machine itself")
        own = probe.getsockname()[0]
    assert lock_names(chamber(f"modbus+tcp://{own}:502")) == lock_names(
        chamber("modbus+tcp://localhost:502")
    )


def test_another_port_and_another_host_are_other_chambers() -> None:
    urls = (URL, "modbus+tcp://127.0.0.1:5021", "modbus+tcp://192.0.2.1:5020")
    assert len({lock_names(chamber(url)) for url in urls}) == 3


def test_a_serial_device_is_one_however_it_is_linked_to(tmp_path: Path) -> None:
    leader, follower = os.openpty()
    try:
        path = os.ttyname(follower)
        link = tmp_path / "chamber"
        link.symlink_to(path)
        names = {lock_names(chamber(f"modbus+rtu://{p}")) for p in (path, link)}
        assert len(names) == 1
        assert names != {lock_names(chamber("modbus+rtu:///dev/null"))}
    finally:
        os.close(leader)
        os.close(follower)


def test_a_serial_device_that_is_not_there_is_still_one(tmp_path: Path) -> None:
    link = tmp_path / "chamber"
    link.symlink_to(tmp_path / "ttyUSB7")
    names = {lock_names(chamber(f"modbus+rtu://{p}")) for p in (link, tmp_path / "ttyUSB7")}
    assert len(names) == 1


def test_a_host_without_an_address_is_told() -> None:
    with pytest.raises(LinkError, match="has no address"):
        lock_names(chamber("modbus+tcp://no-such-host.invalid:502"))


# ---- who holds it


def test_nobody_holds_a_free_chamber_and_a_released_one(salt: str) -> None:
    assert find_holder(chamber(), salt=salt) is None
    lock = ChamberLock.take(chamber(), salt=salt)
    assert find_holder(chamber(), salt=salt) is not None
    lock.release()
    lock.release()  # harmless
    assert find_holder(chamber(), salt=salt) is None


def test_the_second_is_refused_and_told_who_has_it(salt: str, tmp_path: Path) -> None:
    other = {"url": "modbus+tcp://localhost:5020", "TMPDIR": str(tmp_path)}
    with holding(salt, "0", **other) as first:  # type: ignore[arg-type]
        with pytest.raises(ChamberHeldError) as raised:
            ChamberLock.take(chamber(), salt=salt)
        told = str(raised.value)
        assert f"{getpass.getuser()}, process {first.pid}, for " in told
        assert "not commanded" in told
        assert "\n" not in told
    ChamberLock.take(chamber(), salt=salt).release()


def test_of_many_that_begin_at_once_exactly_one_wins(salt: str) -> None:
    urls = (
        "modbus+tcp://localhost:5020",
        URL,
        "modbus+tcp://[::1]:5020",
        "modbus+rtu+tcp://127.1:5020",
    )
    racing = [started(salt, "0", url=url) for url in urls]
    try:
        said = [first_line(process) for process in racing]
        assert sorted(line.split()[0] for line in said) == ["held", *["refused"] * 3]
        winner = racing[[line.startswith("held") for line in said].index(True)]
        assert all(f"process {winner.pid}," in s for s in said if s.startswith("refused"))
    finally:
        for process in racing:
            end(process)


def test_a_dead_holder_leaves_nothing_behind(salt: str) -> None:
    with holding(salt, "0") as first:
        first.kill()
        first.wait(30)
        ChamberLock.take(chamber(), salt=salt, patience_s=0.0).release()


def test_a_child_that_inherited_it_holds_it_when_its_parent_is_gone(salt: str) -> None:
    with holding(salt, "0", "fork") as parent:
        parent.wait(30)  # the child holds, and has the parent's standard input
        holder = find_holder(chamber(), salt=salt)
        assert holder is not None
        assert holder.is_guardian
        with pytest.raises(
            ChamberHeldError, match=f"the guardian of the dead process {parent.pid}"
        ):
            ChamberLock.take(chamber(), salt=salt, patience_s=0.3)
    # the child goes with its standard input; whoever waits for it gets the chamber
    ChamberLock.take(chamber(), salt=salt).release()


def test_a_stopped_holder_is_told_as_such(salt: str) -> None:
    with holding(salt, "0") as first:
        os.kill(first.pid, 19)
        give_up_s = time.monotonic() + 30
        while (holder := find_holder(chamber(), salt=salt)) is None or holder.state != "stopped":
            assert time.monotonic() < give_up_s
        assert f"process {first.pid} (stopped)" in holder.sentence
        os.kill(first.pid, 18)


@needs_root
def test_another_user_s_lock_names_him_and_his_process(salt: str) -> None:
    with holding(salt, str(NOBODY)) as first, pytest.raises(ChamberHeldError) as raised:
        ChamberLock.take(chamber(), salt=salt)
    assert f"nobody, process {first.pid}" in str(raised.value)


@needs_root
def test_root_s_lock_names_root_to_another_user(salt: str) -> None:
    with holding(salt, "0") as first:
        other = started(salt, str(NOBODY))
        line = first_line(other)
        end(other)
    assert f"refused chamber {URL}: held by root, process {first.pid}" in line


@needs_root
def test_another_user_who_only_asks_keeps_nobody_out(salt: str) -> None:
    """Connections are all that a stranger can make to a lock; they do not outlive it."""
    lock = ChamberLock.take(chamber(), salt=salt)
    (name,) = lock_names(chamber(), salt=salt)
    code = (
        "import os, socket, sys\n"
        f"os.setuid({NOBODY})\n"
        "asking = [socket.socket(socket.AF_UNIX) for _ in range(200)]\n"
        "for one in asking:\n"
        "    one.setblocking(False)\n"
        "    one.connect(bytes.fromhex(sys.argv[1]))\n"
        "print('asked', flush=True)\n"
        "sys.stdin.read()\n"
    )
    stranger = subprocess.Popen(
        [sys.executable, "-c", code, name.encode().hex()],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert first_line(stranger) == "asked"
        assert find_holder(chamber(), salt=salt) is not None
        lock.tell({"test_id": "T"})  # answers one of them and does not wait
        lock.release()
        ChamberLock.take(chamber(), salt=salt, patience_s=0.0).release()
    finally:
        end(stranger)
