"""Faults of processes: stopped, killed, more than one, and two faults at once."""

import contextlib
import math
import os
import signal
import sqlite3
import time

from tests.thermo.station.campaign.case import SILENCE_S, Case
from tests.thermo.station.campaign.controller import Process
from tests.thermo.station.campaign.kinds import PATIENCE_S, Result, begin, end, kind
from thermo.launch.real import load_station
from thermo.planning.silence import silence_limit_s

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
