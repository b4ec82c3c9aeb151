"""Figures of the tracing report, one file each; a function returns None where there is nothing to show."""

from mjx_cutting.tracing.report.figures.intervals import intervals_figure
from mjx_cutting.tracing.report.figures.isolability import isolability_figure
from mjx_cutting.tracing.report.figures.revolution import revolution_figure
from mjx_cutting.tracing.report.figures.spectrum import spectrum_figure
from mjx_cutting.tracing.report.figures.telling import telling_figure
from mjx_cutting.tracing.report.figures.trials import trials_figure

__all__ = [
    "intervals_figure",
    "isolability_figure",
    "revolution_figure",
    "spectrum_figure",
    "telling_figure",
    "trials_figure",
]
