"""`accelbench control list|pause|resume|abort|acknowledge`: what they do."""

import json
import logging

import click

from accelbench.commands.control.text import (
    alarm_document,
    beat_document,
    command_document,
    list_text,
    planned_document,
)
from accelbench.shell.console import emit
from errormodel.errors import StoreError
from thermo.launch.control import ask_controller, who_asks
from thermo.launch.dead_controllers import is_gone, settle_dead_controllers
from thermo.store.files import open_existing_store
from thermo.store.operation import alarms
from thermo.store.operation.commands import Action, list_commands
from thermo.store.operation.controllers import list_beats
from thermo.store.operation.notices import list_notices
from thermo.store.operation.planned import list_planned

log = logging.getLogger(__name__)

DONE, FAILED = 0, 1
NEWEST = 10  # commands that are shown


def list_(store: str, as_json: bool) -> None:
    """Carry out `accelbench control list`; the arguments are its options."""
    with open_existing_store(store) as opened:
        try:
            settle_dead_controllers(opened, store)
        except StoreError as err:
            log.warning("%s", err)
        beats = [(b, not is_gone(b)) for b in list_beats(opened)]
        running = [(b, alive) for b, alive in beats if alive]
        found = alarms.list_alarms(opened, open_only=True)
        planned = list_planned(opened, open_only=True)
        commands = list_commands(opened, newest=NEWEST)
        waiting = len(list_notices(opened, waiting_only=True))
    document = {
        "controllers": [beat_document(b, alive=alive) for b, alive in running],
        "alarms": [alarm_document(a) for a in found],
        "planned": [planned_document(p) for p in planned],
        "commands": [command_document(c) for c in commands],
        "notices_waiting": waiting,
    }
    text = list_text([b for b, _ in running], found, planned, commands, waiting)
    emit(document, text, as_json=as_json)


def ask(
    action: Action, test_id: str, store: str, reason: str, patience: float, as_json: bool
) -> int:
    """Carry out `accelbench control pause|resume|abort`; the arguments are its options."""
    with open_existing_store(store) as opened:
        command = ask_controller(
            opened, action, test_id, who=who_asks(), reason=reason, patience_s=patience
        )
        safe_json = opened.test(test_id).safe_result_json
    said = command.outcome
    if not command.answered:
        what = "taken and not done yet" if command.state == "taken" else "not taken yet"
        said = (
            f"{what} after {patience:g} s; it stays asked: see `accelbench control list`. "
            "Ctrl-C, or SIGTERM to the controller, ends a test without its store"
        )
    safe = json.loads(safe_json) if action == "abort" and safe_json else {"commanded": False}
    unsafe = command.state == "done" and safe["commanded"] and not safe["verified"]
    document = command_document(command) | {"answered": command.answered}
    emit(document, [f"{action} {test_id}: {command.state}: {said}"], as_json=as_json)
    return DONE if command.state == "done" and not unsafe else FAILED


def acknowledge(numbers: tuple[int, ...], every: bool, store: str, as_json: bool) -> None:
    """Carry out `accelbench control acknowledge`; the arguments are its options."""
    if bool(numbers) == every:
        raise click.UsageError("name alarms by number, or say --all")
    who, done = who_asks(), list[int]()
    with open_existing_store(store) as opened:
        known = {a.number: a for a in alarms.list_alarms(opened)}
        wanted = numbers or tuple(n for n, a in known.items() if a.is_open)
        if missing := [n for n in wanted if n not in known]:
            raise StoreError(f"alarm {missing[0]}: there is none of this number")
        done = [n for n in wanted if alarms.acknowledge(opened, n, who=who)]
    lines = [f"alarm {n}, {known[n].kind}: acknowledged by {who}" for n in done]
    lines += [f"alarm {n}: had been acknowledged before" for n in wanted if n not in done]
    document = {"acknowledged": done, "who": who}
    emit(document, lines or ["no alarm is open"], as_json=as_json)
