"""The benchmark in words, as a table, as a page and as a picture."""

import io
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from benchmarks.blind.chamber.effects import LIBRARY, OUTSIDE
from benchmarks.blind.scoring import Rate, Scored, acceptance


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """What a benchmark is about: its effects, its rates, and how its conditions are called."""

    library: Sequence[str]
    outside: Sequence[str]
    acceptance: Callable[[Sequence[Scored]], list[Rate]]
    groups: Sequence[str]  # of sets with effects of the library
    conditions: tuple[str, str]  # what `protocol` and `noise` of a set are
    not_alone: Sequence[str]  # groups that the confusion matrix leaves out
    template: Path


HERE = Path(__file__).parent
THERMAL = Subject(
    library=LIBRARY,
    outside=OUTSIDE,
    acceptance=acceptance,
    groups=("single", "pair", "slow lag", "fast lag"),
    conditions=("protocol", "noise"),
    not_alone=("pair", "invisible"),
    template=HERE / "chamber/page.template.md",
)

GOOD, FRANK, WRONG = "#0072B2", "#E69F00", "#D55E00"  # Okabe and Ito
# outcome: colour; from right to wrong
OUTCOMES = {
    "named": GOOD,
    "alias": "#56B4E9",
    "in part": "#BFBFBF",
    "unexplained": "#8A8A8A",
    "missed": FRANK,
    "wrong alias": "#CC79A7",
    "wrong name": WRONG,
    "failed": "#000000",
}
STRENGTHS = ((7.0, 9.99), (9.99, 20.0), (20.0, 50.0), (50.0, 1e9))


def _verdict_column(s: Scored) -> str:
    """Return where a verdict stands in the confusion matrix."""
    if s.outcome == "failed":
        return "failed"
    strangers = [n for n in s.bare if n not in s.hidden]
    if strangers:
        return strangers[0]
    if s.bare:
        return s.bare[0]
    if s.aliases:
        return (
            "alias with it" if any(set(a) & set(s.hidden) for a in s.aliases) else "alias without"
        )
    return s.verdict


def confusion(sets: Sequence[Scored], subject: Subject) -> tuple[list[str], list[str], np.ndarray]:
    """Return rows (what was hidden alone), columns (what was said) and counts."""
    rows = ["nothing", *subject.library, *subject.outside]
    columns = [
        *subject.library,
        "alias with it",
        "alias without",
        "unexplained_repeatable",
        "unexplained_noise",
        "nothing",
        "failed",
    ]
    counts = np.zeros((len(rows), len(columns)), dtype=int)
    for s in sets:
        if s.group in subject.not_alone:
            continue
        truth = next(iter(s.hidden), "nothing")
        said = _verdict_column(s)
        if said not in columns:  # a name that the contract does not know
            said = "failed"
        counts[rows.index(truth), columns.index(said)] += 1
    return rows, columns, counts


def rate_line(rate: Rate) -> str:
    low, high = rate.limits
    asked = "–"
    if rate.least is not None:
        asked = f"≥ {rate.least:.0%}"
    elif rate.most is not None:
        asked = f"≤ {rate.most:.0%}"
    met = {True: "yes", False: "**no**", None: "–"}[rate.met]
    if not rate.of:
        return f"| {rate.text} | {asked} | – | – | – |"
    share = f"{rate.good} of {rate.of} = {100 * rate.share:.1f} %"
    return f"| {rate.text} | {asked} | {share} | {100 * low:.1f}–{100 * high:.1f} % | {met} |"


def rates_table(sets: Sequence[Scored], subject: Subject) -> str:
    head = "| what | required | measured | 95 % limits | met |\n|---|---|---|---|---|\n"
    return head + "\n".join(map(rate_line, subject.acceptance(sets)))


def confusion_table(sets: Sequence[Scored], subject: Subject) -> str:
    """Return the confusion matrix as a table: one line for each hidden effect."""
    rows, columns, counts = confusion(sets, subject)
    lines = ["| hidden | answer (count) |", "|---|---|"]
    for row, line in zip(rows, counts, strict=True):
        if line.sum():
            order = np.argsort(-line, kind="stable")
            said = ", ".join(f"{columns[k]} {line[k]}" for k in order if line[k])
            lines.append(f"| {row} | {said} |")
    return "\n".join(lines)


def conditions_table(sets: Sequence[Scored], subject: Subject) -> str:
    """Return the outcomes of library effects by strength, noise and protocol."""
    library = [s for s in sets if s.group in subject.groups]
    used = [o for o in OUTCOMES if any(s.outcome == o for s in library)]
    lines = ["| sets | " + " | ".join(used) + " |", "|---|" + "---|" * len(used)]
    for label, chosen in _slices(library, subject):
        count = Counter(s.outcome for s in chosen)
        lines.append(f"| {label} | " + " | ".join(str(count[o] or "·") for o in used) + " |")
    return "\n".join(lines)


def _slices(sets: Sequence[Scored], subject: Subject) -> list[tuple[str, list[Scored]]]:
    out: list[tuple[str, list[Scored]]] = []
    for low, high in STRENGTHS:
        label = f"d ≥ {low:.0f}" if high > 1e6 else f"{low:.0f} ≤ d < {high:.0f}"
        out.append((label, [s for s in sets if low <= s.d < high]))
    for noise in dict.fromkeys(s.noise for s in sets):
        out.append((noise, [s for s in sets if s.noise == noise]))
    for protocol in sorted({s.protocol for s in sets}):
        out.append((protocol, [s for s in sets if s.protocol == protocol]))
    for group in subject.groups:
        out.append((group, [s for s in sets if s.group == group]))
    return [(label, chosen) for label, chosen in out if chosen]


