"""Heat map of what the trials can tell apart: cosine between the marks of two effects, survival beside it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mjx_cutting._report.style import new_figure
from mjx_cutting.tracing.telling.isolability import isolability
from mjx_cutting.tracing.told import Tracing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FEWEST = 3


def isolability_figure(tracing: Tracing) -> Figure | None:
    """Returns the figure: an effect a row; None where fewer than three effects were screened."""
    found = isolability(tracing.search)
    if found is None or len(found.names) < _FEWEST:
        return None
    count = len(found.names)
    labels = [
        f"{name.replace('_', ' ')}  {share:.2f}"
        for name, share in zip(found.names, found.survival, strict=True)
    ]
    figure = new_figure(1.6 + 0.27 * count)
    axes = figure.subplots()
    image = axes.imshow(
        np.where(np.eye(count) > 0, np.nan, found.cosine), cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto"
    )
    for row, column in zip(*np.nonzero(found.cosine >= 0.6), strict=True):
        if row != column:
            cosine = found.cosine[row, column]
            shade = "white" if cosine > 0.7 else "black"
            axes.text(column, row, f"{cosine:.2f}", ha="center", va="center", fontsize=6.0, color=shade)
    axes.set_xticks(range(count), [name.replace("_", " ") for name in found.names], rotation=90, fontsize=7.0)
    axes.set_yticks(range(count), labels, fontsize=7.0)
    axes.tick_params(length=0)
    for side in axes.spines.values():
        side.set_visible(False)
    figure.colorbar(image, ax=axes, aspect=max(6, count), label="absolute cosine")
    return figure
