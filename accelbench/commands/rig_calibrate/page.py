"""The report of a rig calibration: one HTML file and its pictures."""

from collections.abc import Iterable

from accelbench.commands.rig_calibrate.figures import calibration_pictures, correlations_of
from accelbench.commands.rig_calibrate.text import (
    COLUMNS,
    PASSED,
    calibration_sentences,
    not_made,
    observability_lines,
    parameter_rows,
    protection_lines,
    verdict,
)
from accelbench.shell.console import in_words, number
from accelbench.shell.outputs import REPORT_NAME
from accelbench.shell.page import (
    Banner,
    Page,
    ReportTable,
    Section,
    correlation_tables,
    render_page,
)
from sinscal.judgement.judge import Judged
from sinscal.judgement.result_file import ResultContent
from sinscal.recording.run import NavRun, RigRun

LISTED = 30  # refused measurements
USE = "Use the estimates with their sigmas; the section Application says how."
MEND = "Do not use the estimates; remove the cause and calibrate again."
REST = "Nothing, if the other tests are enough; else record what these need."
NAMES = (
    "In the result file and in options the words are joined by underscores, and accelerometer is "
    "accel."
)
TERMS = (
    "An innovation is the difference between a measurement and its prediction by the filter. NIS "
    "is its square divided by its variance, 1 on average if the sigmas are right. White: "
    "successive innovations are uncorrelated.",
    "A singular value is the improvement of a direction in parameter space over the prior; 0 "
    "means that the run does not determine it.",
)


def render_calibration(
    judged: Judged, run: RigRun | NavRun, result: ResultContent
) -> dict[str, bytes]:
    """Return the report's files by name, without writing any.

    Parameters
    ----------
    judged : Judged
    run : RigRun or NavRun
        What was calibrated with.
    result : ResultContent
        Made of both.
    """
    estimates = ReportTable(title="", columns=COLUMNS, rows=in_words_first(parameter_rows(result)))
    page = Page(
        title=f"Rig calibration, {result.mode}, of {result.run.source}",
        verdicts=verdict_boxes(result),
        sections=calibration_sections(judged, run, result, estimates),
    )
    return render_page(page, REPORT_NAME)


def in_words_first(rows: Iterable[tuple[str, ...]]) -> tuple[tuple[str, ...], ...]:
    """Return rows whose first cell, a parameter's name, is in words."""
    return tuple((in_words(name), *rest) for name, *rest in rows)


def verdict_boxes(result: ResultContent) -> tuple[Banner, ...]:
    """Return whether the calibration can be trusted, and what was not tested."""
    text, left = verdict(result), not_made(result)
    if not text.startswith(PASSED):
        return (Banner(text=text, state="bad", todo=MEND),)
    passed = Banner(text=PASSED, state="good", todo=USE)
    return (passed, Banner(text=left, state="open", todo=REST)) if left else (passed,)


def calibration_sections(
    judged: Judged, run: RigRun | NavRun, result: ResultContent, estimates: ReportTable
) -> tuple[Section, ...]:
    """Return the sections of a calibration's report; `estimates` is the table of parameters."""
    drawn, *others = calibration_pictures(judged, run, result)
    _, *rests_on = calibration_sentences(result, listed=False)
    return (
        Section(title="Basis of the verdict", points=(*rests_on, *TERMS)),
        _warnings(result),
        Section(
            title="Estimates",
            lines=("Measured = true + error; all parameters are errors of the sensors.", NAMES),
            table=estimates,
            words=(0, 1),
            pictures=(drawn,),
        ),
        *_protection(result),
        Section(
            title="Separability of the parameters",
            points=tuple(observability_lines(result)),
            tables=correlation_tables(*correlations_of(judged)),
            words=(0, 1),
        ),
        Section(title="Pictures", pictures=tuple(others)),
        _refused(result),
        _source(result),
        Section(
            title="Application",
            points=(result.formula, result.signs, result.axes, result.units, result.gauge),
        ),
    )


def _protection(result: ResultContent) -> tuple[Section, ...]:
    if not result.protection:
        return ()
    said, *points = protection_lines(result)
    lines = (f"{said[0].upper()}{said[1:]}.",)
    return (Section(title="Protection levels", lines=lines, points=tuple(points)),)


def _warnings(result: ResultContent) -> Section:
    if not result.warnings:
        return Section(title="Warnings", lines=("None.",))
    return Section(title="Warnings", points=result.warnings)


def _refused(result: ResultContent) -> Section:
    listed = result.refused["measurements"]
    rows = tuple(
        (str(r["cycle"]), r["channel"], f"{r['time_s']:.1f}", f"{r['sigmas']:+.1f}")
        for r in listed[:LISTED]
    )
    flagged = ", ".join(str(n) for n in result.refused["flagged_rows_by_cycle"])
    left = result.refused["n"] - len(rows)
    return Section(
        title="Refused measurements",
        lines=(f"{result.refused['n']} refused by the gate; rows flagged by cycle: {flagged}.",),
        after=(f"{left} more are in the result file.",) if left > 0 else (),
        table=ReportTable(title="", columns=("cycle", "row", "time, s", "sigmas"), rows=rows)
        if rows
        else None,
        words=(1,),
    )


def _source(result: ResultContent) -> Section:
    run, noise = result.run, result.noise
    points = [
        f"{run.source}: {run.rows} rows in {run.cycles} cycle(s), SHA-256 {run.digest}",
        f"latitude {run.latitude_deg:.4f}°, height {number(run.height_m)} m, "
        f"gravity {result.gravity_m_s2:.6f} m/s²; reference temperature {result.t_ref_c:g} °C",
        "noise used: " + ", ".join(f"{k} {v:.3g}" for k, v in noise.items() if v),
        f"result {result.result_id}, format {result.format} {result.format_version}, made by "
        f"{result.software}",
    ]
    return Section(title="Source", points=tuple(points))
