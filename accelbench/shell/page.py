"""What all HTML reports share: the template engine, embedded figures, sources; and plain pages."""

import base64
import platform
from collections.abc import Collection
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from accelbench.shell.plotting import Picture
from thermo.recording.files import RecordedRuns

SOFTWARE = ("accelbench", "numpy", "scipy", "pandas", "matplotlib")
SOURCE_COLUMNS = ("run", "use", "begun", "readings", "flagged", "SHA-256 of the content")


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportTable:
    """A further table of a report: of a station's test, for instance."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A part of a page: paragraphs, points, a table, pictures, in this order.

    `words` are the columns of the table that hold words and are set to the left.
    """

    title: str = ""
    lines: tuple[str, ...] = ()
    points: tuple[str, ...] = ()
    table: ReportTable | None = None
    words: tuple[int, ...] = (0,)
    pictures: tuple[Picture, ...] = ()

    @property
    def figures(self) -> list[dict[str, str]]:
        """The pictures as the template takes them."""
        return [embedded(p) for p in self.pictures]


@dataclass(frozen=True, slots=True, kw_only=True)
class Page:
    """A report made of sections."""

    title: str
    sections: tuple[Section, ...]


def render_page(page: Page, name: str) -> dict[str, bytes]:
    """Return a page's files by name, its pictures beside it, without writing any."""
    drawn = {p.name: p.png for s in page.sections for p in s.pictures}
    return {name: rendered("page.html.j2", page=page).encode(), **drawn}


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


def source_rows(runs: RecordedRuns, fitted: Collection[str]) -> list[list[str]]:
    """Return a row for each run: use, start, readings, flagged readings, digest."""
    rows: list[list[str]] = []
    for run in runs.run_ids:
        mine = runs.run.codes == runs.run_ids.index(run)
        start = runs.run_start_utc.get(run)
        rows.append(
            [
                run,
                "fitted" if run in fitted else "held out",
                start.strftime("%Y-%m-%d %H:%M:%S UTC") if start else "not recorded",
                f"{int(mine.sum())}",
                f"{int((mine & ~runs.good).sum())}",
                runs.digest(run),
            ]
        )
    return rows


def software() -> str:
    """Return the versions of what a report was made with."""
    versions = (f"{name} {version(name)}" for name in SOFTWARE)
    return ", ".join((f"Python {platform.python_version()}", *versions))
