"""Standard output and standard error: one JSON document, or text for people."""

import json
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import click
from rich.console import Console, RenderableType
from rich.padding import Padding
from rich.text import Text

from accelbench.shell.tables import TextTable, copied

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
        console.print(_shown(part, console) if isinstance(part, str) else part)


def _shown(line: str, console: Console) -> RenderableType:
    """Return a line whose numbers can be copied, and whose indentation holds when it wraps."""
    line = copied(line)
    indent = len(line) - len(line.lstrip(" "))
    if not indent or not console.is_terminal:
        return line
    return Padding(Text(line[indent:]), (0, 0, 0, indent))


def table(
    *columns: str, right: Sequence[str] = (), words: Sequence[str] = (), keys: int = 1
) -> TextTable:
    """Return an empty table: `right` are its numbers, `words` may wrap, `keys` lead every part."""
    return TextTable(columns, right=right, words=words, keys=keys)


def number(value: float | None, digits: int = 4) -> str:
    """Write a number with so many digits that count; a dash when there is none."""
    if value is None or not math.isfinite(value):
        return "–"
    text = f"{value:.{digits}g}"
    if "e" in text and 1e-4 <= abs(value) < 1e7:
        text = f"{value:.0f}"
    return text.replace("-", "−")


def value_and_sigma(value: float, sigma: float) -> str:
    """Write a value with its sigma, to two digits of the sigma."""
    if not sigma > 0:
        return number(value, 6)
    places = min(max(0, 1 - _exponent(sigma)), 12)
    return f"{value:.{places}f} ± {sigma:.{places}f}".replace("-", "−")


def _exponent(value: float) -> int:
    return int(f"{value:e}".split("e")[1])


def in_words(name: str) -> str:
    """Return a parameter's or group's name of the rig as people say it: accelerometer bias x."""
    spelt = {"accel": "accelerometer", "k0": "K0", "k1": "K1"}
    return " ".join(spelt.get(part, part) for part in name.split("_"))


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
