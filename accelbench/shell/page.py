"""HTML reports: typed sections, tables and figures, and the one template that draws them."""

import base64
import platform
from collections.abc import Collection
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any, Literal

from jinja2 import Environment, PackageLoader, StrictUndefined

from accelbench.shell.plotting import Picture
from thermo.recording.files import RecordedRuns

SOFTWARE = ("accelbench", "numpy", "scipy", "pandas", "matplotlib")
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
    """

    title: str = ""
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


BannerState = Literal["good", "bad", "open", ""]


@dataclass(frozen=True, slots=True, kw_only=True)
class Banner:
    """Banner of a report: its verdict, in a box at the top.

    Attributes
    ----------
    text : str
    state : {"good", "bad", "open", ""}
        Colours the box; open is what could not be decided, and empty what is not judged.
    """

    text: str
    state: BannerState = ""


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
        Beside the date: the model, the runs.
    made_by : str
        Beside the software at the end.
    """

    title: str
    sections: tuple[Section, ...]
    verdicts: tuple[Banner, ...] = ()
    about: str = ""
    made_by: str = ""

    @property
    def titles(self) -> list[tuple[str, str]]:
        """Anchor and title of the sections that stand in the contents."""
        numbered = enumerate(self.sections, 1)
        return [(f"s{k}", s.title) for k, s in numbered if s.title and s.level == 2]


def render_page(page: Page, name: str) -> dict[str, bytes]:
    """Return a page's files by name, its pictures beside it, without writing any."""
    drawn = {p.name: p.png for s in page.sections for p in s.pictures}
    return {name: rendered("report.html.j2", page=page).encode(), **drawn}


def rendered(template: str, **content: Any) -> str:
    """Return a template filled; it is told when, and with what software."""
    environment = Environment(
        loader=PackageLoader("accelbench"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(
        made=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"), software=software(), **content
    )


def embedded(one: Picture) -> dict[str, str]:
    """Return a picture as templates take it, its bytes within the page."""
    data = base64.b64encode(one.png).decode("ascii")
    return {"name": one.name, "caption": one.caption, "uri": f"data:image/png;base64,{data}"}


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
