"""`accelbench run`: a chamber test on instruments, or on emulated ones."""

import logging
import shlex
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import click

from accelbench.commands.run.dry_run import foresee_plan, plan_document, plan_text
from accelbench.commands.run.progress import watching
from accelbench.commands.run.text import Afterwards, run_document, run_text
from accelbench.shell.console import emit
from accelbench.shell.outputs import checked_run_output, prove_writable
from accelbench.shell.progress import working
from accelbench.shell.surroundings import current_shell
from drivers.clock import Clock, ScaledClock, SteppedClock
from drivers.errors import InstrumentError
from drivers.station import StationConfig
from errormodel.errors import InputError, WorkbenchError
from thermo.launch.emulated import run_emulated
from thermo.launch.real import load_station, run_on_station
from thermo.planning.default_station import default_station
from thermo.planning.plan import Plan, make_plan
from thermo.planning.sequence import Sequence as TestSequence
from thermo.planning.sequence import load_sequence, parse_sequence
from thermo.planning.text import mounting_lines
from thermo.run_in.verdict import RunInVerdict
from thermo.station.observers.live import LiveEstimate
from thermo.station.outcome import Observer, TestOutcome
from thermo.station.run_in import judge_stored
from thermo.station.uniformity import RampVerdict, judge_test
from thermo.store.database import parse_url, shown
from thermo.store.files import export_recorded, open_existing_store

log = logging.getLogger(__name__)

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


def run(
    sequence: Path | None,
    station: Path | None,
    store: str,
    resume: str | None,
    take_over: bool,
    dry_run: bool,
    out: Path | None,
    speed: float | None,
    verbose: bool,
    force: bool,
    as_json: bool,
) -> int:
    """Carry out `accelbench run`; the arguments are its options."""
    shell = current_shell()
    if not dry_run:
        shell.terminal.detach()
    inputs = [p for p in (sequence, station) if p is not None]
    if out is not None:
        checked_run_output(out, inputs, force=force)
    job = replace(_job(sequence, station, store, resume, speed), take_over=take_over)
    plan = make_plan(job.sequence, job.config, str(sequence or f"test {resume}"))
    if dry_run:
        with working("foreseeing the test"):
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
    shell.late_signals.install()
    with watching(plan.total_s, live) as watch:
        outcome = _run(job, watch.observers)
    after = _afterwards(job, plan, outcome, out)
    where = shown(parse_url(store))
    document = run_document(outcome, after, where, live)
    emit(document, run_text(outcome, after, where, verbose=verbose), as_json=as_json)
    if after.problems or not after.all_settled:
        return FAILED
    return exit_code(outcome, after.verdicts)


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
    if path is None:
        return
    if not path.resolve().parent.is_dir():
        raise InputError(shown(store), "--store", "its folder does not exist")
    prove_writable(path)


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


def _afterwards(job: _Job, plan: Plan, outcome: TestOutcome, out: Path | None) -> Afterwards:
    """Judge and export what there is; what goes wrong in it must never hide how the test ended."""
    done, problems = Afterwards(out=str(out) if out else ""), list[str]()

    @contextmanager
    def told(what: str) -> Generator[None]:
        try:
            yield
        except Exception as err:
            log.info("%s", what, exc_info=True)
            problems.append(f"{what}: {' '.join(str(err).split()) or type(err).__name__}")

    if not outcome.test_id:
        return done
    if outcome.status == "finished":
        with told("ramps not judged"), open_existing_store(job.store) as store:
            done = replace(done, verdicts=judge_test(plan, store.readings(outcome.test_id)))
        with told("run-in not judged"):
            done = replace(done, settled=_run_in(job, outcome))
    if job.resume is not None:
        with told("readings not counted"), open_existing_store(job.store) as store:
            voided = store.readings(outcome.test_id)["voided"]
            done = replace(done, in_store=len(voided), repeated=int((voided != "").sum()))
    if out is not None:
        with told(f"not exported to {out}"), open_existing_store(job.store) as store:
            if not any(t.readings for t in store.tests() if t.id == outcome.test_id):
                return replace(done, problems=tuple(problems))
            exported = export_recorded(store, outcome.test_id, out)
            done = replace(done, exported=tuple(str(e.path) for e in exported))
        if not done.exported:
            store_shown = shown(parse_url(job.store))
            again = ("export", outcome.test_id, "--store", store_shown, "--out", str(out))
            problems.append(f"get the readings with: accelbench {shlex.join(again)}")
    return replace(done, problems=tuple(problems))


def _run_in(job: _Job, outcome: TestOutcome) -> tuple[RunInVerdict, ...] | None:
    """Judge a run-in that ran to its end; None when there was none, empty when it cannot be."""
    if job.sequence.run_in is None:
        return None
    with open_existing_store(job.store) as store:
        try:
            return judge_stored(store, outcome.test_id, job.sequence.run_in)
        except WorkbenchError:
            return ()  # the reason of the test's end tells why
