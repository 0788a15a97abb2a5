"""Writing TOML: every file of that form that the program makes is written here.

`errormodel.io.toml` reads it back to equal values. A line stays far below the reader's limit: an
array too long for a line, or of tables, has an item a line.
"""

import json
import re
from collections.abc import Mapping, Sequence
from typing import TypeAlias, cast

Plain: TypeAlias = str | bool | int | float | Sequence["Plain"] | Mapping[str, "Plain"]
Comments: TypeAlias = Mapping[tuple[str, ...], str]

WIDTH = 100  # characters of an array on one line
INDENT = "    "
_BARE = re.compile(r"[A-Za-z0-9_-]+")


def toml_text(data: Mapping[str, Plain], comments: Comments | None = None) -> str:
    """Return a mapping as TOML: plain values first, then tables and arrays of tables.

    Parameters
    ----------
    data : mapping
        A table of nothing but tables gets a header for each of those (``[effects.sag]``); tables
        further inside are written inline.
    comments : mapping, optional
        By the keys that lead to a table, ``("effects", "sag")``: a line above its header; by those
        that lead to a text in an array, ``("terms", "k0")``: beside it, the array then has an item
        a line.

    Returns
    -------
    str
    """
    said = comments or {}
    lines = [f"{_key(k)} = {_value(v, _beside(said, k))}" for k, v in data.items() if _is_plain(v)]
    for name, value in data.items():
        if not _is_plain(value):
            lines += _tables((name,), value, said)
    return "\n".join(lines) + "\n"


def _is_plain(value: Plain) -> bool:
    return not isinstance(value, Mapping) and not _is_array_of_tables(value)


def _is_array_of_tables(value: Plain) -> bool:
    return (
        isinstance(value, Sequence)
        and not isinstance(value, str)
        and bool(value)
        and all(isinstance(item, Mapping) for item in value)
    )


def _beside(comments: Comments, name: str) -> Mapping[str, str]:
    return {keys[1]: text for keys, text in comments.items() if len(keys) == 2 and keys[0] == name}


def _tables(keys: tuple[str, ...], value: Plain, comments: Comments) -> list[str]:
    """Return the lines of a table, of the tables in it, or of an array of tables."""
    header = ".".join(map(_key, keys))
    if not isinstance(value, Mapping):
        tables = cast(Sequence[Mapping[str, Plain]], value)
        return [line for one in tables for line in ["", f"[[{header}]]", *_entries(one)]]
    if value and all(isinstance(item, Mapping) and item for item in value.values()):
        inner = cast(Mapping[str, Mapping[str, Plain]], value)
        return [line for k, one in inner.items() for line in _table((*keys, k), one, comments)]
    return _table(keys, value, comments)


def _table(keys: tuple[str, ...], table: Mapping[str, Plain], comments: Comments) -> list[str]:
    above = [f"# {line}" for line in comments.get(keys, "").splitlines()]
    return ["", *above, f"[{'.'.join(map(_key, keys))}]", *_entries(table)]


def _entries(table: Mapping[str, Plain]) -> list[str]:
    return [f"{_key(name)} = {_value(value)}" for name, value in table.items()]


def _value(value: Plain, beside: Mapping[str, str] | None = None) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_key(k)} = {_value(item)}" for k, item in value.items()) + "}"
    if isinstance(value, str):
        return _quoted(value)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return repr(int(value))
    if isinstance(value, float):
        return repr(float(value))
    return _array(value, beside or {})


def _array(items: Sequence[Plain], beside: Mapping[str, str]) -> str:
    texts = [_value(item) for item in items]
    line = f"[{', '.join(texts)}]"
    if not beside and len(line) <= WIDTH and not any(isinstance(i, Mapping) for i in items):
        return line
    said = [beside.get(item, "") if isinstance(item, str) else "" for item in items]
    rows = [
        f"{INDENT}{text},{f'  # {comment}' if comment else ''}\n"
        for text, comment in zip(texts, said, strict=True)
    ]
    return f"[\n{''.join(rows)}]"


def _key(name: str) -> str:
    return name if _BARE.fullmatch(name) else _quoted(name)


def _quoted(text: str) -> str:
    # JSON leaves DEL bare, which TOML forbids; its surrogate pairs TOML forbids as well
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
