"""Reading TOML into checked, frozen configurations; every complaint is one line with its place."""

import tomllib
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from errormodel.errors import InputError

Config = TypeVar("Config", bound=BaseModel)

MAX_LINE = 20_000  # characters; the parser takes minutes over a key of 10⁵ parts


def read_text(path: Path | str) -> str:
    """Read a UTF-8 text file.

    Raises
    ------
    InputError
        If the file is missing, unreadable or not UTF-8.
    """
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as err:
        raise InputError(path, f"byte {err.start}", "not UTF-8 text") from None
    except (OSError, ValueError) as err:
        reason = getattr(err, "strerror", None) or str(err)
        raise InputError(path, "", f"cannot be read: {reason}") from None


def parse_toml(text: str, source: Path | str) -> dict[str, Any]:
    """Parse TOML text.

    Raises
    ------
    InputError
        With the line and column at which it stops being TOML.
    """
    for number, line in enumerate(text.split("\n"), 1):
        if len(line) > MAX_LINE:
            raise InputError(
                source, f"line {number}", f"{len(line)} characters, expected at most {MAX_LINE}"
            )
    try:
        return tomllib.loads(text)
    except (tomllib.TOMLDecodeError, ValueError, RecursionError) as err:
        raise InputError(source, "", f"not TOML: {err}") from None


def check(data: Any, config: type[Config], source: Path | str) -> Config:
    """Check parsed data against a configuration class.

    Raises
    ------
    InputError
        Naming the first key that is wrong and what was expected of it.
    """
    try:
        return config.model_validate(data)
    except ValidationError as err:
        first = err.errors(include_url=False)[0]
        place = ".".join(str(part) for part in first["loc"])
        got = first.get("input")
        shown = (
            ""
            if isinstance(got, dict | list | BaseModel) or first["type"] == "missing"
            else f" (got {got!r:.60})"
        )
        more = f"; {err.error_count() - 1} more like it" if err.error_count() > 1 else ""
        message = first["msg"].removeprefix("Value error, ")
        raise InputError(source, place, f"{message}{shown}{more}") from None
    except RecursionError:
        raise InputError(source, "", "nested too deeply") from None


def read_toml(path: Path | str, config: type[Config]) -> Config:
    """Read a TOML file into a configuration.

    Raises
    ------
    InputError
        If the file cannot be read, is not TOML or does not fit `config`.
    """
    return check(parse_toml(read_text(path), path), config, path)
