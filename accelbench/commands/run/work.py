"""`accelbench run`: a chamber test on instruments, or on emulated ones."""

import logging
import shlex
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import click

from accelbench.commands.run.progress import watching
from accelbench.commands.run.text import Afterwards, run_document, run_text
from accelbench.shell.console import emit
from accelbench.shell.foreseen_plan import foresee_plan, plan_document, plan_text
from accelbench.shell.outputs import checked_run_output, prove_writable
from accelbench.shell.progress import working
from accelbench.shell.surroundings import current_shell
from drivers.clock import Clock
from drivers.errors import InstrumentError
from errormodel.errors import InputError, WorkbenchError
from thermo.fitting.terms_wanted import TermsFile, read_terms
from thermo.launch.clocks import clock_of
from thermo.launch.detached import start_detached
from thermo.launch.emulated import run_emulated
from thermo.launch.notify import NoticeSender, read_notify
from thermo.launch.real import load_station, run_on_station
from thermo.planning.sequence import Sequence as TestSequence
from thermo.planning.sequence import load_sequence
from thermo.planning.text import mounting_lines
from thermo.run_in.verdict import RunInVerdict
from thermo.station.checks.run_in import judge_stored
from thermo.station.checks.uniformity import RampVerdict, judge_test
from thermo.station.job import Job, make_job, make_resumed_job
from thermo.station.observers.live import LiveEstimate
from thermo.station.observers.live_model import LIVE_TERMS
from thermo.station.outcome import Observer, TestOutcome
from thermo.store.database import display_url, parse_store_url
from thermo.store.files import export_recorded, open_existing_store

log = logging.getLogger(__name__)

DONE, FAILED = 0, 1


def run(
    sequence: Path | None,
    station: Path | None,
    store: str,
    resume: str | None,
    take_over: bool,
    dry_run: bool,
    detach: bool,
    notify: Path | None,
    out: Path | None,
    model: Path | None,
    speed: float | None,
    verbose: bool,
    force: bool,
    as_json: bool,
) -> int:
    """Carry out `accelbench run`; the arguments are its options."""
    shell = current_shell()
    if not dry_run:
        shell.terminal.detach()
    if detach and (dry_run or out is not None or model is not None):
        raise click.UsageError("--detach goes without --dry-run, --out and --model")
    inputs = [p for p in (sequence, station, model) if p is not None]
    if out is not None:
        checked_run_output(out, inputs, force=force)
    job = _job(sequence, station, store, resume)
    clock = clock_of(job, speed)
    if dry_run:
        with working("foreseeing the test"):
            foreseen = foresee_plan(job.plan)
        emit(plan_document(job.plan, foreseen), plan_text(job.plan, foreseen), as_json=as_json)
        return DONE
    _check_store(store)
    for line in mounting_lines(job.sequence):
        click.echo(f"mounting: {line}", err=True)
    if detach:
        return _detach(job, speed, notify, take_over=take_over, as_json=as_json)
    sender = NoticeSender(store, read_notify(notify))
    live = live_estimate(job.sequence, model)
    shell.late_signals.install()
    with watching(job.plan.total_s, live) as watch:
        outcome = _run(job, clock, watch.observers, sender, take_over=take_over)
    sender.close()
    after = _afterwards(job, outcome, out)
    where = display_url(parse_store_url(store))
    document = run_document(outcome, after, where, live)
    emit(document, run_text(outcome, after, where, verbose=verbose), as_json=as_json)
    if after.problems or not after.all_settled:
        return FAILED
    return exit_code(outcome, after.verdicts)


def live_estimate(sequence: TestSequence, path: Path | None) -> LiveEstimate:
    """Return the live estimate of a test, by the terms of a TERMS.toml where one is given.

    Raises
    ------
    InputError
        If the terms are none of the library or cannot be estimated live.
    """
    given = read_terms(path) if path is not None else TermsFile()
    try:
        return LiveEstimate(
            {a.serial: a.nominal_scale for a in sequence.accelerometers},
            mount_deg={a.serial: a.mount_deg for a in sequence.accelerometers},
            terms=given.terms or LIVE_TERMS,
            start=given.start,
            t_ref_c=given.t_ref_c,
        )
    except ValueError as err:
        raise InputError(path or "the live estimate", "terms", str(err)) from None


def exit_code(outcome: TestOutcome, verdicts: Sequence[RampVerdict]) -> int:
    """Return 1 when the test or a ramp failed; a ramp too short to be judged has not failed."""
    uniform = all(v.passed or v.readings == 0 for v in verdicts)
    return DONE if outcome.clean and uniform else FAILED


