"""Style of all figures: colours, thinning, units, and their conversion to bytes.

Figures are made with matplotlib's objects only: no window, no state that one leaves to the next.
"""

import io
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from errormodel.arrays import FloatArray, IntArray
from thermo.recording.channel import COOLING, HEATING, HOLD

# Okabe and Ito's palette, told apart also by the colour-blind; two colours are kept for directions.
HEATING_COLOUR, COOLING_COLOUR, HOLD_COLOUR = "#D55E00", "#0072B2", "#8A8A8A"
COLOURS = ("#000000", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#7F5F00", "#7A7A7A")
STYLES = ("-", "--", "-.", ":")
MARKERS = ("o", "s", "D", "^", "v", "P", "X")
# direction: (name, colour, marker), in the order of drawing
DIRECTION_STYLE = {
    HOLD: ("hold", HOLD_COLOUR, "o"),
    HEATING: ("heating", HEATING_COLOUR, "^"),
    COOLING: ("cooling", COOLING_COLOUR, "v"),
}
MAX_POINTS = 6000  # of one scatter: more only blackens the page and takes its time
DPI = 140  # sharp enough on paper
FEW_LINES = 6  # told apart in one panel; more nobody follows
MILLI_FROM_UG = 5000.0  # larger values are shown in mg


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A figure, drawn: `name` without folder, `png` its bytes."""

    name: str
    caption: str
    png: bytes

    def __repr__(self) -> str:
        return f"<picture {self.name}>"

    def _repr_png_(self) -> bytes:
        """Return the picture as a notebook shows it."""
        return self.png


def new_figure(width_in: float, height_in: float) -> Any:
    """Return an empty figure that places its parts without overlap."""
    # the titles of lower panels keep off the labels of those above
    layout = ConstrainedLayoutEngine(h_pad=0.08, w_pad=0.06)
    figure = Figure(figsize=(width_in, height_in), dpi=DPI, layout=layout)
    FigureCanvasAgg(figure)
    return figure


def picture(figure: Any, name: str, caption: str) -> Picture:
    """Draw a figure."""
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        # a serial number in a script the font lacks is shown as boxes; that is no fault of the run
        warnings.filterwarnings("ignore", message="Glyph .* missing")
        # not savefig: that draws everything twice
        figure.canvas.print_png(buffer, metadata={"Software": None})
    figure.clear()
    return Picture(name=name, caption=caption, png=buffer.getvalue())


def thinned(n: int, limit: int = MAX_POINTS) -> IntArray:
    """Return at most `limit` of n indices, spread evenly but not in step with a period."""
    if n <= limit:
        return np.arange(n)
    first = np.arange(limit) * n // limit
    jitter = np.random.default_rng(1).integers(n // limit, size=limit)
    return np.asarray(first + jitter, dtype=np.intp)


def panel_unit(*values_ug: FloatArray) -> tuple[str, float]:
    """Return the unit for a panel and what µg are divided by: µg, or mg when they are many."""
    largest = max((float(np.max(np.abs(v))) for v in values_ug if v.size), default=0.0)
    return ("mg", 1e3) if largest > MILLI_FROM_UG else ("µg", 1.0)


def cell_means(x: FloatArray, y: FloatArray, width: float) -> tuple[FloatArray, FloatArray]:
    """Return centres and means of cells of x, NaN in cells without readings between others."""
    cell = np.floor(x / width).astype(np.intp)
    first = int(cell.min())
    count = np.bincount(cell - first)
    total = np.bincount(cell - first, weights=y)
    mean = np.divide(total, count, out=np.full(count.size, np.nan), where=count > 0)
    return (first + np.arange(count.size) + 0.5) * width, mean


def plain(text: str) -> str:
    """Return text that matplotlib does not take for a formula."""
    return text.replace("$", r"\$")


def dress(axes: Any, *, title: str = "", x: str = "", y: str = "") -> None:
    """Give axes a title, labels and a light grid."""
    if title:
        axes.set_title(plain(title), fontsize=10)
    axes.set_xlabel(plain(x), fontsize=9)
    axes.set_ylabel(plain(y), fontsize=9)
    axes.tick_params(labelsize=8)
    axes.grid(visible=True, color="#DDDDDD", linewidth=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def legend_below(
    figure: Any, handles: Sequence[Any], labels: Sequence[str], *, enlarge: float = 2.0
) -> None:
    """Put one legend under all panels, where it hides nothing."""
    if not handles:
        return
    figure.legend(
        handles,
        [plain(label) for label in labels],
        loc="outside lower center",
        ncols=min(len(handles), 6),
        fontsize=8,
        frameon=False,
        markerscale=enlarge,
    )


def draw_largest(
    axes: Any, times: Mapping[str, FloatArray], values: Mapping[str, FloatArray]
) -> dict[str, Any]:
    """Draw lines of which those that end highest are told apart, the others grey behind them.

    Parameters
    ----------
    axes : matplotlib axes
    times, values : mapping of str to ndarray
        Of each line, by the same names.

    Returns
    -------
    dict of str to line
        For the legend; the grey ones have one entry.
    """
    order = sorted(values, key=lambda name: -float(values[name][-1]))
    shown = order[:FEW_LINES] if len(order) > FEW_LINES + 1 else order
    lines: dict[str, Any] = {}
    for k, name in enumerate(shown):
        (lines[name],) = axes.plot(
            times[name], values[name],
            color=COLOURS[k % len(COLOURS)], linestyle=STYLES[k % len(STYLES)], linewidth=1.4,
            marker=MARKERS[k % len(MARKERS)], markersize=4.0,
            markevery=(k, max(1, times[name].size // 12)),
        )  # fmt: skip
    others = order[len(shown) :]
    for name in others:
        (line,) = axes.plot(times[name], values[name], color="#C4C4C4", linewidth=1.0, zorder=1)
        lines[f"{len(others)} smaller ones"] = line
    return lines


def file_part(serial: str) -> str:
    """Return a serial number as it may stand in a file's name."""
    return "".join(c if c.isascii() and (c.isalnum() or c in "-_.") else "_" for c in serial)[:60]
