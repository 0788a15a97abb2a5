"""The report of run-to-run stability: one HTML file and its pictures."""

from collections.abc import Iterator, Mapping

from accelbench.commands.stability.document import definition
from accelbench.commands.stability.figures import (
    MAX_ACCELEROMETERS,
    draw_overview,
    stability_pictures,
)
from accelbench.commands.stability.text import (
    COLUMNS,
    LIMITS_TEXT,
    coefficient_row,
    component_lines,
    criterion_text,
    headline,
    limits_text,
    movements,
    sigma_text,
    stability_sentences,
    summary_row,
)
from accelbench.shell.outputs import REPORT_NAME
from accelbench.shell.page import (
    SOURCE_COLUMNS,
    Banner,
    BannerState,
    Page,
    ReportTable,
    Section,
    measured_on,
    render_page,
    source_rows,
)
from accelbench.shell.plotting import Picture
from thermo.recording.files import RecordedRuns
from thermo.stability.components import FACTORS
from thermo.stability.judge import AccelerometerStability, Stability

CONVENTIONS = (
    "1 σ between runs is the standard deviation of the coefficient itself; the variance of each "
    "run's estimation error (white noise and drift) is subtracted.",
    "Limits of a sigma hold for few runs (law of the weighted sum of squares, the sigmas of the "
    "estimation being estimates too); those of max − min and of curve distances hold in 95 % of "
    "cases or more. If the runs show no difference, the upper limit of the sigma is given (<). "
    f"{LIMITS_TEXT[0].upper()}{LIMITS_TEXT[1:]}.",
    "An accelerometer fails if a limit is significantly exceeded: one within all its limits "
    "fails in at most 5 % of cases. Pass means confirmed within the limits; undecided, that "
    "these runs cannot decide.",
    "The p-value of the trend is the probability of an equally steep trend by chance, in time if "
    "the starts are recorded, else from run to run.",
    "Spread is the rms of the K0 curves of runs and directions about their mean, as likely too "
    "high as too low for any number of runs; bend, the rms of that mean about a straight line. "
    "The rank is by spread. A grade is given if the upper limits satisfy it; a better grade in "
    "brackets is not excluded by the runs.",
    "A change common to all accelerometers in a run is attributed to the station and not counted "
    "against them.",
)


def render_stability(result: Stability, runs: RecordedRuns) -> dict[str, bytes]:
    """Return the report's files by name, without writing any.

    Parameters
    ----------
    result : Stability
    runs : RecordedRuns
        What was compared.
    """
    serials = ", ".join(a.serial for a in result.accelerometers)
    sections = (*_opening(result), *_details(result), *_closing(runs))
    page = Page(
        title=f"Run-to-run stability of {serials:.80}",
        verdicts=tuple(_verdicts(result)),
        measured=measured_on(runs),
        sections=sections,
    )
    return render_page(page, REPORT_NAME)


STATES: Mapping[str, BannerState] = {"pass": "good", "fail": "bad", "undecided": "open"}

TODO: Mapping[str, str] = {
    "fail": "Reject the accelerometer, or remove the cause and test it again.",
    "undecided": "Record more runs of it; every run narrows the limits.",
    "pass": "Nothing; it is confirmed within its limits.",
}
MOVED = "Find out what was changed at the station or on the accelerometer then."
LIMITS = "For a verdict give the limits with --limits LIMITS.toml."


def _verdicts(result: Stability) -> Iterator[Banner]:
    """Yield a box for each verdict with the accelerometers that have it, the worst first."""
    for word in ("fail", "undecided", "pass"):
        mine = [a for a in result.accelerometers if a.verdict == word]
        if mine:
            why = [f"{a.serial}, {criterion_text(c)}" for a in mine for c in a.criteria
                   if c.verdict == word != "pass"]  # fmt: skip
            told = f"{', '.join(a.serial for a in mine)}: {word}"
            yield Banner(text="; ".join((told, *why)), state=STATES[word], todo=TODO[word])
    for one in result.accelerometers:
        for line in movements(one):
            yield Banner(text=f"{one.serial}: {line}", state="open", todo=MOVED)
    if not any(a.verdict in STATES for a in result.accelerometers):
        yield Banner(text="no limits were given: no verdict", todo=LIMITS)


def _opening(result: Stability) -> Iterator[Section]:
    ranked = sorted(result.accelerometers, key=lambda a: a.rank)
    names = ("serial", "rank", "verdict", "grade", "runs", "K0 1σ, µg", "K0 limits")
    names += ("K0 max−min, µg", "K1 1σ, ppm", "curves rms, µg", "curves max, µg")
    yield Section(
        title="Result",
        lines=tuple(line.strip() for line in headline(result)),
        table=ReportTable(
            title="", columns=names, rows=tuple(tuple(summary_row(a)) for a in ranked)
        ),
        words=(0, 1, 2, 3),
        pictures=(draw_overview(result),),
    )
    yield Section(
        title="Definition of repeatability",
        lines=(definition(result),),
    )


def _details(result: Stability) -> Iterator[Section]:
    drawn = list(stability_pictures(result))
    components = [p for p in drawn if p.name == "components.png"]
    found = result.components
    yield Section(
        title="Variance components",
        lines=() if found else tuple(component_lines(found)),
        table=ReportTable(
            title="",
            columns=("component", "1 σ, µg", "95 % limits", "degrees of freedom", "what it is"),
            rows=tuple(
                (
                    c.name,
                    sigma_text(c.sigma, c.ci95),
                    limits_text(c.ci95),
                    str(c.dof),
                    FACTORS[c.name],
                )
                for c in found.components
            ),
        )
        if found
        else None,
        words=(0, 4),
        pictures=tuple(components),
    )
    own = [p for p in drawn if p not in components]
    for k, one in enumerate(result.accelerometers):
        yield _of_one(one, own[k : k + 1])
    left = len(result.accelerometers) - MAX_ACCELEROMETERS
    if left > 0:
        yield Section(lines=(f"The last {left} accelerometers have no picture of their own.",))


def _of_one(one: AccelerometerStability, pictures: list[Picture]) -> Section:
    return Section(
        title=f"{one.serial}: {one.verdict}",
        points=tuple(stability_sentences(one)),
        table=ReportTable(
            title="",
            columns=COLUMNS,
            rows=tuple(tuple(coefficient_row(one, c)) for c in one.coefficients),
        ),
        words=(0, 1),
        pictures=tuple(pictures),
    )


def _closing(runs: RecordedRuns) -> Iterator[Section]:
    rows = tuple(tuple(row) for row in source_rows(runs, runs.run_ids))
    yield Section(
        title="Sources",
        table=ReportTable(title="", columns=SOURCE_COLUMNS, rows=rows),
        words=(0, 1, 2, 5),
    )
    yield Section(title="Conventions", points=CONVENTIONS)
