"""`accelbench runin`: whether the accelerometers of recorded cycles have settled."""

from collections.abc import Sequence
from pathlib import Path

from accelbench.commands.run_in.text import (
    DEFINITION,
    run_in_document,
    run_in_text,
)
from accelbench.shell.inputs import add_reading_counts, read_with_doubts
from accelbench.shell.outputs import Results, check_results
from accelbench.shell.progress import working
from errormodel.errors import InputError
from errormodel.io.toml import check
from thermo.planning.run_in_rule import RunInRule
from thermo.planning.sequence import load_sequence
from thermo.recording.files import RecordedRuns
from thermo.run_in.cycles import in_order, judge_runs
from thermo.run_in.verdict import RunInVerdict

SETTLED, NOT_SETTLED = 0, 1
DEFAULTS = {"k0_limit_ug": 15.0, "k1_limit_ppm": 15.0, "confidence": 0.95, "t_ref_c": 25.0}


def runin(
    files: tuple[str, ...],
    sequence: Path | None,
    window: int,
    report: Path | None,
    trust_units: bool,
    force: bool,
    as_json: bool,
    **given: float | bool | None,
) -> int:
    """Carry out `accelbench runin`; the arguments are its options."""
    rule = _rule(sequence, given)
    check_results(None, report, [], force=force)
    runs, doubts = read_with_doubts([Path(name) for name in files], trust_units=trust_units)
    with working("judging the run-in"):
        verdicts = judge_runs(runs, rule, window=window)
    document = {
        "accelerometers": run_in_document(verdicts),
        "definition": DEFINITION,
        "rule": _rule_text(rule),
        "runs": list(in_order(runs)),
        "report": None,
    }
    add_reading_counts(document, runs, doubts)
    results = Results(document, [*run_in_text(verdicts), *doubts])
    results.add_report(report, lambda: _pages(verdicts, runs, rule))
    results.write(as_json=as_json)
    return SETTLED if not doubts and all(v.settled for v in verdicts) else NOT_SETTLED


def _rule(sequence: Path | None, given: dict[str, float | bool | None]) -> RunInRule:
    """Return the rule of a sequence or of the options, whichever were given."""
    chosen = {name: value for name, value in given.items() if value is not None}
    if sequence is None:
        return check({**DEFAULTS, **chosen}, RunInRule, "options")
    rule = load_sequence(sequence).run_in
    if rule is None:
        raise InputError(sequence, "run_in", "is missing, expected a section with the limits")
    return check({**rule.model_dump(), **chosen}, RunInRule, "options")


def _rule_text(rule: RunInRule) -> str:
    return (
        f"Settled: with a confidence of {100 * rule.confidence:g} %, neither will K0 ever again "
        f"change by more than {rule.k0_limit_ug:g} µg nor K1 by more than {rule.k1_limit_ppm:g} "
        f"ppm at {rule.t_ref_c:g} °C from their values in the last cycle, due to relaxation; the "
        f"scatter between runs is not counted."
        + (
            " It is assumed that there is no process slower than the relaxation."
            if rule.nothing_slow
            else ""
        )
    )


def _pages(
    verdicts: Sequence[RunInVerdict], runs: RecordedRuns, rule: RunInRule
) -> dict[str, bytes]:
    from accelbench.commands.run_in.page import render_run_in  # matplotlib takes its second

    return render_run_in(verdicts, runs, _rule_text(rule))
