"""The report of a covariance analysis: one HTML file and its pictures."""

from collections.abc import Iterator, Mapping, Sequence

from accelbench.commands.rig_calibrate.page import NAMES, in_words_first
from accelbench.commands.rig_calibrate.text import names_by_axis
from accelbench.commands.rig_plan.figures import (
    draw_budget,
    draw_planned_sigmas,
    draw_programme,
)
from accelbench.commands.rig_plan.text import (
    HEADINGS,
    SIGMA_COLUMNS,
    article_rows,
    assumed,
    correlations,
    not_seen,
    remarks,
    sigma_rows,
)
from accelbench.shell.outputs import REPORT_NAME
from accelbench.shell.page import (
    Banner,
    Page,
    ReportTable,
    Section,
    correlation_tables,
    render_page,
)
from sinscal.article.tables import ArticleTables
from sinscal.planning.advice import Advice
from sinscal.planning.covariance import RigCovariance
from sinscal.twin.rig_file import RigFile

USABLE = "The programme can be carried out; the sigmas to expect are below."
CHANGE = "Change the programme as advised below, or do without these parameters."
CONVENTIONS = (
    "Measured = true + error: ω′ = (I + Θ)ω + ν⁰ + …, f′ = (I + Γ)f + Δf⁰ + …; Γ lower triangular "
    "fixes the body's axes, Θ is full.",
    NAMES,
    "Sigmas are standard deviations (1 σ); a density of noise is the sigma of a mean over "
    "one second.",
    "The covariance is that of the calibration filter on the exact motion of the programme; it "
    "uses no measurement. It does not include faults of the rig that the filter does not estimate.",
    "A share of the budget is the contribution of one source to the variance; the shares add up.",
)


def render_covariance(
    file: RigFile,
    found: Mapping[str, RigCovariance],
    *,
    title: str,
    tables: tuple[ArticleTables, ArticleTables] | None = None,
    advice: Mapping[str, Sequence[Advice]] | None = None,
) -> dict[str, bytes]:
    """Return the report's files by name, without writing any.

    Parameters
    ----------
    file : RigFile
        The programme.
    found : mapping of str to RigCovariance
        By mode.
    title : str
        What was analysed.
    tables : pair of ArticleTables, optional
        The article's, under the reading that fits best and to the letter.
    advice : mapping of str to sequence of Advice, optional
        By mode.
    """
    sections = [*(_article(*tables) if tables else ()), _programme(file)]
    for mode, one in found.items():
        sections += _mode(mode, one, (advice or {}).get(mode, ()))
    sections.append(Section(title="Conventions", points=CONVENTIONS))
    page = Page(
        title=f"Covariance analysis of {title:.120}",
        verdicts=tuple(_seen(mode, one) for mode, one in found.items()),
        sections=tuple(sections),
    )
    return render_page(page, REPORT_NAME)


def _seen(mode: str, one: RigCovariance) -> Banner:
    """Say whether the programme shows every parameter."""
    hidden = list(not_seen(one))
    if not hidden:
        return Banner(
            text=f"{mode}: the programme shows every parameter", state="good", todo=USABLE
        )
    return Banner(
        text=f"{mode}: hardly seen are {names_by_axis(hidden)}", state="open", todo=CHANGE
    )


def _article(best: ArticleTables, literal: ArticleTables) -> Iterator[Section]:
    columns = ("entry", "published", "computed", "ratio", "to the letter", "its ratio")
    for title, rows in article_rows(best, literal):
        yield Section(title=title, table=ReportTable(title="", columns=columns, rows=tuple(rows)))
    yield Section(title="What was assumed", lines=tuple(assumed(best, literal)))


def _programme(file: RigFile) -> Section:
    hours = sum(s.duration_s * c.repeats for c in file.cycles for s in c.segments) / 3600.0
    cycles = "; ".join(
        f"{c.axis}: {', '.join(f'{s.rate_deg_s:g} °/s {s.duration_s:g} s' for s in c.segments[:8])}"
        + (" …" if len(c.segments) > 8 else "")
        for c in file.cycles[:12]
    )
    line = f"{len(file.cycles)} cycles, {hours:.3g} h on the rig. By instrument axis: {cycles}."
    return Section(title="Programme", lines=(line,), pictures=(draw_programme(file),))


def _mode(mode: str, one: RigCovariance, advice: Sequence[Advice]) -> Iterator[Section]:
    yield Section(
        title=HEADINGS[mode],
        points=tuple(remarks(one, advice)),
        table=ReportTable(title="", columns=SIGMA_COLUMNS, rows=in_words_first(sigma_rows(one))),
        words=(0, 1, 4),
        pictures=(
            draw_planned_sigmas(one, mode),
            draw_budget(one, mode),
        ),
    )
    if tables := correlation_tables(one.names, correlations(one)):
        yield Section(title=f"Largest correlations, {mode}", level=3, tables=tables, words=(0, 1))
