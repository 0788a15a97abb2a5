"""Output places: never over an input, and over an old result only when told so."""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from errormodel.errors import InputError
from errormodel.io.atomic import draft_name, write_files

if TYPE_CHECKING:
    from rich.console import RenderableType

REPORT_NAME = "report.html"
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


def check_report_folder(folder: Path, *, force: bool) -> None:
    """Check where a report shall go.

    Raises
    ------
    UsageError
        If it is a file.
    InputError
        If there is a report in it that must not be replaced, or nothing can be written there.
    """
    if folder.exists() and not folder.is_dir():
        raise click.UsageError(f"--report {folder}: is a file, expected a folder")
    report = folder / REPORT_NAME
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
        As `checked_output` and `check_report_folder`.
    """
    if out is not None:
        checked_output(out, inputs, force=force)
    if report is not None:
        check_report_folder(report, force=force)


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

    def add_report(self, folder: Path | None, pages: Callable[[], Mapping[str, bytes]]) -> None:
        """Add a report's files when it is asked for."""
        if folder is not None:
            self.files += [(folder / name, content) for name, content in pages().items()]
            self.document["report"] = str(folder / REPORT_NAME)
            self.text.append(f"report: {folder / REPORT_NAME}")

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
