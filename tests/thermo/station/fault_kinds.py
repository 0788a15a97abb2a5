"""The kinds of faults of the campaign: how each is brought about, and what has to come of it."""

import contextlib
import math
import os
import resource
import shutil
import signal
import sqlite3
import subprocess
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

from tests.thermo.station import fault_postgresql as postgresql
from tests.thermo.station.fault_case import SILENCE_S, Case, Process
from thermo.heartbeat import silence_limit_s
from thermo.station_shell import load_station

PATIENCE_S = 25.0  # a loaded machine is slow; nothing here may take that long


@dataclass
class Result:
    """What a kind promises: exit codes, how soon the chamber is safe, words that must be said."""

    codes: tuple[int, ...]
    within_s: float | None = PATIENCE_S  # None: never ours, nothing may be written
    says: str = ""
    where: list[str] = field(default_factory=list)  # stores that hold the readings, if not the one
    problems: list[str] = field(default_factory=list)
    resumable: bool = False


KINDS: dict[str, tuple[Callable[[Case], Result], int, dict[str, str]]] = {}


def kind(weight: int, **bench: str):
    def enter(function: Callable[[Case], Result]) -> Callable[[Case], Result]:
        KINDS[function.__name__] = (function, weight, bench)
        return function

    return enter


def begin(case: Case, *more: str, low: int = 1, high: int = 11, **how) -> None:
    """Start a test, wait for a random slot, and note the time of the fault."""
    case.start(*more, **how)
    if not case.wait_for_slots(case.rng.randint(low, high)):
        raise AssertionError("the test ended before its fault: " + case.process.text()[-600:])
    time.sleep(case.rng.random() * 0.25)
    case.strike()


def end(case: Case, patience_s: float = 60) -> None:
    if case.process.wait(patience_s) is None:
        raise AssertionError("the controller does not end: " + case.process.text()[-600:])


# ---- processes


@kind(12)
def sigint(case: Case) -> Result:
    begin(case)
    for _ in range(case.rng.choice((1, 1, 2, 3))):
        case.process.kill(signal.SIGINT)
        time.sleep(case.rng.random() * 0.05)
    return Result((1,), says="interrupted", resumable=True)


@kind(10)
def sigterm(case: Case) -> Result:
    begin(case)
    case.process.kill(signal.SIGTERM)
    return Result((1,), says="SIGTERM", resumable=True)


@kind(6)
def sighup(case: Case) -> Result:
    begin(case)
    case.process.kill(signal.SIGHUP)
    return Result((1,), says="SIGHUP", resumable=True)


@kind(4)
def sigtstp(case: Case) -> Result:
    begin(case)
    case.process.kill(signal.SIGTSTP)
    return Result((0,), says="Ctrl-Z")


@kind(18)
def sigkill(case: Case) -> Result:
    begin(case)
    case.process.kill(signal.SIGKILL)
    return Result((-9,), resumable=True)


@kind(6)
def sigkill_in_cleanup(case: Case) -> Result:
    begin(case)
    case.process.kill(signal.SIGTERM)
    time.sleep(case.rng.random() * 0.3)
    case.process.kill(signal.SIGKILL)
    return Result((-9, 1))


@kind(6)
def sigkill_at_start(case: Case) -> Result:
    case.start()
    time.sleep(case.rng.random() * 1.5)
    case.strike()
    case.process.kill(signal.SIGKILL)
    end(case)
    # safe, or never commanded
    return Result((-9,), within_s=PATIENCE_S if case.log("write") else None)


@kind(12)
def sigstop(case: Case) -> Result:
    begin(case, FAULTS_SILENCE_S=str(SILENCE_S))
    case.process.kill(signal.SIGSTOP)
    mine = {c["peer"] for c in case.log("connect")}
    early = case.rng.random() < 0.4  # it wakes while the guardian is at work
    if early:
        time.sleep(SILENCE_S + case.rng.uniform(-0.1, 0.3))
        safe_s = 0.0
    else:
        safe_s = case.wait_safe(SILENCE_S + PATIENCE_S)
    woken_s = time.monotonic()
    case.process.kill(signal.SIGCONT)
    end(case)
    result = Result((0, 1) if early else (1,), says="" if early else "guardian")
    if not safe_s < SILENCE_S + 10:
        result.problems.append(f"safe after {safe_s:.1f} s of silence")
    if not early and any(w["t"] > woken_s and w["peer"] in mine for w in case.log("write")):
        result.problems.append("commanded after it had been fenced")
    return result


