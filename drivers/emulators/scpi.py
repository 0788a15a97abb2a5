"""The grammar of SCPI commands: short and long forms, joined commands, channel lists."""

import re
from collections.abc import Callable, Sequence

_CHANNELS = re.compile(r"\(@([\d:,\s]*)\)")


class ScpiError(Exception):
    """A command refused, with what goes into the error queue."""

    def __init__(self, code: int, text: str) -> None:
        super().__init__(f"{code:+d} {text}")
        self.code = code
        self.text = text


UNDEFINED_HEADER = (-113, "Undefined header")
MISSING_PARAMETER = (-109, "Missing parameter")
PARAMETER_NOT_ALLOWED = (-108, "Parameter not allowed")
SYNTAX_ERROR = (-102, "Syntax error")
SUFFIX_OR_DATA = (-104, "Data type error")
OUT_OF_RANGE = (-222, "Data out of range")
SETTINGS_CONFLICT = (-221, "Settings conflict")
ILLEGAL_PARAMETER = (-224, "Illegal parameter value")
DATA_STALE = (-230, "Data stale")


def header_pattern(header: str) -> re.Pattern[str]:
    """Compile a header such as ``[SENSe:]VOLTage:DC:NPLC`` into a pattern for what may be sent.

    Capitals are the short form, the whole word the long one, brackets may be left out.
    """
    out = ""
    for part in re.findall(r"\[[^\]]*\]|[^\[\]]+", header):
        optional = part.startswith("[")
        nodes = part.strip("[]")
        piece = "".join(
            _word(w) if w not in (":", "?") else re.escape(w)
            for w in re.findall(r"\*?[A-Za-z]+|:|\?", nodes)
        )
        out += f"(?:{piece})?" if optional else piece
    return re.compile(out, re.IGNORECASE)


def _word(word: str) -> str:
    """Return a pattern for the short or the long form of one keyword."""
    short = "".join(c for c in word if not c.islower())
    tail = word[len(short) :]
    return re.escape(short) + (f"(?:{re.escape(tail)})?" if tail else "")


def split_commands(line: str) -> list[tuple[str, str]]:
    """Split a line at its semicolons into headers and parameters.

    A header without a leading colon goes on from the node of the one before it, as the standard
    has it; common commands (``*RST``) change nothing about that.

    Returns
    -------
    list of tuple of str
        Header without a leading colon, in the case it was sent; parameters, stripped.
    """
    out: list[tuple[str, str]] = []
    path = ""
    for unit in _outside_quotes(line, ";"):
        text = unit.strip()
        if not text:
            continue
        header, _, rest = text.partition(" ")
        if "(" in header:  # no space before a channel list
            header, rest = header[: header.index("(")], header[header.index("(") :] + rest
        if header.startswith("*"):
            out.append((header, rest.strip()))
            continue
        full = header[1:] if header.startswith(":") else path + header
        path = full[: full.rfind(":") + 1]
        out.append((full, rest.strip()))
    return out


def split_parameters(text: str) -> list[str]:
    """Split parameters at commas outside quotes and channel lists."""
    return [p.strip() for p in _outside_quotes(text, ",")] if text.strip() else []


def _outside_quotes(text: str, separator: str) -> list[str]:
    parts: list[str] = []
    depth, quote, current = 0, "", ""
    for char in text:
        if quote:
            quote = "" if char == quote else quote
        elif char in "\"'":
            quote = char
        elif char in "()":
            depth += 1 if char == "(" else -1
        elif char == separator and depth == 0:
            parts.append(current)
            current = ""
            continue
        current += char
    return [*parts, current]


def channel_list(text: str, known: Callable[[int], bool]) -> tuple[int, ...]:
    """Parse ``(@101:103,111)``.

    Parameters
    ----------
    text : str
        The list as sent.
    known : callable
        Tells whether a channel exists.

    Returns
    -------
    tuple of int
        Ascending, each once. Channels inside a range that do not exist are left out.

    Raises
    ------
    ScpiError
        If it is no channel list, or a channel named does not exist.
    """
    match = _CHANNELS.fullmatch(text.replace(" ", ""))
    if match is None:
        raise ScpiError(*SYNTAX_ERROR)
    out: set[int] = set()
    for part in filter(None, match[1].split(",")):
        ends = part.split(":")
        if len(ends) > 2 or not all(e.isdigit() for e in ends):
            raise ScpiError(*SYNTAX_ERROR)
        first, last = int(ends[0]), int(ends[-1])
        if not (known(first) and known(last)) or last < first or last > 9999:
            raise ScpiError(*OUT_OF_RANGE)
        out.update(c for c in range(first, last + 1) if known(c))
    return tuple(sorted(out))


def block(text: str) -> str:
    """Return text as a definite-length block."""
    size = str(len(text))
    return f"#{len(size)}{size}{text}"


def one_of(text: str, choices: Sequence[str]) -> str:
    """Return the short form of the choice that was sent.

    Raises
    ------
    ScpiError
        If it is not one of them.
    """
    for choice in choices:
        if header_pattern(choice).fullmatch(text):
            return "".join(c for c in choice if not c.islower())
    raise ScpiError(*ILLEGAL_PARAMETER)
