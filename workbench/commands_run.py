"""`accelbench run`: a chamber test on instruments, or on emulated ones."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click

from drivers.clock import Clock, ScaledClock, SteppedClock
from drivers.errors import InstrumentError
from drivers.station import StationConfig
from errormodel.errors import InputError, WorkbenchError
from thermo.live import LiveEstimate
from thermo.plan import Plan, make_plan
from thermo.plan_text import mounting_lines
from thermo.run_in import RunInVerdict
from thermo.run_in_station import judge_stored
from thermo.sequence import Sequence as TestSequence
from thermo.sequence import load_sequence, parse_sequence
from thermo.station_emulated import default_station, run_emulated
from thermo.station_shell import load_station, run_on_station
from thermo.station_types import Observer, TestOutcome
from thermo.store_files import export_recorded, open_existing_store
from thermo.store_open import parse_url
from thermo.uniformity import RampVerdict, judge_test
from workbench.commands_store import store_option
from workbench.console import emit
from workbench.dry_run import foresee_plan, plan_document, plan_text
from workbench.outputs import checked_run_output, force_option, json_option
from workbench.progress import ProgressView
from workbench.run_in_output import run_in_document, run_in_text

DONE, FAILED = 0, 1


@dataclass(frozen=True, slots=True, kw_only=True)
class _Job:
    """What is to be run, on what, from where on."""

    sequence: TestSequence
    config: StationConfig
    emulated: bool
    clock: Clock
    resume: str | None
    store: str
    take_over: bool = False


@click.command()
@click.argument("sequence", type=Path, required=False, metavar="SEQUENCE.toml")
@click.option("--station", type=Path, help="Instruments; without it they are emulated.")
@store_option
@click.option("--resume", metavar="ID", help="Go on with an interrupted test.")
@click.option(
    "--take-over", is_flag=True, help="Take over a chamber that is found in use, or switched off."
)
@click.option("--dry-run", is_flag=True, help="Print the plan and do nothing.")
@click.option("--out", type=Path, help="Write the recorded run here when it is done.")
@click.option(
    "--speed",
    type=click.FloatRange(min=0, min_open=True),
    help="Multiple of real time, for emulated instruments only; as fast as can be if not given.",
)
@force_option
@json_option
def run(
    sequence: Path | None,
    station: Path | None,
    store: str,
    resume: str | None,
    take_over: bool,
    dry_run: bool,
    out: Path | None,
    speed: float | None,
    force: bool,
    as_json: bool,
) -> int:
    """Run a chamber test sequence.

    However it ends, the chamber is put into its safe condition and that is verified. Exit code 1:
    it ended early, a ramp was not uniform, an accelerometer has not settled in the cycles of a
    run-in, there is a complaint of the readings, or the safe condition is not verified. A chamber
    that somebody else uses is refused (exit code 2) unless --take-over says so. In Python:
    thermo.station_shell.run_on_station, thermo.station_emulated.run_emulated.
    """
    inputs = [p for p in (sequence, station) if p is not None]
    if out is not None:
        checked_run_output(out, inputs, force=force)
    job = replace(_job(sequence, station, store, resume, speed), take_over=take_over)
    plan = make_plan(job.sequence, job.config, str(sequence or f"test {resume}"))
    if dry_run:
        foreseen = foresee_plan(plan)
        emit(plan_document(plan, foreseen), plan_text(plan, foreseen), as_json=as_json)
        return DONE
    _check_store(store)
    for line in mounting_lines(job.sequence):
        click.echo(f"mounting: {line}", err=True)
    live = LiveEstimate(
        {a.serial: a.nominal_scale for a in job.sequence.accelerometers},
        mount_deg={a.serial: a.mount_deg for a in job.sequence.accelerometers},
    )
    with ProgressView(plan.total_s, live) as view:
        outcome = _run(job, (live, view))
    verdicts, exported = _after(job, plan, outcome, out)
    settled = _run_in(job, outcome)
    document = _document(outcome, verdicts, exported, store, live)
    document["run_in"] = None if settled is None else run_in_document(settled)
    text = [*_text(outcome, verdicts, exported, store), *run_in_text(settled or ())]
    emit(document, text, as_json=as_json)
    if settled is not None and not (settled and all(v.settled for v in settled)):
        return FAILED
    return exit_code(outcome, verdicts)


def exit_code(outcome: TestOutcome, verdicts: Sequence[RampVerdict]) -> int:
    """Return 1 when the test or a ramp failed; a ramp too short to be judged has not failed."""
    uniform = all(v.passed or v.readings == 0 for v in verdicts)
    return DONE if outcome.clean and uniform else FAILED


def _job(
    path: Path | None, station: Path | None, store: str, resume: str | None, speed: float | None
) -> _Job:
    given = load_sequence(path) if path is not None else None
    config = load_station(station) if station is not None else None
    if resume is not None:
        sequence, stored = _stored(store, resume)
        if given is not None and given != sequence:
            raise InputError(str(path), "", f"is not the sequence test {resume} was begun with")
        # instruments that were emulated went with their process: they are made anew
        if config is None and stored.name != default_station(sequence).name:
            config = stored
    elif given is not None:
        sequence = given
    else:
        raise click.UsageError("SEQUENCE.toml is missing; only --resume goes without it")
    emulated = config is None
    config = config or default_station(sequence)
    if emulated:
        clock: Clock = SteppedClock() if speed is None else ScaledClock(speed)
    else:
        if speed is not None and config.emulation is None:
            raise click.UsageError(
                "--speed is for emulated instruments; the station file has no [emulation]"
            )
        clock = ScaledClock(speed or (config.emulation.speed if config.emulation else 1.0))
    return _Job(
        sequence=sequence, config=config, emulated=emulated, clock=clock, resume=resume, store=store
    )


def _stored(store: str, test_id: str) -> tuple[TestSequence, StationConfig]:
    with open_existing_store(store) as opened:
        test = opened.test(test_id)
    return (
        parse_sequence(test.sequence_toml, f"test {test_id}"),
        StationConfig.model_validate_json(test.station_json),
    )


def _check_store(store: str) -> None:
    path = _file_of(store)
    if path is not None and not path.resolve().parent.is_dir():
        raise InputError(store, "--store", "its folder does not exist")


def _run(job: _Job, observers: Sequence[Observer]) -> TestOutcome:
    path = _file_of(job.store)
    is_new = path is not None and not path.exists()
    try:
        if job.emulated:
            return run_emulated(
                job.sequence,
                job.store,
                config=job.config,
                clock=job.clock,
                resume=job.resume,
                observers=observers,
                take_over=job.take_over,
            )
        return run_on_station(
            job.sequence,
            job.config,
            job.store,
            clock=job.clock,
            resume=job.resume,
            observers=observers,
            take_over=job.take_over,
        )
    except (InstrumentError, WorkbenchError):
        if path is not None and is_new:
            _forget_empty(path)
        raise


def _file_of(store: str) -> Path | None:
    parsed = parse_url(store)
    return Path(str(parsed.database)) if parsed.get_backend_name() == "sqlite" else None


def _forget_empty(path: Path) -> None:
    """Take away a store that was made for a test which could not be begun."""
    if not path.is_file():
        return
    with open_existing_store(path) as store:
        empty = not store.tests()
    if empty:
        for suffix in ("", "-wal", "-shm"):
            path.with_name(path.name + suffix).unlink(missing_ok=True)


def _after(
    job: _Job, plan: Plan, outcome: TestOutcome, out: Path | None
) -> tuple[tuple[RampVerdict, ...], list[str]]:
    """Judge the ramps of a test that finished, and export what there is."""
    if not outcome.test_id:
        return (), []
    with open_existing_store(job.store) as store:
        readings = store.readings(outcome.test_id)
        verdicts = judge_test(plan, readings) if outcome.status == "finished" else ()
        if out is None or readings.empty:
            return verdicts, []
        exported = export_recorded(store, outcome.test_id, out)
    return verdicts, [str(e.path) for e in exported]


def _run_in(job: _Job, outcome: TestOutcome) -> tuple[RunInVerdict, ...] | None:
    """Judge a run-in that ran to its end; None when there was none, empty when it cannot be."""
    if job.sequence.run_in is None or outcome.status != "finished":
        return None
    with open_existing_store(job.store) as store:
        try:
            return judge_stored(store, outcome.test_id, job.sequence.run_in)
        except WorkbenchError:
            return ()  # the reason of the test's end tells why


def _document(
    outcome: TestOutcome,
    verdicts: Sequence[RampVerdict],
    exported: Sequence[str],
    store: str,
    live: LiveEstimate,
) -> dict[str, Any]:
    return {
        "test_id": outcome.test_id,
        "status": outcome.status,
        "reason": outcome.reason,
        "readings": outcome.readings,
        "skipped": outcome.skipped,
        "flagged": outcome.flagged,
        "safe": {
            "verified": outcome.safe.verified,
            "commanded": outcome.safe.commanded,
            "steps": list(outcome.safe.steps),
        },
        "head_stopped": outcome.head_stopped,
        "complaints": list(outcome.complaints),
        "uniformity": [uniformity_document(v) for v in verdicts],
        "live": [
            {
                "serial": v.serial,
                "temp_c": v.temp_c,
                "k0_ug": v.k0_ug,
                "k0_sigma_ug": v.k0_sigma_ug,
                "k1_relative": v.k1,
                "k1_sigma_ppm": v.k1_sigma_ppm,
            }
            for v in live.values()
        ],
        "store": store,
        "exported": list(exported),
    }


def uniformity_document(v: RampVerdict) -> dict[str, Any]:
    """Return one ramp's verdict for JSON; rates in °C/min."""
    return {
        "serial": v.serial,
        "run": v.run,
        "segment": v.segment,
        "commanded_c_per_min": v.commanded,
        "measured_c_per_min": v.measured,
        "measured_sigma_c_per_min": v.measured_sigma,
        "share_inside": v.share_inside,
        "half_band_c_per_min": v.half_band,
        "readings": v.readings,
        "passed": v.passed,
        "sins_rate_c_per_min": v.sins_rate,
        "mismatch_percent": v.mismatch_percent,
        "sentence": v.sentence,
    }


def _text(
    outcome: TestOutcome, verdicts: Sequence[RampVerdict], exported: Sequence[str], store: str
) -> list[str]:
    lines = [f"test {outcome.test_id or '(not begun)'} {outcome.status}: {outcome.reason}"]
    lines.append(
        f"{outcome.readings} readings stored in {store}, {outcome.skipped} slots without a "
        f"reading, {outcome.flagged} readings flagged"
    )
    lines += [f"complaint: {text}" for text in outcome.complaints]
    if outcome.safe.commanded:
        safe = "verified" if outcome.safe.verified else "NOT VERIFIED: see to the chamber"
        lines.append(f"chamber's safe condition {safe}: {'; '.join(outcome.safe.steps)}")
    else:
        lines.append(f"chamber: not commanded; {'; '.join(outcome.safe.steps)}")
    lines += [v.sentence for v in verdicts]
    lines += [f"recorded run: {path}" for path in exported]
    if outcome.status != "finished" and outcome.test_id:
        lines.append(f"go on with: accelbench run --resume {outcome.test_id} --store {store}")
    return lines
