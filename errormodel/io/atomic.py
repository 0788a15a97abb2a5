"""Files that appear whole or not at all, several of them together."""

import os
import secrets
from collections.abc import Generator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from errormodel.errors import InputError


def draft_name(path: Path) -> Path:
    """Return a name beside a file for as long as it is being written."""
    return path.with_name(f".{path.name}.{secrets.token_hex(4)}.part")


@contextmanager
def written_together(paths: Sequence[Path]) -> Generator[tuple[Path, ...]]:
    """Give names to write to; when all went well they are flushed and become `paths`.

    Parameters
    ----------
    paths : sequence of Path
        What the files shall be called; those that exist are replaced.

    Yields
    ------
    tuple of Path
        As many names in the same folders; whatever is not written there in full vanishes.

    Raises
    ------
    InputError
        If one cannot be written; the others are then as they were before.
    """
    drafts = tuple(draft_name(p) for p in paths)
    with ExitStack() as pending:
        for draft in drafts:
            pending.callback(_forget, draft)
        try:
            yield drafts
            for draft in drafts:
                _flush(draft)
            for draft, path in zip(drafts, paths, strict=True):
                os.replace(draft, path)
        except OSError as err:
            where = err.filename or (paths[0] if paths else "output")
            problem = f"cannot be written: {err.strerror or err}"
            raise InputError(_meant(where, drafts, paths), "", problem) from None


def write_files(contents: Sequence[tuple[Path, bytes]]) -> None:
    """Write several files together, each whole; their folders are made when they are not there.

    Raises
    ------
    InputError
        If one cannot be written; then none was.
    """
    paths = [path for path, _ in contents]
    for path in paths:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as err:
            problem = f"cannot be made: {err.strerror or err}"
            raise InputError(path.parent, "", problem) from None
    with written_together(paths) as drafts:
        for draft, (_, content) in zip(drafts, contents, strict=True):
            draft.write_bytes(content)


def replace_file(path: Path, content: bytes) -> None:
    """Write one file whole, in place of the one that is there.

    Raises
    ------
    OSError
        As the system tells it; the file is then as it was before.
    """
    draft = draft_name(path)
    try:
        draft.write_bytes(content)
        _flush(draft)
        os.replace(draft, path)
    finally:
        _forget(draft)


def _forget(path: Path) -> None:
    path.unlink(missing_ok=True)


def _flush(path: Path) -> None:
    with path.open("rb") as file:
        os.fsync(file.fileno())


def _meant(where: str | Path, drafts: Sequence[Path], paths: Sequence[Path]) -> Path:
    """Return what the user calls the file that failed."""
    for draft, path in zip(drafts, paths, strict=True):
        if Path(where) == draft:
            return path
    return Path(where)
