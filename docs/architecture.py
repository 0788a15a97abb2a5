"""Draw the packages and their folders from the code's own imports: `make docs` calls it.

    python docs/architecture.py docs/pictures/architecture.svg

A folder stands above every folder that it imports from; an arrow is drawn to the nearest of them
only: what is reached through a folder between is left out. Files directly in a package count as
one folder, "(root)". A circle between folders is an error.
"""

import ast
import sys
from collections import defaultdict
from pathlib import Path

from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

ROOT = Path(__file__).parents[1]
PACKAGES = {
    "accelbench": "what a user calls: commands, reports, Python",
    "thermo": "accelerometers over temperature",
    "sinscal": "SINS on a rig",
    "drivers": "instruments and the bytes they speak",
    "errormodel": "terms, fit, noise, filter, statistics",
}
COLOURS = {
    "accelbench": "#DCE6F0", "thermo": "#F6E3D3", "sinscal": "#DDEEDD",
    "drivers": "#ECE2F0", "errormodel": "#F2EFD8",
}  # fmt: skip
Graph = dict[str, set[str]]


def folders() -> Graph:
    """Return which folder imports from which, by dotted name."""
    modules = {
        ".".join(p.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): p
        for package in PACKAGES
        for p in (ROOT / package).rglob("*.py")
    }
    home = {name: _folder(path) for name, path in modules.items()}
    found: Graph = {folder: set() for folder in home.values()}
    for name, path in modules.items():
        for other in _imported(path, modules.keys()):
            if home[other] != home[name]:
                found[home[name]].add(home[other])
    return found


def _folder(path: Path) -> str:
    # the folders of the commands are drawn as rooms of the shell
    parts = [p for p in path.relative_to(ROOT).parts if p != "commands"]
    return f"{parts[0]}.{parts[1]}" if len(parts) > 2 else parts[0]


def _imported(path: Path, known: object) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{a.name}" for a in node.names)}
        elif isinstance(node, ast.Import):
            names |= {a.name for a in node.names}
    return {n for n in names if n in known}  # type: ignore[operator]


def floors(graph: Graph, package: str) -> dict[str, int]:
    """Return the floor of each folder of a package: one above the highest that it imports from.

    Raises
    ------
    ValueError
        If folders import from one another in a circle.
    """
    inside = {f: {g for g in graph[f] if g.startswith(f"{package}.")} for f in graph
              if f.startswith(f"{package}.")}  # fmt: skip
    found: dict[str, int] = {}

    def floor(folder: str, path: tuple[str, ...]) -> int:
        if folder in path:
            raise ValueError(f"circle: {' -> '.join([*path, folder])}")
        if folder not in found:
            below = [floor(g, (*path, folder)) for g in inside[folder]]
            found[folder] = 1 + max(below, default=-1)
        return found[folder]

    for folder in inside:
        floor(folder, ())
    return found


def nearest(graph: Graph, folder: str, package: str) -> set[str]:
    """Return what a folder imports from in its package, without what it reaches through another."""
    direct = {g for g in graph[folder] if g.startswith(f"{package}.")}
    through: set[str] = set()
    stack = list(direct)
    while stack:
        further = {g for g in graph[stack.pop()] if g.startswith(f"{package}.")} - through
        through |= further
        stack += further
    return direct - through


WIDTH, HEIGHT, GAP_X, GAP_Y = 1.5, 0.34, 0.2, 0.36


def draw(graph: Graph, path: Path) -> None:
    """Draw all packages, the shell on top."""
    figure = Figure(figsize=(11.0, 9.0))
    FigureCanvasSVG(figure)
    axes = figure.add_axes((0.01, 0.01, 0.98, 0.98))
    axes.set_axis_off()
    y = 0.0
    for row in (("errormodel", "drivers"), ("thermo", "sinscal"), ("accelbench",)):
        heights = [_package(axes, graph, name, x0, y, span) for name, x0, span in _shared(row)]
        y += max(heights) + 0.45
    axes.set_xlim(-0.1, 11.1)
    axes.set_ylim(-0.2, y)
    figure.savefig(path, metadata={"Date": None, "Creator": None})


def _shared(row: tuple[str, ...]) -> list[tuple[str, float, float]]:
    span = 11.0 / len(row)
    return [(name, k * span, span - (0.2 if len(row) > 1 else 0.0)) for k, name in enumerate(row)]


def _package(axes: object, graph: Graph, package: str, x0: float, y0: float, span: float) -> float:
    rows = defaultdict(list)
    for folder, floor in sorted(floors(graph, package).items()):
        rows[floor].append(folder)
    per_line = max(1, int((span - 0.2) // (WIDTH + GAP_X)))
    place: dict[str, tuple[float, float]] = {}
    y = y0 + 0.3
    for floor in sorted(rows):
        line = rows[floor]
        for start in range(0, len(line), per_line):
            part = line[start : start + per_line]
            width = len(part) * (WIDTH + GAP_X) - GAP_X
            for k, folder in enumerate(part):
                place[folder] = (x0 + (span - width) / 2 + k * (WIDTH + GAP_X), y)
            y += HEIGHT + GAP_Y
    height = y - y0 + 0.15
    add = axes.add_patch  # type: ignore[attr-defined]
    add(FancyBboxPatch((x0, y0), span, height, boxstyle="round,pad=0,rounding_size=0.1",
                       facecolor=COLOURS[package], edgecolor="none"))  # fmt: skip
    label = f"{package}: {PACKAGES[package]}"
    axes.text(x0 + 0.12, y0 + height - 0.12, label, va="top", fontsize=11,  # type: ignore[attr-defined]
              fontweight="bold")  # fmt: skip
    for folder, (x, at) in place.items():
        for other in sorted(nearest(graph, folder, package)):
            to_x, to_y = place[other]
            add(FancyArrowPatch((x + WIDTH / 2, at), (to_x + WIDTH / 2, to_y + HEIGHT),
                                arrowstyle="-|>", mutation_scale=7, linewidth=0.7, color="#777777",
                                shrinkA=0, shrinkB=0))  # fmt: skip
    for folder, (x, at) in place.items():
        add(FancyBboxPatch((x, at), WIDTH, HEIGHT, boxstyle="round,pad=0,rounding_size=0.06",
                           facecolor="white", edgecolor="#555555", linewidth=0.8,
                           zorder=3))  # fmt: skip
        axes.text(x + WIDTH / 2, at + HEIGHT / 2, folder.partition(".")[2], ha="center",  # type: ignore[attr-defined]
                  va="center", fontsize=9.5, zorder=4)  # fmt: skip
    return height


if __name__ == "__main__":
    draw(folders(), Path(sys.argv[1]))