@kind(2)
def sigstop_for_long(case: Case) -> Result:
    """Stopped, and left so, with the limit that follows from the station file."""
    begin(case)
    case.process.kill(signal.SIGSTOP)
    limit_s = silence_limit_s(load_station(case.folder / "station.toml"))
    safe_s = case.wait_safe(limit_s + PATIENCE_S)
    early = safe_s < limit_s - 1.0
    case.process.kill(signal.SIGKILL)
    late = not safe_s < limit_s + 5.0
    return Result((-9,), 60, problems=[f"safe after {safe_s} s"] if early or late else [])


@kind(4)
def sigstop_short(case: Case) -> Result:
    begin(case, FAULTS_SILENCE_S=str(SILENCE_S))
    case.process.kill(signal.SIGSTOP)
    time.sleep(SILENCE_S / 4)
    case.process.kill(signal.SIGCONT)
    return Result((0, 1))


@kind(8)
def guardian_killed(case: Case) -> Result:
    begin(case)
    os.kill(case.guardian(), signal.SIGKILL)
    return Result((0,), says="guardian")


@kind(4)
def guardian_killed_then_controller(case: Case) -> Result:
    begin(case, high=6)
    first = case.guardian()
    os.kill(first, signal.SIGKILL)
    give_up = time.monotonic() + 10
    while time.monotonic() < give_up and (not (now := case.process.children()) or now[-1] == first):
        time.sleep(0.02)
    time.sleep(0.3)
    case.strike()
    case.process.kill(signal.SIGKILL)
    return Result((-9,))


@kind(4)
def guardian_stopped(case: Case) -> Result:
    begin(case)
    pid = case.guardian()
    os.kill(pid, signal.SIGSTOP)
    end(case)
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, signal.SIGCONT)
    return Result((0, 1))


@kind(8)
def both_killed(case: Case) -> Result:
    begin(case)
    pid = case.guardian()
    if case.rng.random() < 0.5:
        os.kill(pid, signal.SIGKILL)
        case.process.kill(signal.SIGKILL)
    else:
        os.kill(pid, signal.SIGSTOP)
        case.process.kill(signal.SIGSTOP)
        time.sleep(0.5)
        os.kill(pid, signal.SIGKILL)
        case.process.kill(signal.SIGKILL)
    end(case)
    before = len(case.log("write"))
    time.sleep(0.5)
    result = Result((-9,), resumable=True)
    if len(case.log("write")) != before:
        result.problems.append("somebody commanded though both were dead")
    case.strike()
    code, text = case.command("make-safe", "station.toml", "--interrupted")
    if code != 0 or not case.is_safe():
        result.problems.append(f"make-safe: exit code {code}: {text[-300:]}")
    return result


@kind(10)
def second_controller(case: Case) -> Result:
    begin(case, high=5)
    host = case.rng.choice(("localhost", "127.0.0.1", "127.0.0.2", "::1", os.uname().nodename))
    second = {"XDG_STATE_HOME": str(case.folder / "other"), "TMPDIR": str(case.folder)}
    case.station("second.toml", host if ":" not in host else f"[{host}]")
    connects = len(case.log("connect"))
    case.environment |= second
    extra = case.rng.choice(((), ("--take-over",)))
    code, text = case.command(
        "run", "sequence.toml", "--station", "second.toml", "--store", "second.sqlite", *extra
    )
    case.environment["XDG_STATE_HOME"] = str(case.folder / "state")
    result = Result((0,))
    if code != 2:
        result.problems.append(f"second ({host}): exit code {code}: {text[-300:]}")
    if len(case.log("connect")) != connects:
        result.problems.append(f"second ({host}): opened the chamber")
    return result


