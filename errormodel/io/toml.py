"""Reading TOML into checked, frozen configurations; every complaint is one line with its place."""

import difflib
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

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
        quotes = "; text must be in quotes" if "Invalid value" in str(err) else ""
        other = Path(source).suffix.lower() not in ("", ".toml")
        expected = ", expected a .toml file" if other else quotes
        raise InputError(source, "", f"not TOML: {err}{expected}") from None


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
        first, *others = err.errors(include_url=False)
        # a misspelt key is missing under its right name: the misspelling is what to mend
        strange = [".".join(map(str, e["loc"])) for e in others if e["type"] == "extra_forbidden"]
        more = [f"no such key: {', '.join(strange)}"] if strange else []
        if left := len(others) - len(strange):
            more.append(f"{left} more like it")
        place = ".".join(str(part) for part in first["loc"])
        problem = "; ".join((_problem(first, config), *more))
        raise InputError(source, place, problem) from None
    except RecursionError:
        raise InputError(source, "", "nested too deeply") from None


def _problem(one: ErrorDetails, config: type[BaseModel]) -> str:
    """Return what is wrong with a key, and what was expected."""
    got, context = one.get("input"), one.get("ctx", {})
    if one["type"] == "extra_forbidden":
        known = _keys_at(one["loc"][:-1], config)
        near = difflib.get_close_matches(str(one["loc"][-1]), known, n=1)
        return "no such key" + (f" (did you mean {near[0]}?)" if near else "")
    if one["type"] == "union_tag_invalid":
        return f"{context['tag']!r}, expected one of {context['expected_tags']}"
    message = one["msg"].removeprefix("Value error, ")
    if isinstance(got, dict | list | BaseModel) or one["type"] == "missing":
        return message
    return f"{message} (got {got!r:.60})"


def _keys_at(place: tuple[int | str, ...], config: type[BaseModel]) -> list[str]:
    """Return the keys that may stand in a table of a configuration; none where it is not known."""
    at: Any = config
    for part in place:
        at = at.model_fields[part].annotation if part in getattr(at, "model_fields", {}) else at
        at = next((a for a in (at, *get_args(at)) if hasattr(a, "model_fields")), at)
    fields: Mapping[str, FieldInfo] = getattr(at, "model_fields", {})
    return [info.alias or name for name, info in fields.items()]


def read_toml(path: Path | str, config: type[Config]) -> Config:
    """Read a TOML file into a configuration.

    Raises
    ------
    InputError
        If the file cannot be read, is not TOML or does not fit `config`.
    """
    return check(parse_toml(read_text(path), path), config, path)
