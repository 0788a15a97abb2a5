"""Form of a table of the reference, and the meanings that the program does not hold as data."""

import tomllib
from pathlib import Path

MEANINGS = Path(__file__).parent / "meanings.toml"
Rows = list[tuple[str, ...]]


def meanings() -> dict[str, dict[str, str]]:
    """Return what every key means, by the table's name and the key's path."""
    return tomllib.loads(MEANINGS.read_text(encoding="utf-8"))


def markdown(head: tuple[str, ...], rows: Rows) -> str:
    """Write a table."""
    lines = [head, tuple("---" for _ in head), *rows]
    return "\n".join("| " + " | ".join(c.replace("|", "\\|") for c in row) + " |" for row in lines)