@kind(4)
def make_safe_beside(case: Case) -> Result:
    begin(case, high=6)
    writes = len(case.log("write"))
    code, text = case.command("make-safe", "station.toml")
    result = Result((0,))
    foreign = {w["peer"] for w in case.log("write")[writes:]} - {
        w["peer"] for w in case.log("write")[:writes]
    }
    if code not in (1, 2) or foreign:
        result.problems.append(f"make-safe beside a test: exit code {code}: {text[-300:]}")
    if case.rng.random() < 0.5 and case.process.poll() is None:
        case.strike()
        code, text = case.command("make-safe", "station.toml", "--force")
        if code != 0:
            result.problems.append(f"make-safe --force: exit code {code}: {text[-300:]}")
        result.codes = (1, 0)
    return result


@kind(4)
def start_race(case: Case) -> Result:
    """Two controllers begin at once: one has the chamber, the other writes nothing."""
    first = case.start()
    second = Process(
        case.folder,
        ["run", "sequence.toml", "--station", "station.toml", "--store", "second.sqlite"],
        acks=case.folder / "acks",
        XDG_STATE_HOME=str(case.folder / "other"),
    )
    codes = sorted((first.wait(60), second.wait(60)), key=str)
    case.strike()
    result = Result((0, 2))
    if codes != [0, 2]:
        result.problems.append(f"exit codes {codes}: {second.text()[-300:]}")
    if len({w["peer"] for w in case.log("write")}) != 1:
        result.problems.append("both commanded the chamber")
    if first.code == 2:
        case.store = str(case.folder / "second.sqlite")
        case.process = second
    return result


@kind(3)
def resume_race(case: Case) -> Result:
    """A killed test is resumed twice at once: one goes on with it."""
    begin(case, high=5)
    case.process.kill(signal.SIGKILL)
    end(case)
    safe_s = case.wait_safe(PATIENCE_S)
    words = ["run", "--resume", case.tests()[-1]["id"], "--store", case.store]
    both = [
        Process(case.folder, words, acks=case.folder / "acks", **case.environment) for _ in range(2)
    ]
    codes = sorted((p.wait(120) for p in both), key=str)
    case.process = next((p for p in both if p.code == 0), both[0])
    result = Result((0,))
    if codes != [0, 2] or not safe_s < PATIENCE_S:
        told = " / ".join(p.text()[-300:] for p in both)
        result.problems.append(f"exit codes {codes}: {told}")
    return result


@kind(3)
def resume_while_the_guardian_tries(case: Case) -> Result:
    begin(case, high=5)
    case.panel("chamber", "dead")
    case.process.kill(signal.SIGKILL)
    end(case)
    time.sleep(0.5)
    words = ["run", "--resume", case.tests()[-1]["id"], "--store", case.store]
    case.process = Process(case.folder, words, acks=case.folder / "acks", **case.environment)
    time.sleep(case.rng.uniform(2, 5))
    case.panel("chamber", "alive")
    end(case, 120)
    return Result((0,))


@kind(4)
def resume_occupied(case: Case) -> Result:
    """Somebody uses the chamber when the test is to be resumed: nothing is written to it."""
    begin(case, high=5)
    case.process.kill(case.rng.choice((signal.SIGTERM, signal.SIGKILL)))
    end(case)
    safe_s = case.wait_safe(PATIENCE_S)
    result = Result((1, -9), within_s=math.inf)
    if not safe_s < PATIENCE_S:
        result.problems.append("not safe")
    time.sleep(1.0)  # for a guardian to go
    case.panel("chamber", *case.rng.choice((("profile", 50), ("off",))))
    writes = len(case.log("write"))
    code, text = case.command(
        "run", "--resume", case.tests()[-1]["id"], "--store", case.store, acks=case.folder / "acks"
    )
    if code != 2:
        result.problems.append(f"resumed on an occupied chamber: exit code {code}: {text[-300:]}")
    if len(case.log("write")) != writes:
        result.problems.append("an occupied chamber was written to")
    if case.panel("state")["profile"] == 149:
        case.panel("chamber", "profile_ended")
    return result


# ---- somebody at the panel


