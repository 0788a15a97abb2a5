"""The report of a combined calibration: what joining rig and chamber said, then the rig's own."""

from collections.abc import Sequence

from sinscal.combine import Combination
from sinscal.combined import ChamberModel
from sinscal.judged import Judged
from sinscal.run import RigRun
from workbench.combine_output import ALL_COLUMNS, chamber_lines, combined_rows
from workbench.combined_file import CombinedResult
from workbench.figures_combine import combine_pictures
from workbench.outputs import REPORT_NAME
from workbench.page import Page, ReportTable, Section, render_page
from workbench.rig_calibrate_report import calibration_sections


def render_combined(
    made: Combination,
    judged: Judged,
    run: RigRun,
    chambers: Sequence[ChamberModel],
    result: CombinedResult,
) -> dict[str, bytes]:
    """Return the report's files by name, without writing any."""
    told = tuple(chamber_lines(result))
    mounted = ", ".join(f"{one.serial} on {a}" for a, one in result.accelerometers.items())
    first = Section(
        title="Rig and chamber",
        lines=(f"Accelerometers: {mounted}.",),
        points=told,
        pictures=tuple(combine_pictures(made, run, chambers, result)),
    )
    table = ReportTable(title="", columns=ALL_COLUMNS, rows=tuple(combined_rows(result)))
    page = Page(
        title=f"Rig and chamber combined, {result.mode}, of {result.run.source}",
        sections=(first, *calibration_sections(judged, run, result, table)),
    )
    return render_page(page, REPORT_NAME)
