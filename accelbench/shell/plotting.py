"""Style of all figures: colours, thinning, units, and their conversion to bytes.

Figures are made with matplotlib's objects only: no window, no state that one leaves to the next.
"""

import io
import warnings
from collections.abc import Sequence
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
CORRELATED = 0.3  # a parameter without such a correlation is not in the picture of them
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


def draw_correlation_matrix(
    names: Sequence[str], matrix: FloatArray, name: str, title: str
) -> Picture:
    """Draw the correlations of the parameters that correlate with another one at all.

    Parameters
    ----------
    names : sequence of str
    matrix : ndarray, shape (p, p)
    name : str
        Of the file.
    title : str
        What the parameters are of; empty for none.
    """
    apart = np.abs(matrix - np.diag(np.diag(matrix)))
    shown = np.flatnonzero(apart.max(axis=1, initial=0.0) >= CORRELATED)
    if not shown.size:
        shown = np.arange(len(names))
    left = len(names) - shown.size
    size = 3.4 + 0.19 * shown.size
    figure = new_figure(size + 1.0, size)
    axes = figure.subplots()
    image = axes.imshow(matrix[np.ix_(shown, shown)], vmin=-1.0, vmax=1.0, cmap="RdBu_r")
    told = [names[int(k)] for k in shown]
    axes.set_xticks(range(shown.size), told, rotation=90.0, fontsize=7)
    axes.set_yticks(range(shown.size), told, fontsize=7)
    if title:
        axes.set_title(title, fontsize=10)
    bar = figure.colorbar(image, ax=axes, shrink=0.7)
    bar.set_label("correlation", fontsize=9)
    bar.ax.tick_params(labelsize=8)
    caption = f"Correlations beyond ±{CORRELATED:g} of what is estimated"
    caption += f"; {left} further parameters have none." if left else "."
    return picture(figure, name, caption)


def file_part(serial: str) -> str:
    """Return a serial number as it may stand in a file's name."""
    return "".join(c if c.isascii() and (c.isalnum() or c in "-_.") else "_" for c in serial)[:60]