def _panel(case: Case, *words: object, code: tuple[int, ...] = (1,), **how) -> Result:
    begin(case, **how)
    case.panel("chamber", *words)
    if case.rule == "pause":
        time.sleep(1.5)
        if case.process.poll() is None and case.is_safe():
            return Result(code, problems=["made safe while it was to pause"])
        case.process.kill(signal.SIGTERM)
        code = (1,)
    return Result(code, says="foreign")


@kind(6)
def panel_setpoint(case: Case) -> Result:
    return _panel(case, "setpoint", case.rng.uniform(30, 60))


@kind(3, rule="tell")
def panel_setpoint_tell(case: Case) -> Result:
    # the next command of the programme puts it right; if none comes the deviation ends it
    return _panel(case, "setpoint", case.rng.uniform(22, 23))


@kind(3, rule="pause")
def panel_setpoint_pause(case: Case) -> Result:
    return _panel(case, "setpoint", case.rng.uniform(30, 60))


@kind(6)
def panel_off(case: Case) -> Result:
    result = _panel(case, "off")
    end(case)
    if case.panel("state")["mode"] != 62:
        result.problems.append("a loop that somebody switched off was switched on")
    return result


@kind(6)
def panel_profile(case: Case) -> Result:
    return _panel(case, "profile", case.rng.uniform(30, 60))


@kind(3, model="watlow_f4")
def panel_profile_f4(case: Case) -> Result:
    # while its own ramp is a profile somebody else's cannot be told from it by the state alone
    return _panel(case, "profile", case.rng.uniform(30, 60), low=12, high=13)


@kind(3, model="watlow_f4")
def panel_setpoint_f4(case: Case) -> Result:
    return _panel(case, "setpoint", case.rng.uniform(30, 60), low=12, high=13)


def _refused(case: Case, *words: object) -> Result:
    case.panel("chamber", *words)
    case.strike()
    case.start()
    end(case)
    stored = ["a store was left"] if Path(case.store).exists() else []
    return Result((2,), within_s=None, problems=stored)


@kind(3)
def start_profile(case: Case) -> Result:
    return _refused(case, "profile", 50)


@kind(3)
def start_off(case: Case) -> Result:
    return _refused(case, "off")


@kind(3)
def start_fahrenheit(case: Case) -> Result:
    return _refused(case, "fahrenheit")


@kind(3)
def start_words(case: Case) -> Result:
    return _refused(case, "words")


@kind(3, model="watlow_f4")
def start_decimals(case: Case) -> Result:
    return _refused(case, "decimals", case.rng.choice((0, 2)))


@kind(2, model="watlow_f4")
def start_fahrenheit_f4(case: Case) -> Result:
    return _refused(case, "fahrenheit")


@kind(3)
def start_taken_over(case: Case) -> Result:
    case.panel("chamber", *case.rng.choice((("profile", 50), ("off",))))
    case.start("--take-over")
    if not case.wait_for_slots(3):
        raise AssertionError(case.process.text()[-600:])
    case.strike()
    return Result((0,), says="take-over")


# ---- the chamber


@kind(6)
def chamber_frozen(case: Case) -> Result:
    begin(case, low=1, high=3)
    case.panel("chamber", "freeze")
    return Result((1,), says="chamber")


def _passing(case: Case, what: str, low: int, high: int, seconds: float = 0.0, **how) -> Result:
    begin(case, **how)
    case.panel("chamber", what, case.rng.randint(low, high), seconds)
    return Result((0, 1))


@kind(6)
def chamber_late(case: Case) -> Result:
    return _passing(case, "late", 1, 4, case.rng.uniform(0.2, 0.9))


@kind(5)
def chamber_silent(case: Case) -> Result:
    return _passing(case, "silent", 1, 6)


@kind(5)
def chamber_reset(case: Case) -> Result:
    return _passing(case, "reset", 1, 20)


@kind(5)
def chamber_dropped(case: Case) -> Result:
    return _passing(case, "drop", 1, 20)


@kind(5)
def chamber_exception(case: Case) -> Result:
    return _passing(case, "exception", 1, 12)