def faults(sets: Sequence[Scored], subject: Subject) -> str:
    """Return a line for each verdict that was not right, without its seed or folder."""
    lines: list[str] = []
    for s in sets:
        right = s.outcome in ("named", "alias", "silent") or (
            s.group == "outside" and s.outcome.startswith("unexplained")
        )
        if right:
            continue
        hidden = ", ".join(
            f"{n} {v['size']:.3g} {v['unit']} (d {v['d']:.1f})" for n, v in s.hidden.items()
        )
        said = ", ".join(s.bare) + "".join(f" [{' or '.join(a)}]" for a in s.aliases)
        lines.append(
            f"| {s.group} | {s.protocol} | {s.noise} | {hidden or 'nothing'} | "
            f"{s.verdict}: {said or '–'} | {s.outcome} |"
        )
    if not lines:
        return "There was none."
    head = f"| group | {' | '.join(subject.conditions)} | hidden | said | called |\n"
    return head + "|---|---|---|---|---|---|\n" + "\n".join(lines)


def alias_sizes(sets: Sequence[Scored]) -> str:
    """Return how many names the alias sets hold: one that holds all says nothing."""
    sizes = [len(names) for s in sets if s.outcome == "alias" for names in s.aliases]
    if not sizes:
        return "No alias sets were right."
    return (
        f"Correct alias sets have a median of {np.median(sizes):.0f} names (maximum {max(sizes)})."
    )


def speed(sets: Sequence[Scored]) -> str:
    seconds = np.array([s.seconds for s in sets if s.seconds is not None])
    if not seconds.size:
        return "Nothing is known of the time."
    return (
        f"An answer took {np.median(seconds):.1f} s of processor time at the median, "
        f"{seconds.max():.1f} s at most."
    )


def table(sets: Sequence[Scored], subject: Subject) -> str:
    """Return everything as text."""
    return "\n\n".join(
        [
            f"{len(sets)} data sets. {speed(sets)}",
            rates_table(sets, subject),
            confusion_table(sets, subject),
            conditions_table(sets, subject),
            alias_sizes(sets),
            faults(sets, subject),
        ]
    )


def page(sets: Sequence[Scored], subject: Subject) -> str:
    """Return the document."""
    return subject.template.read_text(encoding="utf-8").format(
        n=len(sets),
        rates=rates_table(sets, subject),
        confusion=confusion_table(sets, subject),
        conditions=conditions_table(sets, subject),
        alias_sizes=alias_sizes(sets),
        faults=faults(sets, subject),
        speed=speed(sets),
    )


def picture(sets: Sequence[Scored], subject: Subject) -> bytes:
    """Return a PNG: the confusion matrix, and the outcomes by condition."""
    figure: Any = Figure(figsize=(13, 8.2), dpi=90, layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2, width_ratios=[2.3, 1])
    _draw_confusion(left, sets, subject)
    _draw_outcomes(right, [s for s in sets if s.group in subject.groups], subject)
    figure.suptitle(
        f"What the workflow said about {len(sets)} data sets whose truth it could not see",
        fontsize=12,
    )
    buffer = io.BytesIO()
    figure.canvas.print_png(buffer, metadata={"Software": None})
    return buffer.getvalue()


def _draw_confusion(axes: Any, sets: Sequence[Scored], subject: Subject) -> None:
    rows, columns, counts = confusion(sets, subject)
    used = counts.sum(axis=1) > 0
    counts, rows = counts[used], [r for r, u in zip(rows, used, strict=True) if u]
    share = counts / counts.sum(axis=1, keepdims=True)
    axes.imshow(share, cmap="Blues", vmin=0, vmax=1.2, aspect="auto")
    for i, j in np.argwhere(counts):
        colour = "white" if share[i, j] > 0.6 else "black"
        axes.text(j, i, str(counts[i, j]), ha="center", va="center", fontsize=8, color=colour)
    axes.set_xticks(range(len(columns)), [c.replace("_", " ") for c in columns], rotation=60)
    for label in axes.get_xticklabels():
        label.set_horizontalalignment("right")
        label.set_rotation_mode("anchor")
    axes.set_yticks(range(len(rows)), [r.replace("_", " ") for r in rows])
    axes.tick_params(labelsize=8)
    axes.axvline(len(subject.library) - 0.5, color="#888888", linewidth=0.8)
    for name in ("nothing", *subject.outside[:1]):
        if name in rows:
            edge = rows.index(name) + (0.5 if name == "nothing" else -0.5)
            axes.axhline(edge, color="#888888", linewidth=0.8)
    axes.set_xlabel("said: a bare name, or what is right of the line", fontsize=9)
    axes.set_ylabel("hidden, alone", fontsize=9)
    axes.set_title("Number of sets (shade: share of the row)", fontsize=10)


def _draw_outcomes(axes: Any, sets: Sequence[Scored], subject: Subject) -> None:
    slices = _slices(sets, subject)
    at = np.arange(len(slices))[::-1]
    left = np.zeros(len(slices))
    for name, colour in OUTCOMES.items():
        width = np.array([100 * np.mean([s.outcome == name for s in c]) for _, c in slices])
        if width.any():
            axes.barh(at, width, left=left, color=colour, label=name, height=0.75)
        left += width
    axes.set_yticks(at, [f"{label}  ({len(chosen)})" for label, chosen in slices])
    axes.tick_params(labelsize=8)
    axes.set_xlim(0, 100)
    axes.set_xlabel("share of the sets with effects of the library, %", fontsize=9)
    protocol, noise = subject.conditions
    axes.set_title(f"Outcome by strength, {noise},\n{protocol} and kind", fontsize=10)
    axes.legend(loc="upper center", bbox_to_anchor=(0.4, -0.1), ncols=3, fontsize=8, frameon=False)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
