"""Running tests, alarms, queue and commands, as documents and in words."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from rich.console import RenderableType
from rich.text import Text

from accelbench.shell.console import number, table
from thermo.launch.arming import Check
from thermo.planning.text import duration_text
from thermo.store.operation.alarms import Alarm
from thermo.store.operation.commands import Command
from thermo.store.operation.controllers import ControllerBeat
from thermo.store.operation.planned import PlannedTest

STYLES = {"danger": "bold red", "warning": "yellow", "news": ""}


def beat_document(beat: ControllerBeat, *, alive: bool) -> dict[str, Any]:
    """Return a heartbeat for JSON."""
    return asdict(beat) | {"alive": alive, "silent": beat.is_silent}


def alarm_document(alarm: Alarm) -> dict[str, Any]:
    """Return an alarm for JSON."""
    about = alarm.about
    return asdict(alarm) | {
        "title": about.title,
        "weight": about.weight,
        "meaning": about.meaning,
        "remedy": about.remedy,
    }


def planned_document(planned: PlannedTest) -> dict[str, Any]:
    """Return a planned test for JSON, without its files."""
    left_out = ("sequence_toml", "station_json")
    shown = {name: value for name, value in asdict(planned).items() if name not in left_out}
    return shown | {"emulated": planned.station_json is None}


def command_document(command: Command) -> dict[str, Any]:
    """Return a command for JSON."""
    return asdict(command) | {"arguments": dict(command.arguments)}


def check_document(check: Check) -> dict[str, Any]:
    """Return what was looked at before a start for JSON."""
    return asdict(check)


def check_lines(checks: Sequence[Check]) -> list[RenderableType]:
    """Return the same in words, what is not good in red."""
    lines: list[RenderableType] = []
    for check in checks:
        if check.passed:
            lines.append(f"good  {check.name}: {check.found}")
        else:
            said = f"BAD   {check.name}: {check.found}. {check.remedy}"
            lines.append(Text(said, style="bold red"))
    return lines


def list_text(
    beats: Sequence[ControllerBeat],
    alarms: Sequence[Alarm],
    planned: Sequence[PlannedTest],
    commands: Sequence[Command],
    notices: int,
) -> list[RenderableType]:
    """Return all that `accelbench control list` shows."""
    text: list[RenderableType] = [_running(beats) if beats else "no test is running"]
    for alarm in alarms:
        style = STYLES[alarm.about.weight]
        where = f", test {alarm.test_id}" if alarm.test_id else ""
        times = f", {alarm.times} times" if alarm.times > 1 else ""
        said = f"alarm {alarm.number}{where}: {alarm.about.title}{times}: {alarm.text}"
        text += [Text(said, style=style), f"  {alarm.about.meaning} {alarm.about.remedy}"]
    if planned:
        text.append(_queue(planned))
    if notices:
        text.append(f"{notices} notices have still to be sent")
    if commands:
        text.append(_commands(commands))
    return text


def _running(beats: Sequence[ControllerBeat]) -> RenderableType:
    names = ("test", "phase", "run", "slot", "chamber, °C", "left", "heard", "guardian", "store")
    made = table(*names, right=names[4:5], words=names[7:])
    for b in beats:
        heard = f"{b.age_s:.0f} s ago" + (", silent" if b.is_silent else "")
        left = duration_text(b.left_s / (b.speed or 1.0))
        run, slot = f"{b.run} of {b.runs}", f"{b.slot} of {b.slots}"
        made.add_row(
            b.test_id, b.phase, run, slot, number(b.chamber_c), left, heard, b.guardian, b.store
        )
    return made


def _queue(planned: Sequence[PlannedTest]) -> RenderableType:
    names = ("planned", "name", "state", "after", "test", "why")
    made = table(*names, words=names[5:])
    for p in planned:
        after = "–" if p.after_id is None else str(p.after_id)
        made.add_row(str(p.number), p.name, p.state, after, p.test_id or "–", p.outcome)
    return made


def _commands(commands: Sequence[Command]) -> RenderableType:
    names = ("command", "asked, UTC", "who", "action", "test", "state", "outcome")
    made = table(*names, words=names[6:])
    for c in commands:
        asked = c.asked_utc[:19].replace("T", " ")
        made.add_row(str(c.number), asked, c.who, c.action, c.test_id or "–", c.state, c.outcome)
    return made
