"""`accelbench control plan|arm|start|withdraw|serve|notify`: what they do."""

import signal
import threading
import time
from pathlib import Path
from types import FrameType

import click

from accelbench.commands.control.text import (
    check_document,
    check_lines,
    command_document,
    planned_document,
)
from accelbench.shell.console import emit
from accelbench.shell.surroundings import show_warnings_at_once
from drivers.station import StationConfig
from errormodel.errors import InputError
from thermo.launch.arming import all_passed, check_arming
from thermo.launch.control import who_asks
from thermo.launch.notify import (
    TITLE,
    NoticeSender,
    default_notify_file,
    deliver,
    read_notify,
)
from thermo.launch.real import load_station
from thermo.launch.runner import Runner
from thermo.planning.sequence import load_sequence, parse_sequence, sequence_toml
from thermo.station.job import make_job
from thermo.store.files import open_existing_store
from thermo.store.operation import planned as queue
from thermo.store.operation.commands import Argument, ask, read_command
from thermo.store.store import open_store

DONE, FAILED = 0, 1
LOOK_S = 0.2


def plan(
    sequence: Path,
    station: Path | None,
    speed: float | None,
    after: int | None,
    store: str,
    as_json: bool,
) -> None:
    """Carry out `accelbench control plan`; the arguments are its options."""
    given = load_sequence(sequence)
    config = load_station(station) if station is not None else None
    if speed is not None and config is not None and config.emulation is None:
        raise click.UsageError(
            "--speed is for emulated instruments; the station file has no [emulation]"
        )
    make_job(given, store, config, source=str(sequence))
    with open_store(store) as opened:
        made = queue.plan_test(
            opened,
            name=given.name,
            sequence_toml=sequence_toml(given),
            station_json=None if config is None else config.model_dump_json(),
            speed=speed,
            after=after,
            who=who_asks(),
        )
        document = planned_document(queue.read_planned(opened, made))
    text = f"planned test {made}: {given.name}; arm it with: accelbench control arm {made}"
    emit(document, [text], as_json=as_json)


def arm(number: int, store: str, as_json: bool) -> int:
    """Carry out `accelbench control arm`; the arguments are its options."""
    with open_existing_store(store) as opened:
        planned = queue.read_planned(opened, number)
        text = planned.station_json
        station = None if text is None else StationConfig.model_validate_json(text)
        sequence = parse_sequence(planned.sequence_toml, f"planned test {number}")
        checks = check_arming(sequence, station, store)
        armed = all_passed(checks)
        if armed:
            queue.arm_test(opened, number, who=who_asks())
    document = {"planned": number, "armed": armed, "checks": [check_document(c) for c in checks]}
    said = f"planned test {number}: " + ("armed" if armed else "NOT armed")
    emit(document, [*check_lines(checks), said], as_json=as_json)
    return DONE if armed else FAILED


def start(
    number: int | None, resume: str | None, patience: float, store: str, as_json: bool
) -> int:
    """Carry out `accelbench control start`; the arguments are its options."""
    if (number is None) == (resume is None):
        raise click.UsageError("name a planned test N, or an interrupted one with --resume ID")
    arguments: dict[str, Argument] = {} if number is None else {"planned": float(number)}
    action = "start" if resume is None else "resume_test"
    with open_existing_store(store) as opened:
        asked = ask(opened, action, who=who_asks(), test_id=resume, arguments=arguments)
        give_up_s = time.monotonic() + patience
        while not (command := read_command(opened, asked)).answered:
            if time.monotonic() >= give_up_s:
                break
            time.sleep(LOOK_S)
    said = command.outcome or (
        "being started, not begun yet"
        if command.state == "taken"
        else f"nobody has taken it in {patience:g} s: is `accelbench control serve` running?"
    )
    document = command_document(command) | {"answered": command.answered}
    emit(document, [f"{command.state}: {said}"], as_json=as_json)
    return DONE if command.state == "done" else FAILED


def withdraw(number: int, store: str, as_json: bool) -> None:
    """Carry out `accelbench control withdraw`; the arguments are its options."""
    with open_existing_store(store) as opened:
        queue.withdraw_test(opened, number, who=who_asks())
        document = planned_document(queue.read_planned(opened, number))
    emit(document, [f"planned test {number}: withdrawn"], as_json=as_json)


def serve(store: str, notify: Path | None, as_json: bool) -> None:
    """Carry out `accelbench control serve`; the arguments are its options."""
    config, stop = read_notify(notify), threading.Event()
    show_warnings_at_once()

    def handle(number: int, frame: FrameType | None) -> None:
        stop.set()

    def tell(line: str) -> None:
        click.echo(line, err=True)

    before = {n: signal.signal(n, handle) for n in (signal.SIGINT, signal.SIGTERM)}
    try:
        open_store(store).close()
        who = "nobody is told of alarms" if config is None else f"{len(config.urls)} are told"
        tell(f"serving {store}; {who}; Ctrl-C stops it, tests go on")
        with NoticeSender(store, config):
            Runner(store, notify=notify, tell=tell).run(stop)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    emit({"store": store, "stopped": True}, ["stopped; tests that run go on"], as_json=as_json)


def notify(trial: bool, notify: Path | None, as_json: bool) -> int:
    """Carry out `accelbench control notify`; the arguments are its options."""
    config = read_notify(notify)
    if config is None:
        raise InputError(default_notify_file(), "", "no such file; --notify names another")
    schemes = [url.partition("://")[0] for url in config.urls]
    failed: list[str] = []
    if trial:
        text = f"A trial of accelbench's notices, sent by {who_asks()}."
        failed = [error for url in config.urls if (error := deliver(url, TITLE, text))]
    kinds = None if config.kinds is None else list(config.kinds)
    document = {"addresses": schemes, "kinds": kinds, "tried": trial, "failed": failed}
    lines = [f"addresses: {', '.join(schemes)}", f"kinds: {', '.join(kinds) if kinds else 'all'}"]
    lines += [f"NOT taken: {error}" for error in failed]
    if trial and not failed:
        lines.append("every address took the trial")
    emit(document, lines, as_json=as_json)
    return FAILED if failed else DONE
