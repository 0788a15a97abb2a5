"""A user's file of Python: run once, its members taken by name, its digest kept."""

import hashlib
import importlib.util
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import TypeVar, cast

from errormodel.errors import InputError

T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PythonFile:
    """A file that was run: where it is, its text, and what it defines."""

    path: Path
    content: bytes
    module: ModuleType

    @property
    def sha256(self) -> str:
        """SHA-256 of its text."""
        return hashlib.sha256(self.content).hexdigest()

    @property
    def source(self) -> str:
        """The file as messages tell it."""
        return str(self.path)


@dataclass(frozen=True, slots=True, kw_only=True)
class LibrarySource:
    """A user's file that members of a library came from: its name, the SHA-256 of its text."""

    name: str
    sha256: str
    members: frozenset[str]


def sources_of(sources: Iterable[LibrarySource], names: Iterable[str]) -> tuple[LibrarySource, ...]:
    """Return the files that some members came from."""
    wanted = set(names)
    return tuple(one for one in sources if one.members & wanted)


def check_source(name: str, sha256: str, opened: Iterable[LibrarySource]) -> None:
    """Check that a file which a model needs is open, as it was when the model was made.

    Raises
    ------
    ValueError
        If it is not.
    """
    if sha256 not in [one.sha256 for one in opened]:
        raise ValueError(
            f"needs the library {name}, SHA-256 {sha256[:12]}…; expected that file by --library, "
            "unchanged since the model was made"
        )


def run_python_file(path: Path | str) -> PythonFile:
    """Run a file of Python.

    Raises
    ------
    InputError
        If it cannot be read or fails.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(path, "", "no such file")
    try:
        content = path.read_bytes()
    except OSError as err:
        raise InputError(path, "", err.strerror or str(err)) from None
    return run_python_text(path, content)


def run_python_text(path: Path, content: bytes) -> PythonFile:
    """Run the text of a file of Python, written already or not.

    Raises
    ------
    InputError
        If it fails.
    """
    spec = importlib.util.spec_from_file_location("accelbench_user_library", path)
    if spec is None or spec.loader is None:
        raise InputError(path, "", "expected a file of Python, NAME.py")
    module = importlib.util.module_from_spec(spec)
    try:
        exec(compile(content, str(path), "exec"), module.__dict__)
    except Exception as err:
        raise InputError(path, "", f"{type(err).__name__}: {err}") from None
    return PythonFile(path=path, content=content, module=module)


def members_of(file: PythonFile, name: str, kind: type[T]) -> tuple[T, ...]:
    """Return the sequence that a file defines under a name; empty where it does not.

    Raises
    ------
    InputError
        If it is no sequence of that kind.
    """
    given: object = getattr(file.module, name, ())
    where = kind.__name__ if kind.__module__ == "builtins" else f"{kind.__module__}.{kind.__name__}"
    if isinstance(given, str | bytes) or not isinstance(given, Iterable):
        raise InputError(file.path, name, f"expected a sequence of {where}")
    members = tuple(cast(Iterable[object], given))
    for one in members:
        if not isinstance(one, kind):
            raise InputError(file.path, name, f"{one!r}: expected a sequence of {where}")
    return cast(tuple[T, ...], members)
