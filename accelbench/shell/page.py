"""HTML reports: typed sections, tables and figures, and the one template that draws them."""

import base64
import platform
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any, Literal

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from accelbench.shell.console import in_words
from accelbench.shell.laboratory import Laboratory
from accelbench.shell.plotting import Picture
from accelbench.shell.surroundings import current_shell
from errormodel.arrays import FloatArray
from thermo.recording.files import RecordedRuns

SOFTWARE = ("accelbench", "numpy", "scipy", "pandas", "matplotlib")
UPRIGHT_COLUMNS = 8  # more do not fit beside each other on upright A4 in print that can be read
LARGEST = 10  # correlations that are shown at once
LEAST_CORRELATION = 0.05  # below it a pair is of no use to anybody
SOURCE_COLUMNS = ("run", "use", "begun", "readings", "flagged", "SHA-256 of the content")


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportTable:
    """A table of a report.

    Attributes
    ----------
    title : str
        Used where the table makes a section of its own.
    columns : tuple of str
    rows : tuple of tuple of str
        A cell for each column.
    note : str
        Stands below it.
    folded : bool
        Whether only the title is shown until it is asked for; paper shows the title alone.
    """

    title: str = ""
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""
    folded: bool = False

    @property
    def is_wide(self) -> bool:
        """Return True if it is printed on a landscape sheet of its own."""
        return len(self.columns) > UPRIGHT_COLUMNS


