"""Output places: never over an input, and over an old result only when told so."""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from accelbench.shell.browser_print import find_browser, print_pdf
from accelbench.shell.surroundings import current_shell
from errormodel.errors import InputError
from errormodel.io.atomic import draft_name, write_files

if TYPE_CHECKING:
    from rich.console import RenderableType

REPORT_NAME = "report.html"
PDF_SUFFIX = ".pdf"
Command = TypeVar("Command", bound=Callable[..., Any])
TRIAL = 4096  # bytes of the file that proves a place: a full disk still makes empty ones


def checked_run_output(path: Path, inputs: Sequence[Path], *, force: bool) -> None:
    """Check where a recorded run and its sidecar shall go.

    Raises
    ------
    InputError
        If the name is no recorded run's, or either file may not be written.
    """
    from errormodel.io.tables import TABLE_SUFFIXES, sidecar_path  # pyarrow takes its second

    if path.suffix.lower() not in TABLE_SUFFIXES:
        raise InputError(path, "--out", "expected a name ending in .csv or .parquet")
    for one in (path, sidecar_path(path)):
        checked_output(one, inputs, force=force)


def checked_output(path: Path, inputs: Sequence[Path], *, force: bool) -> None:
    """Check where a file shall go, before anything is computed.

    Parameters
    ----------
    path : Path
    inputs : sequence of Path
        Files that must not be overwritten even with `force`.
    force : bool
        Whether an existing file may be replaced.

    Raises
    ------
    InputError
        If it is an input, exists already, its folder does not, or it cannot be written.
    """
    taken = {p.resolve() for p in inputs}
    if path.resolve() in taken:
        raise InputError(path, "", "is an input; expected another name for the output")
    if path.is_dir():
        raise InputError(path, "", "exists, expected the name of a file")
    if path.exists() and not force:
        raise InputError(path, "", "exists already; give another name, or --force to replace it")
    if not path.resolve().parent.is_dir():
        raise InputError(path, "", "its folder does not exist")
    prove_writable(path)


def prove_writable(path: Path) -> None:
    """Write a file beside where another shall go and take it away again: what comes is worth it.

    Folders that are missing are made for it and taken away, too. A file that exists is opened for
    more, and left as it is.

    Parameters
    ----------
    path : Path
        Of the file that shall be written.

    Raises
    ------
    InputError
        If it cannot be written: no permission, a full disk, a name too long, a file where a folder
        was expected, a device.
    """
    if path.exists() and not path.is_file():
        raise InputError(path, "", "exists and is not a file, expected another name")
    folder = path.parent
    missing = [p for p in (folder, *folder.parents) if not p.exists()]
    with ExitStack() as traces:
        try:
            for one in reversed(missing):
                one.mkdir()
                traces.callback(_take_away, one.rmdir)
            # as long as the name that it has while it is written
            trial = draft_name(path)
            traces.callback(_take_away, trial.unlink)
            with trial.open("xb") as file:
                file.write(bytes(TRIAL))
                file.flush()
                os.fsync(file.fileno())
            if path.exists():
                path.open("ab").close()
        except OSError as err:
            problem = f"cannot be written: {err.strerror or err}"
            raise InputError(path, "", problem) from None


def _take_away(remove: Callable[[], None]) -> None:
    with suppress(OSError):
        remove()


def report_file(place: Path) -> Path:
    """Return the file that `--report PLACE` is about: the PDF, or the page in the folder."""
    return place if place.suffix.lower() == PDF_SUFFIX else place / REPORT_NAME


def check_report(place: Path, *, force: bool) -> None:
    """Check where a report shall go: a folder, or FILE.pdf.

    Raises
    ------
    UsageError
        If it is another file, or a PDF is asked for and no browser can print it.
    InputError
        If there is a report that must not be replaced, or nothing can be written there.
    """
    report = report_file(place)
    if report == place:
        if report.is_dir():
            raise click.UsageError(f"--report {place}: is a folder, expected the name of a PDF")
        if find_browser() is None:
            raise click.UsageError(
                f"--report {place}: a PDF is printed by Chromium, which is not installed; give a "
                "folder for HTML"
            )
    elif place.exists() and not place.is_dir():
        raise click.UsageError(f"--report {place}: is a file, expected a folder or FILE.pdf")
    if report.exists() and not force:
        raise InputError(report, "", "exists already; give another name, or --force to replace it")
    prove_writable(report)


def check_results(
    out: Path | None, report: Path | None, inputs: Sequence[Path], *, force: bool
) -> None:
    """Check where a result file and a report shall go, each when asked for.

    Raises
    ------
    UsageError, InputError
        As `checked_output` and `check_report`.
    """
    if out is not None:
        checked_output(out, inputs, force=force)
    if report is not None:
        check_report(report, force=force)


@dataclass(slots=True)
class Results:
    """Answer of a command: a document, the same in words, and files, written together."""

    document: dict[str, Any]
    text: "list[RenderableType]"
    files: list[tuple[Path, bytes]] = field(default_factory=list[tuple[Path, bytes]])

    def add_file(self, kind: str, out: Path | None, content: Callable[[], str]) -> None:
        """Add a result file when one is asked for; `kind` is what it is."""
        if out is not None:
            self.files.append((out, content().encode()))
            self.document["out"] = str(out)
            self.text.append(f"{kind}: {out}")

    def add_files(
        self,
        key: str,
        out: Path,
        files: Sequence[tuple[Path, bytes]],
        lines: "Iterable[RenderableType]",
    ) -> None:
        """Add files that go together, told under `key` by the name asked for; null: none."""
        self.files += files
        self.document[key] = str(out) if files else None
        self.text += lines

    def add_report(self, place: Path | None, pages: Callable[[], Mapping[str, bytes]]) -> None:
        """Add a report when it is asked for: a page and its pictures, or a PDF of the page."""
        if place is None:
            return
        report, made = report_file(place), pages()
        if report == place:
            self.files.append((report, print_pdf(made[REPORT_NAME])))
        else:
            self.files += [(place / name, content) for name, content in made.items()]
        self.document["report"] = str(report)
        self.text.append(f"report: {report}")

    def write(self, *, as_json: bool) -> None:
        """Write the files, all or none, and then tell."""
        from accelbench.shell.console import emit

        write_files(self.files)
        emit(self.document, self.text, as_json=as_json)


def with_sidecars(paths: Sequence[Path]) -> list[Path]:
    """Return recorded runs and the sidecars beside them."""
    from errormodel.io.tables import sidecar_path

    return [q for p in paths for q in (p, sidecar_path(p))]


json_option = click.option(
    "--json", "as_json", is_flag=True, help="Write one JSON document and nothing else."
)
force_option = click.option("--force", is_flag=True, help="Replace output files that exist.")


def _take_laboratory(ctx: click.Context, param: click.Parameter, value: Path | None) -> None:
    if value is not None and not ctx.resilient_parsing:
        from accelbench.shell.laboratory import read_laboratory  # pydantic takes its time

        current_shell().laboratory = read_laboratory(value)


_REPORT = click.option(
    "--report", type=Path, help="Folder for the report and its figures, or FILE.pdf."
)
_LAB = click.option(
    "--lab",
    type=Path,
    metavar="LAB.toml",
    envvar="ACCELBENCH_LAB",
    expose_value=False,
    callback=_take_laboratory,
    help="Laboratory, operator, instruments for the report's header.",
)


def report_options(command: Command) -> Command:
    """Give a command `--report` and `--lab`; the laboratory is kept in the surroundings."""
    return _REPORT(_LAB(command))