@kind(5)
def chamber_garbage(case: Case) -> Result:
    return _passing(case, "garbage", 1, 6)


@kind(4)
def chamber_torn(case: Case) -> Result:
    return _passing(case, "torn", 1, 6)


@kind(5)
def chamber_nan(case: Case) -> Result:
    return _passing(case, "nan", 1, 4)


@kind(4)
def chamber_nan_for_good(case: Case) -> Result:
    begin(case, high=6)
    case.panel("chamber", "nan", 100000)
    return Result((1,))


def _unrecognised(case: Case, *words: object, **how) -> Result:
    """Nothing may be written by a wrong scale; only the limits of the chamber are safe then."""
    begin(case, high=8, **how)
    case.panel("chamber", *words)
    end(case, 200)
    # the guardian goes on trying; somebody puts the controller's settings right
    writes = [w for w in case.log("write") if w["t"] > case.fault_s + 0.05]
    odd = [w for w in writes if not -60 <= w["setpoint"] <= 90]
    result = Result((1,))
    if odd:
        result.problems.append(f"wrote by a wrong scale: {odd[:2]}")
    return result


@kind(4)
def chamber_words(case: Case) -> Result:
    result = _unrecognised(case, "words")
    case.panel("chamber", "words")
    case.strike()
    return result


@kind(4)
def chamber_fahrenheit(case: Case) -> Result:
    result = _unrecognised(case, "fahrenheit")
    case.panel("chamber", "celsius")
    case.strike()
    return result


@kind(4, model="watlow_f4")
def chamber_decimals(case: Case) -> Result:
    result = _unrecognised(case, "decimals", case.rng.choice((0, 2)))
    case.panel("chamber", "decimals", 1)
    case.strike()
    return result


@kind(4)
def chamber_dead_a_while(case: Case) -> Result:
    begin(case)
    case.panel("chamber", "dead")
    time.sleep(case.rng.uniform(0.1, 1.5))
    case.panel("chamber", "alive")
    return Result((0, 1))


@kind(4)
def chamber_dead_controller_killed(case: Case) -> Result:
    begin(case)
    case.panel("chamber", "dead")
    case.process.kill(signal.SIGKILL)
    time.sleep(case.rng.uniform(0.5, 4))
    case.panel("chamber", "alive")
    case.strike()
    return Result((-9,), within_s=40)


# ---- multimeter and head


@kind(5)
def thermistor_lost(case: Case) -> Result:
    begin(case, high=8)
    case.panel("digitiser", "lose", case.rng.choice((111, 112)))
    return Result((1,), says="thermistor")


@kind(4)
def output_stuck(case: Case) -> Result:
    begin(case, high=5)
    case.panel("digitiser", "stick")
    return Result((1,), says="repeat")


@kind(4)
def digitiser_silent(case: Case) -> Result:
    begin(case)
    case.panel("digitiser", "silent", case.rng.choice((1, 2, 100000)))
    return Result((0, 1))


@kind(4)
def head_stuck(case: Case) -> Result:
    begin(case, high=5)
    case.panel("head", "stick")
    return Result((1,), says="head")


@kind(4)
def head_silent(case: Case) -> Result:
    begin(case)
    case.panel("head", "silent", case.rng.choice((1, 3, 100000)))
    return Result((0, 1))


@kind(3)
def head_unplugged(case: Case) -> Result:
    begin(case)
    case.panel("head", "unplug")
    return Result((1, 0))


@kind(3)
def digitiser_unplugged(case: Case) -> Result:
    begin(case)
    case.panel("digitiser", "unplug")
    return Result((1,))


# ---- the store


@kind(8)
def store_locked(case: Case) -> Result:
    begin(case)
    for_s = case.rng.uniform(0.5, 6)
    holder = sqlite3.connect(case.store, timeout=5, isolation_level=None)
    holder.execute("begin immediate" if case.rng.random() < 0.5 else "begin exclusive")
    give_up = time.monotonic() + for_s
    while time.monotonic() < give_up:
        time.sleep(0.05)
    holder.execute("rollback")
    holder.close()
    return Result((0, 1))


