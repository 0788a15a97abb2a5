"""Table of the keys of a file, made from the model that reads it."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from pydantic import BaseModel
from table_form import Rows, markdown, meanings

from thermo.planning.bounds import Bounds

Schema = Mapping[str, Any]


def keys(model: type[BaseModel], name: str, bounds: Bounds | None = None) -> Callable[[], str]:
    """Return what makes the table of a file's keys, with what a test may be begun with."""

    def table() -> str:
        schema = model.model_json_schema()
        known, rows = meanings()[name], Rows()
        used: set[str] = set()
        for path, kind, default in _walk(schema, schema, ""):
            if any(path.startswith(f"{p}.") and known[p].startswith("As ") for p in used):
                continue  # told elsewhere
            if path in (bounds or {}):
                least, most, _ = (bounds or {})[path]
                kind += f"; in a plan {least:g} to {most:g}"
            rows.append((f"`{path}`", kind, default, known[path]))
            used.add(path)
        if unused := sorted(set(known) - used):
            raise KeyError(f"meanings.toml: {name}: {unused[0]} is no key")
        return markdown(("key", "kind", "default", "meaning"), rows)

    return table


def only(table: Callable[[], str], *names: str) -> Callable[[], str]:
    """Return what makes a table of some of its rows: the others are told elsewhere."""

    def chosen() -> str:
        head, line, *rows = table().splitlines()
        kept = [row for row in rows if row.startswith(tuple(f"| `{name}` " for name in names))]
        return "\n".join([head, line, *kept])

    return chosen


def _walk(node: Schema, root: Schema, prefix: str) -> Iterator[tuple[str, str, str]]:
    needed = node.get("required", [])
    for key, value in node.get("properties", {}).items():
        path = f"{prefix}{key}"
        inner, many = _tables(value, root)
        default = "required" if key in needed else _default(value)
        if inner:
            yield path, "array of tables" if many else "table", default
            yield from _merged([r for one in inner for r in _walk(one, root, f"{path}.")])
        else:
            yield path, _kind(value, root), default


def _merged(rows: list[tuple[str, str, str]]) -> Iterator[tuple[str, str, str]]:
    """Give each key of tables that stand for one another once."""
    kinds: dict[str, list[str]] = {}
    for path, kind, _ in rows:
        kinds.setdefault(path, []).append(kind)
    defaults = {path: default for path, _, default in rows}
    for path, found in kinds.items():
        yield path, " or ".join(dict.fromkeys(found)), defaults[path]


def _tables(value: Schema, root: Schema) -> tuple[list[Schema], bool]:
    """Return the tables a key may hold, and whether it holds many."""
    if value.get("type") == "array":
        return _tables(value.get("items", {}), root)[0], True
    if "$ref" in value:
        found = root["$defs"][value["$ref"].rsplit("/", 1)[1]]
        return ([found] if "properties" in found else []), False
    either = [*value.get("anyOf", []), *value.get("oneOf", [])]
    return [t for v in either for t in _tables(v, root)[0]], False


def _default(value: Schema) -> str:
    if "default" not in value or value["default"] is None:
        return "–"
    default = value["default"]
    if isinstance(default, dict | list) and (not default or isinstance(default, dict)):
        return "–"
    return f"`{default}`".replace("'", '"').replace("True", "true").replace("False", "false")


def _kind(value: Schema, root: Schema) -> str:
    if "$ref" in value:
        return _kind(root["$defs"][value["$ref"].rsplit("/", 1)[1]], root)
    if "enum" in value:
        return " or ".join(f"`{v}`" for v in value["enum"])
    if "const" in value:
        return f"`{value['const']}`"
    either = [v for v in value.get("anyOf", []) if v.get("type") != "null"]
    if either:
        return " or ".join(dict.fromkeys(_kind(v, root) for v in either))
    if value.get("type") == "array":
        if "prefixItems" in value:
            return f"{len(value['prefixItems'])} × {_kind(value['prefixItems'][0], root)}"
        return f"list of {_kind(value.get('items', {}), root)}"
    return _scalar(value)


def _scalar(value: Schema) -> str:
    names = {"number": "number", "integer": "whole number", "string": "text", "object": "table"}
    parts = [names.get(str(value.get("type")), str(value.get("type", "any")))]
    limits = (("exclusiveMinimum", ">"), ("minimum", "≥"), ("exclusiveMaximum", "<"))
    for key, sign in (*limits, ("maximum", "≤")):
        if key in value:
            parts.append(f"{sign} {value[key]:g}")
    return " ".join(parts)
