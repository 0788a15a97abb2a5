"""`accelbench stability`: the same accelerometers, run after run."""

from pathlib import Path

import click

from accelbench.commands.stability.document import stability_document
from accelbench.commands.stability.text import stability_text
from accelbench.shell.inputs import add_reading_counts, read_with_doubts
from accelbench.shell.outputs import Results, check_results
from accelbench.shell.progress import working
from errormodel.errors import InputError, NotSeparableError
from thermo.fitting.fit import TermsFile, read_terms
from thermo.recording.files import RecordedRuns
from thermo.recording.units_check import checked_units
from thermo.stability.judge import Stability, judge_stability
from thermo.stability.limits import LimitsFile, read_limits
from thermo.store.files import open_existing_store, stored_runs


def stability(
    files: tuple[str, ...],
    store: str | None,
    test_id: str | None,
    terms: Path | None,
    at_c: tuple[float, ...],
    limits: Path | None,
    between: Path | None,
    report: Path | None,
    trust_units: bool,
    force: bool,
    as_json: bool,
) -> int:
    """Carry out `accelbench stability`; the arguments are its options."""
    check_results(None, report, [], force=force)
    asked = _limits(limits, between)
    wanted = read_terms(terms) if terms else None
    record, doubts = _runs(files, store, test_id, trust_units=trust_units)
    result = _judge(record, wanted, at_c, asked)
    results = Results(stability_document(result), [*stability_text(result), *doubts])
    add_reading_counts(results.document, record, doubts)
    results.add_report(report, lambda: _report(result, record))
    results.write(as_json=as_json)
    return 1 if doubts or result.failed else 0


def _report(result: Stability, record: RecordedRuns) -> dict[str, bytes]:
    from accelbench.commands.stability.page import render_stability  # matplotlib takes its second

    return render_stability(result, record)


def _limits(limits: Path | None, between: Path | None) -> LimitsFile:
    asked = read_limits(limits) if limits else LimitsFile()
    if between is None:
        return asked
    said = read_limits(between)
    if said != LimitsFile(between=said.between):
        raise InputError(between, "", "expected [[between]] only; limits go into --limits")
    return asked.model_copy(update={"between": (*asked.between, *said.between)})


def _runs(
    files: tuple[str, ...], store: str | None, test_id: str | None, *, trust_units: bool
) -> tuple[RecordedRuns, tuple[str, ...]]:
    if store is None and test_id is None:
        if not files:
            raise click.UsageError("no RUN.csv given, expected one or more, or --store and --test")
        return read_with_doubts([Path(name) for name in files], trust_units=trust_units)
    if store is None or test_id is None or files:
        raise click.UsageError("expected --store and --test together and no RUN.csv beside them")
    with open_existing_store(store) as opened:
        record = stored_runs(opened, test_id)
    return record, checked_units(record, trust_units=trust_units)


def _judge(
    record: RecordedRuns, terms: TermsFile | None, at_c: tuple[float, ...], limits: LimitsFile
) -> Stability:
    """Compare; a complaint about an accelerometer is told with the files it stands in."""
    try:
        with working("comparing the runs"):
            return judge_stability(record, terms=terms, at_c=at_c, limits=limits)
    except (InputError, NotSeparableError) as err:
        if str(err).startswith(record.source):
            raise
        raise InputError(record.source, "", str(err)) from None
