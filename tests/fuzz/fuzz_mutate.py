"""Seeded damage to text files: what crashes, editors, exports and people do to them."""

import re
from collections.abc import Callable

import numpy as np

Mutation = Callable[[bytes, np.random.Generator], bytes]

MAX_LINE = 1_000_000
NUMBER = re.compile(rb"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?", re.IGNORECASE)
ODD_NUMBERS = (
    b"nan", b"inf", b"-inf", b"1e999", b"-1e999", b"-5", b"0", b"-0.0", b"1e-320", b"007", b"1_0",
    b"99999999999999999999999999", b"1" + b"0" * 400, b"1.2.3", b"0x1F", b"1e5", b"", b"true",
    b'"1"', b"[1]", b"{}", b"2026-11-22", "٣".encode(), b"1,5", b"=1+1", b"None",
)  # fmt: skip
ENCODINGS = ("utf-16", "utf-16-le", "utf-32", "latin-1", "cp1251", "cp037", "utf-7")


def _pick(text: bytes, rng: np.random.Generator) -> int:
    return int(rng.integers(len(text) + 1))


def flip_bytes(text: bytes, rng: np.random.Generator) -> bytes:
    data = bytearray(text)
    for _ in range(int(rng.integers(1, 6)) if data else 0):
        data[int(rng.integers(len(data)))] ^= int(rng.integers(1, 256))
    return bytes(data)


def insert_bytes(text: bytes, rng: np.random.Generator) -> bytes:
    at = _pick(text, rng)
    odd = (rng.bytes(int(rng.integers(1, 9))), b"\0", b"\xef\xbb\xbf", b'"', b"\r", b"\n", b"\x85")
    return text[:at] + odd[int(rng.integers(len(odd)))] + text[at:]


def truncate(text: bytes, rng: np.random.Generator) -> bytes:
    return text[: _pick(text, rng)]


def drop_a_piece(text: bytes, rng: np.random.Generator) -> bytes:
    start, end = sorted((_pick(text, rng), _pick(text, rng)))
    return text[:start] + text[min(end, start + 40) :]


def _on_lines(change: Callable[[list[bytes], np.random.Generator], None]) -> Mutation:
    def mutate(text: bytes, rng: np.random.Generator) -> bytes:
        lines = text.splitlines(keepends=True)
        if lines:
            change(lines, rng)
        return b"".join(lines)

    mutate.__name__ = change.__name__.lstrip("_")
    return mutate


def _drop_line(lines: list[bytes], rng: np.random.Generator) -> None:
    del lines[int(rng.integers(len(lines)))]


def _double_line(lines: list[bytes], rng: np.random.Generator) -> None:
    at = int(rng.integers(len(lines)))
    lines.insert(int(rng.integers(len(lines) + 1)), lines[at])


def _swap_lines(lines: list[bytes], rng: np.random.Generator) -> None:
    i, j = int(rng.integers(len(lines))), int(rng.integers(len(lines)))
    lines[i], lines[j] = lines[j], lines[i]


def _long_line(lines: list[bytes], rng: np.random.Generator) -> None:
    at = int(rng.integers(len(lines)))
    line = lines[at].rstrip(b"\n")
    lines[at] = (line * int(rng.integers(50, 20_000)))[:MAX_LINE] + b"\n"


def _cut_line(lines: list[bytes], rng: np.random.Generator) -> None:
    at = int(rng.integers(len(lines)))
    lines[at] = lines[at][: _pick(lines[at], rng)]


def odd_number(text: bytes, rng: np.random.Generator) -> bytes:
    found = list(NUMBER.finditer(text))
    if not found:
        return text
    match = found[int(rng.integers(len(found)))]
    odd = ODD_NUMBERS[int(rng.integers(len(ODD_NUMBERS)))]
    return text[: match.start()] + odd + text[match.end() :]


def swap_words(text: bytes, rng: np.random.Generator) -> bytes:
    """Put one word in the place of another: wrong keys, wrong units, wrong types."""
    found = list(re.finditer(rb"[\w./-]+", text))
    if len(found) < 2:
        return text
    chosen = rng.choice(len(found), 2, replace=False)
    here, there = found[int(chosen[0])], found[int(chosen[1])]
    return text[: here.start()] + there.group() + text[here.end() :]


def swap_delimiter(text: bytes, rng: np.random.Generator) -> bytes:
    new = (b";", b"\t", b" ", b"|", b",,")[int(rng.integers(5))]
    return text.replace(b"," if b"," in text else b"=", new)


def other_encoding(text: bytes, rng: np.random.Generator) -> bytes:
    name = ENCODINGS[int(rng.integers(len(ENCODINGS)))]
    return (text.decode("utf-8", "replace") + "°ж").encode(name, "replace")


def other_line_ends(text: bytes, rng: np.random.Generator) -> bytes:
    return text.replace(b"\n", (b"\r\n", b"\r", b"\n\n", b"\n\r", b" \n")[int(rng.integers(5))])


def deep_nesting(text: bytes, rng: np.random.Generator) -> bytes:
    deep = int(rng.choice([50, 2000, 100_000]))
    forms = (
        b"deep = " + b"[" * deep + b"]" * deep,
        b"deep = " + b"{a=" * deep + b"1" + b"}" * deep,
        b"[" + b"a." * deep + b"a]",
        b"(" * deep,
        b'"' * deep,
    )
    at = text.find(b"\n", _pick(text, rng)) + 1
    return text[:at] + forms[int(rng.integers(len(forms)))] + b"\n" + text[at:]


def other_type(text: bytes, rng: np.random.Generator) -> bytes:
    """Give a key a value of another type."""
    found = list(re.finditer(rb"=[ \t]*[^\n]+", text))
    if not found:
        return text
    match = found[int(rng.integers(len(found)))]
    values = (b"[]", b"{}", b"true", b'"text"', b"1", b"-1.5", b"[[1]]", b"{a = {b = 1}}", b'""',
              b"2026-01-01", b"12:00:00", b"2026-01-01T00:00:00Z", b"inf", b"nan")  # fmt: skip
    return (
        text[: match.start()] + b"= " + values[int(rng.integers(len(values)))] + text[match.end() :]
    )


MUTATIONS: tuple[Mutation, ...] = (
    flip_bytes,
    insert_bytes,
    truncate,
    drop_a_piece,
    _on_lines(_drop_line),
    _on_lines(_double_line),
    _on_lines(_swap_lines),
    _on_lines(_long_line),
    _on_lines(_cut_line),
    odd_number,
    odd_number,
    swap_words,
    swap_delimiter,
    other_encoding,
    other_line_ends,
    deep_nesting,
    other_type,
    other_type,
)


def mutate(text: bytes, seed: int) -> tuple[bytes, str]:
    """Return damaged text and the names of what was done to it; the same for the same seed."""
    rng = np.random.default_rng(seed)
    chosen = rng.integers(len(MUTATIONS), size=int(rng.choice([1, 1, 1, 2, 3])))
    for index in chosen:
        text = MUTATIONS[int(index)](text, rng)
    return text, " + ".join(MUTATIONS[int(i)].__name__ for i in chosen)
