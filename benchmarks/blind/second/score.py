"""Rates of the second blind benchmark, with 95 % limits, as Markdown tables.

python -m benchmarks.blind.second.score answers.jsonl [--failures]
"""

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
from scipy import stats

from benchmarks.blind.second.outcome import RIGHT, Case, cases_of

BANDS = ((5.0, 7.0), (7.0, 10.0), (10.0, 20.0), (20.0, 60.0), (60.0, 1e9))
SURE = ((0.5, 0.8), (0.8, 0.95), (0.95, 0.99), (0.99, 1.01))
OUTCOMES = ("exact", "alias", "too many", "wrong", "in part", "unexplained", "missed", "failed")
STRANGE = (
    "named",
    "told",
    "wrong name",
    "half a name",
    "wrong alias",
    "only beside",
    "silent",
    "failed",
)


def limits(hits: int, total: int) -> tuple[float, float]:
    """Return the 95 % limits of a share (Clopper and Pearson 1934), in per cent."""
    low = stats.beta.ppf(0.025, hits, total - hits + 1) if hits else 0.0
    high = stats.beta.ppf(0.975, hits + 1, total - hits) if hits < total else 1.0
    return 100 * float(low), 100 * float(high)


def rate(cases: Sequence[Case], hit: Callable[[Case], bool]) -> str:
    """Return `hits of total = share | limits`, for a table."""
    hits, total = sum(map(hit, cases)), len(cases)
    if not total:
        return "0 of 0 | –"
    low, high = limits(hits, total)
    return f"{hits} of {total} = {100 * hits / total:.1f} % | {low:.1f}–{high:.1f} %"


def acceptance(cases: Sequence[Case]) -> list[str]:
    """Return the lines of what is asked and what was measured."""
    nulls = _of(cases, "nulls")
    library = [c for c in _of(cases, "library", "pairs") if c.d >= 10]
    single = [c for c in library if c.group == "library"]
    strange = _of(cases, "outside")
    predicted = [c for c in strange if c.predictive]
    found = [c for c in library if c.unseen is not None and c.outcome in RIGHT]
    rows: list[tuple[str, str, Sequence[Case], Callable[[Case], bool]]] = [
        ("nothing hidden: a false verdict", "≤ 2 %", nulls, lambda c: c.outcome == "false"),
        (
            "nothing hidden in it, but in another of the same head: a false verdict",
            "–",
            _of(cases, "companion"),
            lambda c: c.outcome == "false",
        ),
        ("library, d ≥ 10: exactly or in an alias set", "≥ 95 %", library, _right),
        ("… one effect", "–", single, _right),
        ("… two effects", "–", [c for c in library if c.group == "pairs"], _right),
        ("library, any d: names too many", "≤ 2 %", _of(cases, "library", "pairs"), _too_many),
        ("library, any d: wrong", "–", _of(cases, "library", "pairs"), _wrong),
        (
            "outside: told unexplained or partly, with the right factor",
            "≥ 95 %",
            strange,
            lambda c: c.told and (c.factor_right or c.outcome == "named"),
        ),
        ("outside: told, whatever the factor", "–", strange, lambda c: c.told),
        (
            "outside: a bare library name that explains less than half",
            "≤ 1 %",
            strange,
            lambda c: c.bare_wrong,
        ),
        (
            "outside: a model is written, and the unseen run within 1.1 of the noise",
            "≥ 90 %",
            predicted,
            lambda c: c.unseen is not None and c.unseen <= 1.1,
        ),
        (
            "library found: unseen run within 1.1 of the noise",
            "–",
            found,
            lambda c: (c.unseen or 0) <= 1.1,
        ),
        ("no answer", "–", cases, lambda c: c.outcome == "failed"),
    ]
    head = ["| what | asked | measured | 95 % limits |", "|---|---|---|---|"]
    return head + [f"| {what} | {asked} | {rate(some, hit)} |" for what, asked, some, hit in rows]


def _right(c: Case) -> bool:
    return c.outcome in RIGHT


def _too_many(c: Case) -> bool:
    return c.outcome == "too many"


def _wrong(c: Case) -> bool:
    return c.outcome == "wrong"


def _of(cases: Sequence[Case], *groups: str) -> list[Case]:
    return [c for c in cases if c.group in groups]


def counted(
    title: str, cases: Sequence[Case], by: Callable[[Case], str], outcomes: Sequence[str]
) -> list[str]:
    """Return a table: how often each outcome was, by something; nothing without cases."""
    if not cases:
        return []
    lines = ["", f"| {title} | n | {' | '.join(outcomes)} |", "|---" * (len(outcomes) + 2) + "|"]
    for name in sorted({by(c) for c in cases}):
        some = [c for c in cases if by(c) == name]
        numbers = [sum(c.outcome == o for c in some) for o in outcomes]
        lines.append(f"| {name} | {len(some)} | {' | '.join(str(n or '') for n in numbers)} |")
    return lines


