"""The report of a run-in: one HTML file and its pictures."""

from collections.abc import Iterator, Sequence

from accelbench.commands.run_in.figures import MAX_PICTURES, run_in_pictures
from accelbench.commands.run_in.text import COLUMNS, DEFINITION, law_sentence, run_in_rows
from accelbench.shell.outputs import REPORT_NAME
from accelbench.shell.page import Banner, Page, ReportTable, Section, measured_on, render_page
from thermo.recording.files import RecordedRuns
from thermo.run_in.cycles import in_order
from thermo.run_in.verdict import RunInVerdict

SETTLED = "Go on to the calibration."
ON = "Go on cycling, then judge again."
TERMS = (
    "κ is the number of cycles in which the change falls to 1/e (exponential) or to half (slow "
    "law).",
    "Excluded at odds of 20: given the cycles, the law is twenty times less likely than the other.",
    "Limits in brackets have 95 % coverage for so few runs; if the runs show no spread, its "
    "upper limit is given (<).",
)


def render_run_in(
    verdicts: Sequence[RunInVerdict], runs: RecordedRuns, rule: str
) -> dict[str, bytes]:
    """Return the report's files by name, without writing any.

    Parameters
    ----------
    verdicts : sequence of RunInVerdict
    runs : RecordedRuns
        The cycles that were judged.
    rule : str
        What settled means here.
    """
    page = Page(
        title=f"Run-in of {', '.join(v.serial for v in verdicts):.80}",
        verdicts=tuple(
            Banner(
                text=v.sentence,
                state="good" if v.settled else "open",
                todo=SETTLED if v.settled else ON,
            )
            for v in verdicts
        ),
        measured=measured_on(runs),
        sections=tuple(_sections(verdicts, runs, rule)),
    )
    return render_page(page, REPORT_NAME)


def _sections(verdicts: Sequence[RunInVerdict], runs: RecordedRuns, rule: str) -> Iterator[Section]:
    yield Section(
        title="Result",
        points=tuple(f"{v.serial}: {law_sentence(v)}." for v in verdicts),
        tables=(ReportTable(columns=COLUMNS, rows=tuple(run_in_rows(verdicts))),),
        words=(0, 1, len(COLUMNS) - 1),
        after=(DEFINITION, rule),
    )
    unpictured = len(verdicts) - MAX_PICTURES
    told = f"{unpictured} further accelerometers have no figures of their own; they are in the "
    yield Section(
        title="Figures",
        lines=(f"{told}table.",) if unpictured > 0 else (),
        pictures=tuple(run_in_pictures(verdicts)),
    )
    yield Section(title="How to read it", points=TERMS)
    rows = tuple((str(k), run, runs.digest(run)) for k, run in enumerate(in_order(runs), 1))
    yield Section(
        title="Sources",
        tables=(ReportTable(columns=("cycle", "run", "SHA-256 of the content"), rows=rows),),
        words=(0, 1, 2),
    )
