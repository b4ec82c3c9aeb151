"""One look for all figures, drawn without pyplot and without touching matplotlib's global state.

Colours are those of Okabe and Ito (Color Universal Design, 2008), told apart by colour-blind eyes and in
grey: the model before is vermillion and dashed, the model after is blue and solid, what was measured is dark.
matplotlib is loaded on first use only.
"""

from __future__ import annotations

import base64
import io
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BEFORE = "#d55e00"
AFTER = "#0072b2"
MEASURED = "#1f2933"
SPREAD = "#c3cad3"
FLOOR = "#6b7680"
GOOD = "#009e73"
OTHER = "#cc79a7"
GRID = "#e3e7eb"
DPI = 130
WIDTH_IN = 9.2
_SMALL = 8.0
_TEXT = 9.0
_TITLE = 9.5


def new_figure(height_in: float, width_in: float = WIDTH_IN) -> Figure:
    """Returns an empty figure on an Agg canvas that no pyplot knows of.

    Args:
        height_in, width_in: size, inches; the usual width fills a page of ours.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), dpi=DPI, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def style_axes(axes: Axes, *, title: str = "", x: str = "", y: str = "", grid: str = "both") -> None:
    """Gives axes the common look, with plain (never mathematical) texts.

    Args:
        axes: what to dress.
        title, x, y: texts; x and y name the quantity and its unit.
        grid: "both", "x", "y" or "" for none.
    """
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color("#9aa5b1")
    axes.tick_params(labelsize=_SMALL, colors="#3e4c59", length=3, width=0.8)
    axes.set_axisbelow(True)
    if grid:
        axes.grid(True, axis=grid, color=GRID, linewidth=0.8)  # type: ignore[arg-type]
    if title:
        axes.set_title(plain(title), fontsize=_TITLE, loc="left", color=MEASURED)
    if x:
        axes.set_xlabel(plain(x), fontsize=_TEXT, color="#3e4c59")
    if y:
        axes.set_ylabel(plain(y), fontsize=_TEXT, color="#3e4c59")


def legend_above(figure: Figure, handles: list[Any], labels: list[str]) -> None:
    """Puts one legend over the whole figure, where it covers no data."""
    figure.legend(
        handles,
        [plain(label) for label in labels],
        loc="outside upper center",
        ncols=len(labels),
        frameon=False,
        fontsize=_TEXT,
        handlelength=2.4,
    )


def plain(text: str, longest: int = 90) -> str:
    """Returns text that a figure can show, whatever it holds: no mathematics, known glyphs, not too long."""
    known = "".join(c if c.isprintable() and ord(c) < 0x2300 else "?" for c in text.replace("\u00a0", " "))
    if len(known) > longest:
        keep = (longest - 1) // 2
        known = f"{known[:keep]}…{known[-keep:]}"
    return known.replace("$", r"\$")


def figure_to_png(figure: Figure, dpi: int = DPI) -> bytes:
    """Returns the figure as PNG bytes; the same figure gives the same bytes."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi, facecolor="white", metadata={"Software": None})
    return buffer.getvalue()


def png_to_data_uri(png: bytes) -> str:
    """Returns PNG bytes as a `data:` address that a page can hold in itself."""
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")