def band(c: Case) -> str:
    """Return the band of strength a case is in."""
    for low, high in BANDS:
        if low <= c.d < high:
            return f"{low:3.0f} ≤ d" + (f" < {high:.0f}" if high < 1e8 else "")
    return "d < 5"


def protocols(cases: Iterable[Case]) -> list[str]:
    """Return a table of right answers by how the campaign was run and by its noise."""
    ways: dict[str, Callable[[Case], str]] = {
        "style": lambda c: c.protocol["style"],
        "range": lambda c: c.protocol["span"],
        "runs": lambda c: _runs(c.protocol["runs"]),
        "positions": lambda c: f"{c.protocol['positions']:2d}",
        "order": lambda c: "random" if c.protocol["random_order"] else "cycle",
        "rates": lambda c: "mixed" if c.protocol["mixed_rates"] else "one",
        "model": lambda c: c.present,
    }
    families = sorted({word for c in cases for word in c.noise.split("+")})
    some = list(cases)
    lines = ["", "| protocol | right | 95 % limits |", "|---|---|---|"]
    for title, by in ways.items():
        for name in sorted({by(c) for c in some}):
            chosen = [c for c in some if by(c) == name]
            lines.append(f"| {title}: {name} | {rate(chosen, is_right)} |")
    for word in families:
        chosen = [c for c in some if word in c.noise.split("+")]
        lines.append(f"| noise: {word} | {rate(chosen, is_right)} |")
    return lines


def _runs(n: int) -> str:
    return "2, 3" if n < 4 else "4 to 6" if n < 7 else "8 to 12" if n < 13 else "20, 30"


def is_right(c: Case) -> bool:
    """Return True if an answer is what was to be had of its set."""
    if c.group in ("nulls", "companion"):
        return c.outcome == "silent"
    if c.group == "outside":
        return c.told and not c.bare_wrong and (c.factor_right or c.outcome == "named")
    return c.outcome in RIGHT


def calibration(cases: Iterable[Case]) -> list[str]:
    """Return how often verdicts were right by the weight they were said with; empty without."""
    said = [(c.weight, c) for c in cases if c.weight is not None]
    if not said:
        return []
    lines = ["", "| weight of the verdict | right | 95 % limits |", "|---|---|---|"]
    for low, high in SURE:
        some = [c for weight, c in said if low <= weight < high]
        lines.append(f"| {low} to {min(high, 1)} | {rate(some, is_right)} |")
    return lines


def failure(c: Case) -> str:
    """Return a line on an answer that is not right."""
    p = c.protocol
    said = f"{c.verdict}: {', '.join(c.bare) or '–'}"
    said += "".join(f" {{{', '.join(names)}}}" for names in c.aliases)
    where = f"; follows {', '.join(c.factors) or '–'}; left: {c.left}"
    return (
        f"- {c.seed} {c.serial} {c.kind} d={c.d:.0f} [{c.outcome}] {said}{where} "
        f"({p['style']} {p['span']}, {p['runs']} runs, {p['positions']} positions, {c.noise}, "
        f"{c.present})"
    )


def report(cases: Sequence[Case], *, failures: bool = False) -> str:
    """Return the tables."""
    library, strange = _of(cases, "library", "pairs"), _of(cases, "outside")
    lines = acceptance(cases)
    lines += counted("library by strength", library, band, OUTCOMES)
    lines += counted("library", library, lambda c: c.kind, OUTCOMES)
    lines += counted("outside", strange, lambda c: c.kind.partition("+")[0], STRANGE)
    lines += counted("beside", strange, lambda c: "with" if c.beside else "alone", STRANGE)
    lines += protocols(cases)
    lines += calibration(cases)
    seconds = {c.seed: c.cpu_s for c in cases if c.cpu_s is not None}
    if seconds:
        took = list(seconds.values())
        lines += ["", f"Processor time: {np.median(took):.1f} s median, {max(took):.1f} s at most."]
    if failures:
        lines += ["", *(failure(c) for c in cases if not is_right(c))]
    return "\n".join(lines) + "\n"


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Rates of the second blind benchmark.")
    parser.add_argument("answers", type=Path)
    parser.add_argument("--failures", action="store_true", help="list them, with their seeds")
    asked = parser.parse_args(argv)
    records = asked.answers.read_text(encoding="utf-8").splitlines()
    cases = [case for line in records for case in cases_of(json.loads(line))]
    cases.sort(key=lambda c: (c.seed, c.serial))
    sys.stdout.write(report(cases, failures=asked.failures))
    return 0


if __name__ == "__main__":
    sys.exit(main())