@kind(4)
def store_locked_and_killed(case: Case) -> Result:
    begin(case)
    holder = sqlite3.connect(case.store, timeout=5, isolation_level=None)
    holder.execute("begin immediate")
    time.sleep(case.rng.uniform(0.5, 3))
    case.strike()
    case.process.kill(signal.SIGKILL)
    end(case)
    safe_s = case.wait_safe(PATIENCE_S)
    holder.execute("rollback")
    holder.close()
    return Result((-9,), problems=[] if safe_s < PATIENCE_S else [f"safe after {safe_s}"])


def _copies(case: Case) -> list[str]:
    return [str(p) for p in (case.folder / "state").glob("accelbench/spool/*.sqlite")]


@kind(6)
def store_deleted(case: Case) -> Result:
    begin(case)
    for path in case.folder.glob("night.sqlite*"):
        if path.name in ("night.sqlite", "night.sqlite-wal", "night.sqlite-shm"):
            path.unlink()
    end(case)
    return Result((0, 1), says="spool", where=_copies(case))


@kind(4)
def store_moved(case: Case) -> Result:
    begin(case)
    away = case.folder / "away.sqlite"
    shutil.move(case.store, away)
    end(case)
    return Result((0, 1), says="spool", where=_copies(case))


@kind(3)
def store_replaced(case: Case) -> Result:
    begin(case)
    other = case.folder / "other.sqlite"
    other.write_bytes(b"")
    os.replace(other, case.store)
    end(case)
    return Result((0, 1), says="spool", where=_copies(case))


def _disk(case: Case) -> Path:
    disk = case.folder / "disk"
    disk.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=2m", "none", str(disk)], check=True)
    return disk


@kind(5)
def disk_full(case: Case) -> Result:
    disk = _disk(case)
    case.store = str(disk / "night.sqlite")
    begin(case, high=8)
    ballast = _fill(disk / "ballast")
    if case.rng.random() < 0.5:
        time.sleep(1.5)
        ballast.unlink()
        return Result((0,))
    end(case)
    ballast.unlink()
    return Result((0, 1))


def _fill(path: Path) -> Path:
    with path.open("wb", buffering=0) as file:
        try:
            while True:
                file.write(bytes(4096))
        except OSError:
            return path


@kind(3)
def state_folder_removed(case: Case) -> Result:
    """The folder of spools is taken away, then the store is locked."""
    begin(case, high=8)
    shutil.rmtree(case.folder / "state")
    with closing(sqlite3.connect(case.store, timeout=5, isolation_level=None)) as holder:
        holder.execute("begin immediate")
        time.sleep(case.rng.uniform(0.5, 5))
        holder.execute("rollback")
    return Result((0, 1))


@kind(3)
def no_more_files(case: Case) -> Result:
    """Nothing more can be opened by the controller: no spool, no new connection."""
    begin(case, high=8)
    resource.prlimit(case.process.pid, resource.RLIMIT_NOFILE, (4, 4))
    if case.rng.random() < 0.5:
        case.panel("chamber", "reset", 1)
    else:
        with closing(sqlite3.connect(case.store, timeout=5, isolation_level=None)) as holder:
            holder.execute("begin immediate")
            time.sleep(case.rng.uniform(0.5, 3))
            holder.execute("rollback")
    return Result((0, 1), within_s=60)


@kind(3)
def disk_full_spool_too(case: Case) -> Result:
    disk = _disk(case)
    case.store = str(disk / "night.sqlite")
    case.environment["XDG_STATE_HOME"] = str(disk / "state")
    begin(case, high=8)
    ballast = _fill(disk / "ballast")
    end(case)
    ballast.unlink()
    return Result((0, 1))


@kind(3)
def out_disk_full(case: Case) -> Result:
    disk = _disk(case)
    begin(case, "--out", str(disk / "night.csv"))
    ballast = _fill(disk / "ballast")
    end(case)
    ballast.unlink()
    return Result((1,), says="accelbench export")


