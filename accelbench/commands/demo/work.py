"""`accelbench demo`: everything once, on instruments that are not there."""

from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
from rich.console import RenderableType

from accelbench.commands.demo.whole_job import (
    HIDDEN,
    DemoResult,
    demo_sequence,
    fresh_folder,
    run_demo,
)
from accelbench.commands.fit.text import fit_document, summary_part
from accelbench.commands.run.progress import watching
from accelbench.commands.run.text import uniformity_document
from accelbench.commands.run.work import exit_code
from accelbench.shell.console import emit
from accelbench.shell.surroundings import current_shell
from errormodel.errors import InputError
from thermo.fitting.findings import find_loop
from thermo.planning.default_station import default_station
from thermo.planning.plan import make_plan
from thermo.planning.sequence import Sequence
from thermo.station.observers.live import LiveEstimate
from thermo.station.outcome import Observer
from thermo.twin.planted import plantable


def demo(out: Path, hidden: str | None, speed: float | None, seed: int, as_json: bool) -> int:
    """Carry out `accelbench demo`; the arguments are its options."""
    shell = current_shell()
    shell.terminal.detach()
    if hidden is None and seed != 1:
        raise InputError("demo", "--seed", "is allowed only with --hidden")
    if hidden is not None:
        return _hidden(out, hidden, speed, seed, as_json)
    sequence = demo_sequence()
    plan = make_plan(sequence, default_station(sequence))
    folder = fresh_folder(out)
    live = LiveEstimate({a.serial: a.nominal_scale for a in sequence.accelerometers})
    shell.late_signals.install()
    with watching(plan.total_s, live) as watch:

        def tell(text: str) -> None:
            shell.late_signals.release()  # the test is over and was finished
            watch.tell(text)

        result = run_demo(
            folder, sequence=sequence, speed=speed, observers=watch.observers, tell=tell
        )
    emit(_document(result), _text(result), as_json=as_json)
    return exit_code(result.outcome, result.verdicts)


def _hidden(out: Path, effect: str, speed: float | None, seed: int, as_json: bool) -> int:
    from accelbench.commands.demo.hidden import run_hidden_demo  # its search takes its second
    from accelbench.commands.demo.hidden_text import hidden_document, hidden_text

    plantable(effect, seed)
    if speed is not None:
        raise InputError("demo", "--speed", "is allowed only without --hidden")

    @contextmanager
    def watch(sequence: Sequence) -> Generator[tuple[Observer, ...]]:
        plan = make_plan(sequence, default_station(sequence))
        with watching(plan.total_s) as watched:
            yield watched.observers

    result = run_hidden_demo(fresh_folder(out), effect, watch=watch, seed=seed, tell=_tell)
    emit(hidden_document(result), hidden_text(result), as_json=as_json)
    return 0 if result.right else 1


def _tell(line: str) -> None:
    click.echo(line, err=True)


def _document(result: DemoResult) -> dict[str, Any]:
    outcome = result.outcome
    document: dict[str, Any] = {
        "folder": str(result.folder),
        "test_id": outcome.test_id,
        "status": outcome.status,
        "reason": outcome.reason,
        "safe": {"verified": outcome.safe.verified, "steps": list(outcome.safe.steps)},
        "uniformity": [uniformity_document(v) for v in result.verdicts],
        "seconds": result.seconds,
        "hidden": {serial: dict(effects) for serial, effects in HIDDEN.items()},
        "report": str(result.report) if result.report else None,
    }
    if result.model is not None:
        document["fit"] = fit_document(result.fits, result.model)
    return document


def _text(result: DemoResult) -> Iterator[RenderableType]:
    outcome = result.outcome
    if result.model is None or result.report is None:
        yield f"the test ended early: {outcome.status}, {outcome.reason}"
        return
    passed = sum(v.passed for v in result.verdicts)
    safe = "verified" if outcome.safe.verified else "NOT VERIFIED"
    yield (
        f"{outcome.readings} readings in {len(result.fits[0].channel.run_ids)} runs; "
        f"{passed} of {len(result.verdicts)} ramps uniform; chamber's safe condition {safe}; "
        f"{result.seconds:.0f} s in all"
    )
    yield ""
    yield from summary_part(result.fits)
    for one in result.fits:
        sentence = find_loop(one).sentence
        if sentence:
            yield f"{one.serial}: {sentence}."
        if one.serial in HIDDEN:
            size_ug = 1e6 * HIDDEN[one.serial]["bias_hysteresis"]
            yield f"({one.serial} was given a bias hysteresis of ±{size_ug:g} µg; no fit knows it.)"
    yield f"report: {result.report}"