BannerState = Literal["good", "bad", "open", ""]
# a symbol and a word beside the colour, which not everybody and no photocopy can see
STATE_SYMBOLS = {"good": "✔", "bad": "✘", "open": "▲", "": "●"}
STATE_WORDS = {"good": "In order", "bad": "Not in order", "open": "Attention", "": "Result"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Banner:
    """Banner of a report: its verdict, in a box at the top.

    Attributes
    ----------
    text : str
    state : {"good", "bad", "open", ""}
        Colours the box; open is what could not be decided, and empty what is not judged.
    todo : str
        What the reader is to do now, a sentence.
    """

    text: str
    state: BannerState = ""
    todo: str = ""

    @property
    def symbol(self) -> str:
        """The symbol of the state."""
        return STATE_SYMBOLS[self.state]

    @property
    def word(self) -> str:
        """The state in words."""
        return STATE_WORDS[self.state]


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A part of a page: paragraphs, points, tables, pictures, paragraphs again, in this order.

    Attributes
    ----------
    title : str
    level : int
        2 stands in the contents, 3 is a part of the section before.
    lines, points : tuple of str
    table : ReportTable, optional
    tables : tuple of ReportTable
        In place of one table.
    words : tuple of int
        Columns of the tables that hold words and are set to the left.
    pictures : tuple of Picture
    after : tuple of str
        Paragraphs below tables and pictures.
    """

    title: str = ""
    level: int = 2
    lines: tuple[str, ...] = ()
    points: tuple[str, ...] = ()
    table: ReportTable | None = None
    tables: tuple[ReportTable, ...] = ()
    words: tuple[int, ...] = (0,)
    pictures: tuple[Picture, ...] = ()
    after: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.table is not None:
            object.__setattr__(self, "tables", (self.table, *self.tables))

    @property
    def figures(self) -> list[dict[str, str]]:
        """The pictures as the template takes them."""
        return [embedded(p) for p in self.pictures]


@dataclass(frozen=True, slots=True, kw_only=True)
class Page:
    """A report made of sections.

    Attributes
    ----------
    title : str
        With the serial numbers it is about: browsers and printers put it on every page.
    sections : tuple of Section
    verdicts : tuple of Banner
        What comes first.
    about : str
        A line of the header: the model, the runs.
    measured : str, optional
        When, a line of the header; empty where that is not recorded, None of what is no recording.
    made_by : str
        Beside the software at the end.
    """

    title: str
    sections: tuple[Section, ...]
    verdicts: tuple[Banner, ...] = ()
    about: str = ""
    measured: str | None = None
    made_by: str = ""

    @property
    def titles(self) -> list[tuple[str, str]]:
        """Anchor and title of the sections that stand in the contents."""
        numbered = enumerate(self.sections, 1)
        return [(f"s{k}", s.title) for k, s in numbered if s.title and s.level == 2]


def render_page(page: Page, name: str) -> dict[str, bytes]:
    """Return a page's files by name, its pictures beside it, without writing any."""
    drawn = {p.name: p.png for s in page.sections for p in s.pictures}
    laboratory = current_shell().laboratory or Laboratory()
    text = rendered("report.html.j2", page=page, laboratory=laboratory)
    return {name: text.encode(), **drawn}


def rendered(template: str, **content: Any) -> str:
    """Return a template filled; it is told when, and with what software."""
    environment = Environment(
        loader=PackageLoader("accelbench"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["css_string"] = css_string
    return environment.get_template(template).render(
        made=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"), software=software(), **content
    )


def css_string(text: str) -> Markup:
    """Return text as it may stand between quotes in a style sheet, whatever its characters."""
    kept = (c if c.isascii() and (c.isalnum() or c in " .,:-") else f"\\{ord(c):x} " for c in text)
    return Markup("".join(kept))


def correlation_tables(names: Sequence[str], matrix: FloatArray) -> tuple[ReportTable, ...]:
    """Return the largest correlations of what is estimated, and the others to be unfolded.

    Parameters
    ----------
    names : sequence of str, length p
    matrix : ndarray, shape (p, p)
        Of correlations.

    Returns
    -------
    tuple of ReportTable
        None without two parameters; the second only where there are more than `LARGEST` pairs.
    """
    one, other = np.triu_indices(len(names), 1)
    size = np.abs(matrix[one, other])
    order = [int(k) for k in np.argsort(-size, kind="stable") if size[k] >= LEAST_CORRELATION]
    rows = tuple(
        (
            in_words(names[int(one[k])]),
            in_words(names[int(other[k])]),
            f"{matrix[one[k], other[k]]:+.2f}".replace("-", "−"),
        )
        for k in order
    )
    if not rows:
        return ()
    columns = ("parameter", "and parameter", "correlation")
    first = ReportTable(columns=columns, rows=rows[:LARGEST])
    if len(rows) <= LARGEST:
        return (first,)
    title = f"The other {len(rows) - LARGEST} correlations of {LEAST_CORRELATION:g} and more"
    return first, ReportTable(title=title, columns=columns, rows=rows[LARGEST:], folded=True)


def embedded(one: Picture) -> dict[str, str]:
    """Return a picture as templates take it, its bytes within the page."""
    data = base64.b64encode(one.png).decode("ascii")
    return {"name": one.name, "caption": one.caption, "uri": f"data:image/png;base64,{data}"}


def measured_on(runs: RecordedRuns) -> str:
    """Return the days on which the runs began, UTC."""
    days = sorted(start.strftime("%Y-%m-%d") for start in runs.run_start_utc.values() if start)
    if not days:
        return ""
    return days[0] if days[0] == days[-1] else f"{days[0]} to {days[-1]}"


def source_rows(runs: RecordedRuns, fitted: Collection[str]) -> list[tuple[str, ...]]:
    """Return a row for each run: use, start, readings, flagged readings, digest."""
    rows: list[tuple[str, ...]] = []
    for run in runs.run_ids:
        mine = runs.run.codes == runs.run_ids.index(run)
        start = runs.run_start_utc.get(run)
        rows.append(
            (
                run,
                "fitted" if run in fitted else "held out",
                start.strftime("%Y-%m-%d %H:%M:%S UTC") if start else "not recorded",
                f"{int(mine.sum())}",
                f"{int((mine & ~runs.good).sum())}",
                runs.digest(run),
            )
        )
    return rows


def software() -> str:
    """Return the versions of what a report was made with."""
    versions = (f"{name} {version(name)}" for name in SOFTWARE)
    return ", ".join((f"Python {platform.python_version()}", *versions))
