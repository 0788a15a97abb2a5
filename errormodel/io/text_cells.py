"""Texts in CSV cells that a spreadsheet would take for formulas.

A cell that begins with = + - @, a tab or a carriage return is evaluated when the file is opened in
a spreadsheet. An apostrophe before it says that it is text; reading takes it off again. A text
that has apostrophes before such a sign already gets one more, so that writing and reading give the
same text back; a foreign file's cell without an apostrophe stays as it is.

References
----------
OWASP, "CSV Injection".
"""

import re

_EVALUATED = re.compile(r"'*[=+\-@\t\r]")
_MARKED = re.compile(r"'+[=+\-@\t\r]")


def cell_of_text(text: str) -> str:
    """Return what stands in a CSV cell for a text, before any quoting."""
    return f"'{text}" if _EVALUATED.match(text) else text


def text_of_cell(cell: str) -> str:
    """Return the text that a CSV cell stands for."""
    return cell[1:] if _MARKED.match(cell) else cell
