"""The report of a combined calibration: what joining rig and chamber said, then the rig's own."""

from collections.abc import Sequence

from accelbench.commands.combine.figures import combine_pictures
from accelbench.commands.combine.text import ALL_COLUMNS, chamber_lines, combined_rows
from accelbench.commands.rig_calibrate.page import (
    calibration_sections,
    in_words_first,
    verdict_boxes,
)
from accelbench.joint.result_file import CombinedResult
from accelbench.shell.outputs import REPORT_NAME
from accelbench.shell.page import Banner, Page, ReportTable, Section, render_page
from sinscal.combination.combine import Combination
from sinscal.judgement.judge import Judged
from sinscal.model.chamber import ChamberModel
from sinscal.recording.run import RigRun

USE = "Use the combined calibration."
MEND = "Use neither rig's nor chamber's values of these until it is known which is wrong."


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
    table = ReportTable(title="", columns=ALL_COLUMNS, rows=in_words_first(combined_rows(result)))
    worth = told[1]
    agrees = not result.contradictions and result.converged
    page = Page(
        verdicts=(
            Banner(
                text="; ".join(result.contradictions)
                or ("rig and chamber agree" if agrees else "not converged"),
                state="good" if agrees else "bad",
                todo=USE if agrees else MEND,
            ),
            *verdict_boxes(result),
            Banner(text=worth),
        ),
        title=f"Rig and chamber combined, {result.mode}, of {mounted}, {result.run.source}",
        sections=(first, *calibration_sections(judged, run, result, table)),
    )
    return render_page(page, REPORT_NAME)
