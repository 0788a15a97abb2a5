"""`accelbench runs`, `export` and `emulate`: what the store has, and instruments alone."""

import json
import signal
import sys
import threading
from pathlib import Path
from types import FrameType

import click
from rich.text import Text

from accelbench.shell.console import emit, table
from accelbench.shell.outputs import checked_run_output
from accelbench.shell.recording_text import recording_document, recording_text
from drivers.clock import ScaledClock
from errormodel.errors import InputError
from thermo.launch.emulated import emulated
from thermo.launch.real import load_station
from thermo.safety.guardian_results import pending_results
from thermo.store.files import export_paths, export_recorded, open_existing_store
from thermo.store.spool.recover import warnings


def runs(store: str, as_json: bool) -> None:
    """Carry out `accelbench runs`; the arguments are its options."""
    with open_existing_store(store) as opened:
        tests = opened.tests()
    ids = {t.id for t in tests}
    left = [r for r in pending_results(store) if r.test_id in ids]
    left_behind = warnings(store)
    for line in left_behind:
        click.echo(f"warning: {line}", err=True)
    names = ("id", "name", "status", "runs", "readings", "outcome")
    made = table(*names, right=names[3:5], words=names[5:])
    for t in tests:
        made.add_row(t.id, t.name, t.status, str(t.runs), str(t.readings), t.outcome)
    document = {
        "tests": [
            {
                "id": t.id,
                "created_utc": t.created_utc,
                "name": t.name,
                "status": t.status,
                "outcome": t.outcome,
                "runs": t.runs,
                "readings": t.readings,
            }
            for t in tests
        ],
        "guardians": [
            {
                "test_id": r.test_id,
                "verified": r.verified,
                "needs_help": r.needs_help,
                "text": r.text,
            }
            for r in left
        ],
        "warnings": list(left_behind),
    }
    lines = [
        Text(f"guardian of {r.test_id}: {r.text}", style="bold red" if r.needs_help else "")
        for r in left
    ]
    emit(document, [made if tests else "no tests yet", *lines], as_json=as_json)


def export(test_id: str, store: str, out: Path, force: bool, as_json: bool) -> None:
    """Carry out `accelbench export`; the arguments are its options."""
    with open_existing_store(store) as opened:
        for path in export_paths(opened, test_id, out):
            checked_run_output(path, [], force=force)
        done = export_recorded(opened, test_id, out)
    document = {"files": [{"out": str(e.path), **recording_document(e.summary)} for e in done]}
    emit(document, [f"{e.path}: {recording_text(e.summary)}" for e in done], as_json=as_json)


def emulate(station: Path, speed: float | None, as_json: bool) -> None:
    """Carry out `accelbench emulate`; the arguments are its options."""
    config = load_station(station)
    planned = config.emulation
    rate = speed or (planned.speed if planned else 1.0)
    stop = threading.Event()

    def handle(number: int, frame: FrameType | None) -> None:
        stop.set()

    before = {n: signal.signal(n, handle) for n in (signal.SIGINT, signal.SIGTERM)}
    try:
        seed = planned.seed if planned else 1
        with emulated(config, ScaledClock(rate), seed=seed) as served:
            urls = {
                name: getattr(served.config, name).url for name in ("chamber", "digitiser", "head")
            }
            if as_json:
                click.echo(json.dumps({"station": config.name, "speed": rate, "urls": urls}))
            else:
                click.echo(f"{config.name} at {rate:g} times real time; Ctrl-C stops it")
                for name, url in urls.items():
                    click.echo(f"  {name:<10} {url}")
            sys.stdout.flush()
            while not stop.wait(0.2):
                pass
    except (OSError, ValueError) as err:
        reason = getattr(err, "strerror", None) or str(err)
        raise InputError(station, "url", f"cannot be served: {reason}") from None
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