def _job(path: Path | None, station: Path | None, store: str, resume: str | None) -> Job:
    given = load_sequence(path) if path is not None else None
    config = load_station(station) if station is not None else None
    if resume is not None:
        return make_resumed_job(resume, store, config, sequence=given, source=str(path))
    if given is None:
        raise click.UsageError("SEQUENCE.toml is missing; only --resume works without it")
    return make_job(given, store, config, source=str(path))


def _check_store(store: str) -> None:
    path = _file_of(store)
    if path is None:
        return
    if not path.resolve().parent.is_dir():
        raise InputError(display_url(store), "--store", "its folder does not exist")
    prove_writable(path)


def _detach(
    job: Job, speed: float | None, notify: Path | None, *, take_over: bool, as_json: bool
) -> int:
    """Start the test in a process of its own."""
    read_notify(notify)  # what is wrong with it is told here
    with _no_empty_store_left(job.store_url):
        started = start_detached(job, speed=speed, take_over=take_over, notify=notify)
    where = display_url(parse_store_url(job.store_url))
    abort = shlex.join(["control", "abort", started.test_id, "--store", where])
    document = {"test_id": started.test_id, "pid": started.pid, "store": where, "detached": True}
    lines = [f"test {started.test_id} runs in process {started.pid}", f"accelbench {abort} ends it"]
    emit(document, lines, as_json=as_json)
    return DONE


def _run(
    job: Job,
    clock: Clock,
    observers: Sequence[Observer],
    sender: NoticeSender,
    *,
    take_over: bool,
) -> TestOutcome:
    run_job = run_emulated if job.emulated else run_on_station
    with _no_empty_store_left(job.store_url):
        return run_job(
            job,
            clock=clock,
            observers=observers,
            take_over=take_over,
            on_begun=lambda _: sender.start(),
        )


@contextmanager
def _no_empty_store_left(store_url: str) -> Generator[None]:
    """Take a store away again that was made for a test which could not be begun."""
    path = _file_of(store_url)
    is_new = path is not None and not path.exists()
    try:
        yield
    except (InstrumentError, WorkbenchError):
        if path is not None and is_new:
            _forget_empty(path)
        raise


def _file_of(store: str) -> Path | None:
    parsed = parse_store_url(store)
    return Path(str(parsed.database)) if parsed.get_backend_name() == "sqlite" else None


def _forget_empty(path: Path) -> None:
    """Take a store without any test away."""
    if not path.is_file():
        return
    with open_existing_store(path) as store:
        empty = not store.tests()
    if empty:
        for suffix in ("", "-wal", "-shm"):
            path.with_name(path.name + suffix).unlink(missing_ok=True)


def _afterwards(job: Job, outcome: TestOutcome, out: Path | None) -> Afterwards:
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
        with told("ramps not judged"), open_existing_store(job.store_url) as store:
            done = replace(done, verdicts=judge_test(job.plan, store.readings(outcome.test_id)))
        with told("run-in not judged"):
            done = replace(done, settled=_run_in(job, outcome))
    if job.resume is not None:
        with told("readings not counted"), open_existing_store(job.store_url) as store:
            voided = store.readings(outcome.test_id)["voided"]
            done = replace(done, in_store=len(voided), repeated=int((voided != "").sum()))
    if out is not None:
        with told(f"not exported to {out}"), open_existing_store(job.store_url) as store:
            if not any(t.readings for t in store.tests() if t.id == outcome.test_id):
                return replace(done, problems=tuple(problems))
            exported = export_recorded(store, outcome.test_id, out)
            done = replace(done, exported=tuple(str(e.path) for e in exported))
        if not done.exported:
            store_shown = display_url(parse_store_url(job.store_url))
            again = ("export", outcome.test_id, "--store", store_shown, "--out", str(out))
            problems.append(f"get the readings with: accelbench {shlex.join(again)}")
    return replace(done, problems=tuple(problems))


def _run_in(job: Job, outcome: TestOutcome) -> tuple[RunInVerdict, ...] | None:
    """Judge a run-in that ran to its end; None when there was none, empty when it cannot be."""
    if job.sequence.run_in is None:
        return None
    with open_existing_store(job.store_url) as store:
        try:
            return judge_stored(store, outcome.test_id, job.sequence.run_in)
        except WorkbenchError:
            return ()  # the reason of the test's end tells why
