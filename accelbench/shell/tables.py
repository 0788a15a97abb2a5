"""Tables for people that are never wider than the terminal they are shown in."""

import re
from collections.abc import Iterator, Sequence

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.text import Text

GAP = 2  # cells between two columns
WORDS_WIDTH = 20  # a column of words is not made narrower than this
MINUS = re.compile("−(?=[0-9.])")


def copied(text: str) -> str:
    """Return text in which a number's minus is the one that spreadsheets and Python read."""
    return MINUS.sub("-", text)


class TextTable:
    """A table of text: whole where there is room, else in parts below one another.

    Columns that do not fit follow in a further part, led by the key columns again; a heading
    breaks between words, and so does a column of words. A value is never broken. Where the text
    goes into a file or a pipe the table is whole, however wide.

    Parameters
    ----------
    columns : sequence of str
    right : sequence of str
        Columns set to the right: numbers.
    words : sequence of str
        Columns of words, which may be broken.
    keys : int
        So many columns in front say what a row is of; every part begins with them.
    """

    def __init__(
        self,
        columns: Sequence[str],
        *,
        right: Sequence[str] = (),
        words: Sequence[str] = (),
        keys: int = 1,
    ) -> None:
        self._columns = tuple(columns)
        self._right = [name in right for name in columns]
        self._words = [name in words for name in columns]
        self._keys = min(keys, len(self._columns))
        self._rows: list[tuple[str, ...]] = []

    def add_row(self, *cells: str) -> None:
        """Add a row, a cell for each column."""
        if len(cells) != len(self._columns):
            raise ValueError(f"{len(cells)} cells, expected {len(self._columns)}")
        self._rows.append(tuple(copied(cell) for cell in cells))

    def lines(self, width: int | None, *, ruled: bool = False) -> Iterator[tuple[str, bool]]:
        """Yield the lines, and whether each is of a heading.

        Parameters
        ----------
        width : int or None
            Cells that a line may have; None for any number.
        ruled : bool
            Whether a line is drawn below the headings.
        """
        for number, part in enumerate(self._parts(width)):
            if number:
                yield "", False
            widths = self._widths(part, width)
            heading = self._broken([self._columns[j] for j in part], part, widths)
            for line in heading:
                yield line, True
            if ruled:
                yield "─" * (sum(widths) + GAP * (len(part) - 1)), False
            for row in self._rows:
                for line in self._broken([row[j] for j in part], part, widths):
                    yield line, False

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the lines as rich prints them."""
        width = options.max_width if console.is_terminal else None
        for line, is_heading in self.lines(width, ruled=console.is_terminal):
            style = "bold" if is_heading else ""
            # a key column alone may be wider than a small terminal: then its line goes on below
            too_wide = width is not None and cell_len(line) > width
            overflow = "fold" if too_wide else "ignore"
            yield Text(line, style=style, no_wrap=not too_wide, overflow=overflow)

    def _parts(self, width: int | None) -> Iterator[list[int]]:
        """Yield the columns of each part: as many as fit, after the keys."""
        keys, others = list(range(self._keys)), list(range(self._keys, len(self._columns)))
        if width is None or not others:
            yield keys + others
            return
        part, used = list(keys), self._total(keys)
        for j in others:
            more = GAP + self._least(j)
            if used + more > width and len(part) > len(keys):
                yield part
                part, used = list(keys), self._total(keys)
            part.append(j)
            used += more
        yield part

    def _widths(self, part: Sequence[int], width: int | None) -> list[int]:
        """Return the widths of a part's columns: what is left goes to words, then to headings."""
        whole = [max(cell_len(self._columns[j]), self._longest(j)) for j in part]
        if width is None:
            return whole
        widths = [self._least(j) for j in part]
        left = width - sum(widths) - GAP * (len(part) - 1)
        for place in sorted(range(len(part)), key=lambda k: not self._words[part[k]]):
            more = min(max(left, 0), max(whole[place] - widths[place], 0))
            widths[place] += more
            left -= more
        return widths

    def _total(self, part: Sequence[int]) -> int:
        return sum(self._least(j) for j in part) + GAP * (len(part) - 1)

    def _longest(self, j: int) -> int:
        return max((cell_len(row[j]) for row in self._rows), default=0)

    def _least(self, j: int) -> int:
        """Return the least width of a column: its longest word, and of values all of the cell."""
        heading = max((cell_len(w) for w in self._columns[j].split()), default=0)
        if not self._words[j]:
            return max(heading, self._longest(j))
        words = max((cell_len(w) for row in self._rows for w in row[j].split()), default=0)
        return max(heading, words, min(self._longest(j), WORDS_WIDTH))

    def _broken(self, cells: Sequence[str], part: Sequence[int], widths: list[int]) -> list[str]:
        """Return the lines that one row of cells takes."""
        stacks = [_wrapped(text, width) for text, width in zip(cells, widths, strict=True)]
        lines: list[str] = []
        for k in range(max(len(stack) for stack in stacks)):
            shown = [
                _set(stack[k] if k < len(stack) else "", width, right=self._right[j])
                for stack, width, j in zip(stacks, widths, part, strict=True)
            ]
            lines.append((" " * GAP).join(shown).rstrip())
        return lines


def _wrapped(text: str, width: int) -> list[str]:
    """Break a text between words."""
    if cell_len(text) <= width:
        return [text]
    lines = [""]
    for word in text.split():
        joined = f"{lines[-1]} {word}".strip()
        if cell_len(joined) <= width:
            lines[-1] = joined
        else:
            lines.append(word)
    return [line for line in lines if line]


def _set(text: str, width: int, *, right: bool) -> str:
    space = " " * max(width - cell_len(text), 0)
    return space + text if right else text + space