@kind(8)
def postgresql_stopped(case: Case) -> Result:
    case.store = postgresql.new_database()
    begin(case, high=8)
    with postgresql.stopped():
        time.sleep(case.rng.uniform(0.5, 8))
        killed = case.rng.random() < 0.3
        if killed:
            case.strike()
            case.process.kill(signal.SIGKILL)
            end(case)
            safe_s = case.wait_safe(PATIENCE_S)
            return Result((-9,), problems=[] if safe_s < PATIENCE_S else ["not safe"])
    return Result((0, 1))


@kind(4)
def postgresql_killed(case: Case) -> Result:
    """The server dies and comes back from its own log."""
    case.store = postgresql.new_database()
    begin(case, high=8)
    postgresql.crash()
    time.sleep(case.rng.uniform(0.2, 2))
    postgresql.start()
    return Result((0, 1))


@kind(4)
def out_removed(case: Case) -> Result:
    (case.folder / "results").mkdir()
    begin(case, "--out", "results/night.csv")
    shutil.rmtree(case.folder / "results")
    return Result((1,), says="accelbench export")


# ---- the terminal


@kind(4)
def terminal_stopped(case: Case) -> Result:
    """Nobody takes a byte from the terminal, as after Ctrl-S."""
    master, slave = os.openpty()
    begin(case, fds={1: slave, 2: slave}, tty=os.ttyname(slave))
    os.write(master, b"\x13")
    end(case, 60)
    os.close(slave)
    os.close(master)
    return Result((0,))


@kind(3)
def terminal_ctrl_s_then_q(case: Case) -> Result:
    master, slave = os.openpty()
    begin(case, fds={1: slave, 2: slave}, tty=os.ttyname(slave))
    os.write(master, b"\x13")
    time.sleep(1.5)
    os.write(master, b"\x11")
    os.set_blocking(master, False)
    give_up = time.monotonic() + 60
    said = b""
    while case.process.poll() is None and time.monotonic() < give_up:
        try:
            said += os.read(master, 65536)
        except BlockingIOError:
            time.sleep(0.02)
    os.close(slave)
    os.close(master)
    return Result((0,), problems=[] if b"finished" in said else ["the outcome was not told"])


@kind(4)
def terminal_hung_up(case: Case) -> Result:
    master, slave = os.openpty()
    begin(case, fds={1: slave, 2: slave}, tty=os.ttyname(slave))
    os.close(slave)
    os.close(master)
    return Result((1,))


@kind(4)
def tee_dead(case: Case) -> Result:
    read, write = os.pipe()
    begin(case, fds={1: write, 2: write})
    os.close(write)
    os.close(read)
    return Result((0,))


@kind(3)
def pipe_undrained(case: Case) -> Result:
    read, write = os.pipe()
    os.set_blocking(write, False)
    try:
        while True:
            os.write(write, bytes(4096))
    except BlockingIOError:
        pass
    os.set_blocking(write, True)
    begin(case, fds={1: write, 2: write})
    end(case, 60)
    os.close(write)
    os.close(read)
    return Result((0,))


@kind(3)
def stderr_closed(case: Case) -> Result:
    begin(case, fds={2: None})
    return Result((0,))


# ---- two at once


@kind(12)
def two_at_once(case: Case) -> Result:
    """Spoil the chamber's answers, or lock the store, or kill the guardian; then end the test."""
    begin(case)
    first = case.rng.choice(("late", "reset", "exception", "garbage", "locked", "guardian"))
    holder = None
    if first == "locked":
        holder = sqlite3.connect(case.store, timeout=5, isolation_level=None)
        holder.execute("begin immediate")
    elif first == "guardian":
        os.kill(case.guardian(), signal.SIGKILL)
    else:
        case.panel("chamber", first, case.rng.randint(2, 8), 0.5)
    second = case.rng.choice(("int", "term", "kill", "setpoint", "off"))
    if first == "guardian" and second == "kill":
        second = "term"  # both dead at once is a kind of its own
    if second in ("setpoint", "off"):
        case.panel("chamber", second, 40)
    else:
        case.process.kill(getattr(signal, f"SIG{second.upper()}"))
    if holder is not None:
        time.sleep(case.rng.uniform(0.2, 3))
        holder.rollback()
        holder.close()
    return Result((-9,) if second == "kill" else (1,), within_s=40)
