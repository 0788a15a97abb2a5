"""What goes to standard output and standard error: one JSON document, or text for people."""

import json
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import click
from rich import box
from rich.console import Console, RenderableType
from rich.table import Table

PLAIN_WIDTH = 160  # of text that goes into a file or a pipe


def emit(document: Mapping[str, Any], text: Iterable[RenderableType], *, as_json: bool) -> None:
    """Show a command's result, as JSON or as text.

    Parameters
    ----------
    document : mapping
        The whole result; NaN and infinity become null.
    text : iterable of str or rich renderables
        The same for people.
    as_json : bool
        Whether exactly one JSON document is written and nothing else.
    """
    if as_json:
        click.echo(json.dumps(_plain(document), ensure_ascii=False, indent=2, allow_nan=False))
        return
    console = _console()
    for part in text:
        console.print(part)


def table(*columns: str, right: Sequence[str] = ()) -> Table:
    """Return an empty table; it is drawn with lines only where somebody looks at a terminal."""
    made = Table(box=box.SIMPLE_HEAD if sys.stdout.isatty() else None, pad_edge=False)
    for name in columns:
        made.add_column(name, justify="right" if name in right else "left", overflow="fold")
    return made


def number(value: float | None, digits: int = 4) -> str:
    """Write a number with so many digits that count; a dash when there is none."""
    if value is None or not math.isfinite(value):
        return "–"
    text = f"{value:.{digits}g}"
    if "e" in text and 1e-4 <= abs(value) < 1e7:
        text = f"{value:.0f}"
    return text.replace("-", "−")


def micro_g(value: float | None) -> str:
    """Write an acceleration given in µg; large ones also in mg."""
    if value is None:
        return "–"
    return f"{number(value)} µg" + (f" ({number(value / 1e3, 3)} mg)" if abs(value) > 1000 else "")


def _console() -> Console:
    is_terminal = sys.stdout.isatty()
    return Console(
        file=sys.stdout,
        width=None if is_terminal else PLAIN_WIDTH,
        soft_wrap=not is_terminal,
        markup=False,
        highlight=False,
        emoji=False,
    )


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}  # type: ignore[misc]
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]  # type: ignore[misc]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value
