"""A combined calibration told in words."""

from collections.abc import Iterator

from rich.console import RenderableType

from accelbench.commands.rig_calibrate.text import (
    COLUMNS,
    judgement_lines,
    parameter_rows,
)
from accelbench.joint.result_file import CombinedResult
from accelbench.shell.console import number, table

HELPS = 0.99  # of the flight's error beforehand: above it combining did not help
MOVED = "moved, chamber's σ"
ALL_COLUMNS = (*COLUMNS, MOVED)


def combined_rows(result: CombinedResult) -> Iterator[tuple[str, ...]]:
    """Yield a row for each parameter: as of a rig calibration, and how far it was moved."""
    for row in parameter_rows(result):
        pull = result.prior_pull.get(row[0])
        yield (*row, "" if pull is None else f"{pull:+.2f}".replace("-", "−"))


def chamber_lines(result: CombinedResult) -> Iterator[str]:
    """Tell how rig and chamber agree, and what the calibration is worth in flight."""
    test, flight = result.chamber_test, result.flight_m
    yield (
        f"rig against chamber: χ² {number(test.chi2)} with {test.dof} degrees of freedom, "
        f"p {number(test.p_value, 2)} (reported as a contradiction if p < 0.001)"
    )
    yield (
        f"flight error ρ after an hour: {flight.no_thermal:.0f} m without thermal model, "
        f"{flight.before:.0f} m with it applied beforehand, {flight.combined:.0f} m combined"
    )
    if flight.combined > HELPS * flight.before:
        yield (
            "for this flight, combining rig and chamber is not better than applying the models "
            "first"
        )
    for line in result.contradictions:
        yield f"contradiction: {line}"
    if not result.converged:
        yield "not converged: do not use the values"


def combined_text(result: CombinedResult) -> Iterator[RenderableType]:
    """Tell a combined calibration in words and a table."""
    made = table(*ALL_COLUMNS, right=ALL_COLUMNS[2:], keys=2)
    for row in combined_rows(result):
        made.add_row(*row)
    yield made
    yield ""
    yield from chamber_lines(result)
    yield from judgement_lines(result)
