"""Pictures to judge a fitted disturbance by: bands over the data and beyond, spectrum, calibration, the scan.

Each function returns a matplotlib Figure; `save_all` writes the four as PNG files.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from mjx_cutting import _files
from mjx_cutting.disturbance.gp import DisturbanceGP

DATA, MEAN, BAND, LEFT = "#7a8594", "#b3341f", "#e08a5b", "#2c6e8f"


def bands(gp: DisturbanceGP, time_s: ArrayLike, residual_n: ArrayLike, periods: float = 6.0) -> Figure:
    """Returns the aligned trials with the process's mean and its 1- and 2-sigma bands, inside and beyond
    them.

    Left the first periods of the trials, right the last ones and as many past their end. The bands are those
    of a new trial's measured samples: common process, a fresh trial effect and the independent noise.

    Args:
        gp: the fitted process.
        time_s: [N], s; residual_n: [R, N, A], N, the aligned trials it was fitted to.
        periods: how many periods each side shows.
    """
    time, residual = np.asarray(time_s, np.float64), np.asarray(residual_n, np.float64)
    count, width = len(gp.axes), periods * gp.period_s
    end = float(time[-1])
    figure = _figure(10, 1.4 + 2.1 * count)
    panels = figure.subplots(count, 2, sharey="row", squeeze=False)
    windows = ((time[0], min(time[0] + width, end)), (max(end - 0.5 * width, time[0]), end + 0.5 * width))
    titles = ("training data", "end of the training data and extrapolation")
    for column, ((low, high), title) in enumerate(zip(windows, titles, strict=True)):
        at = np.linspace(low, high, 800)
        mean, latent = gp.predict(at, "new_trial")
        deviation = np.sqrt(latent**2 + gp.noise_std_n**2)
        kept = (time >= low) & (time <= high)
        for a, name in enumerate(gp.axes):
            panel = panels[a, column]
            for trial in residual[:, kept, a]:
                panel.plot(time[kept], trial, color=DATA, lw=0.5, alpha=0.6, zorder=3)
            for sigma, alpha in ((2, 0.25), (1, 0.4)):
                low_n, high_n = mean[:, a] - sigma * deviation[:, a], mean[:, a] + sigma * deviation[:, a]
                label = f"{sigma} sigma, a new trial"
                panel.fill_between(at, low_n, high_n, color=BAND, alpha=alpha, lw=0, label=label)
            panel.plot(at, mean[:, a], color=MEAN, lw=1.4, label="mean", zorder=4)
            if column == 1:
                panel.axvline(end, color="black", lw=0.8, ls="--")
            else:
                panel.set_ylabel(f"residual {name} (N)")
            panel.set_xlim(low, high)
            panel.grid(alpha=0.25)
        panels[0, column].set_title(title, fontsize=10)
        panels[-1, column].set_xlabel("time on the common clock (s)")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles[::-1], labels[::-1], loc="outside upper center", ncols=3, fontsize=8, frameon=False)
    return figure


def spectrum(gp: DisturbanceGP) -> Figure:
    """Returns the power spectral densities of the data, the fit and what is left, by axis.

    Raises:
        ValueError: a process fitted without diagnostics.
    """
    found = _diagnostics(gp)["spectrum"]
    figure = _figure(10, 1.2 + 1.9 * len(gp.axes))
    panels = figure.subplots(len(gp.axes), 1, sharex=True, squeeze=False)[:, 0]
    frequency = np.asarray(found["frequency_hz"], np.float64)
    for a, (panel, name) in enumerate(zip(panels, gp.axes, strict=True)):
        for key, color, width in (("data", DATA, 2.2), ("fit", MEAN, 1.0), ("left", LEFT, 1.0)):
            label = {"data": "data", "fit": "fit, common and own part", "left": "left"}[key]
            power = np.asarray(found[key][a], np.float64)
            if len(power):
                panel.semilogy(frequency[1:], power[1:], color=color, lw=width, label=label)
        shown = np.concatenate([np.asarray(found[k][a], np.float64)[1:] for k in ("data", "left")])
        if len(shown):
            panel.set_ylim(0.2 * shown.min(), 5 * shown.max())
        panel.set_ylabel(f"{name} (N$^2$/Hz)")
        panel.grid(alpha=0.25)
    panels[0].legend(loc="upper right", ncols=3, fontsize=8)
    panels[-1].set_xlabel(f"frequency (Hz); fitted fundamental {gp.frequency_hz:.4g} Hz")
    return figure


def calibration(gp: DisturbanceGP) -> Figure:
    """Returns the PIT histogram of held-out samples and the autocorrelation of what is left.

    Raises:
        ValueError: a process fitted without diagnostics.
    """
    report = _diagnostics(gp)
    heldout = report["heldout"]
    counts = np.asarray(heldout["pit_counts"], np.float64)
    figure = _figure(10, 3.4)
    left, right = figure.subplots(1, 2)
    edges = np.linspace(0, 1, len(counts) + 1)
    left.bar(edges[:-1], counts / counts.mean(), width=np.diff(edges), align="edge", color=DATA, ec="white")
    left.axhline(1.0, color=MEAN, lw=1.2)
    left.set_xlabel("probability integral transform")
    left.set_ylabel("held-out samples / expected")
    inside = f"{100 * heldout['coverage_1_sigma']:.1f} % / {100 * heldout['coverage_2_sigma']:.1f} %"
    left.set_title(f"within 1 / 2 sigma: {inside} (ideal 68.3 / 95.4)", fontsize=10)
    correlation = np.asarray(report["left_autocorrelation"], np.float64)
    lags = np.arange(1, correlation.shape[1] + 1)
    for a, name in enumerate(gp.axes):
        right.plot(lags, correlation[a], marker="o", ms=3, lw=0.9, label=name)
    bound = 2.0 / np.sqrt(max(gp.samples, 1))
    right.axhspan(-bound, bound, color=BAND, alpha=0.3, lw=0, label="independent noise")
    right.set_xlabel("lag (samples)")
    right.xaxis.set_major_locator(MaxNLocator(integer=True))
    right.set_ylabel("autocorrelation of what is left")
    right.set_ylim(min(-0.1, 1.1 * correlation.min()), max(0.2, 1.1 * correlation.max()))
    right.legend(fontsize=8, ncols=2)
    for panel in (left, right):
        panel.grid(alpha=0.25)
    return figure


def scan(gp: DisturbanceGP) -> Figure:
    """Returns the log likelihood of the pooled trials over the frequencies looked at."""
    figure = _figure(10, 3.2)
    panel = figure.subplots()
    best = np.nanmax(gp.scan_log_likelihood)
    panel.plot(gp.scan_hz, gp.scan_log_likelihood - best, color=LEFT, lw=0.8)
    panel.axvline(gp.frequency_hz, color=MEAN, lw=1.0, ls="--", zorder=0)
    panel.set_title(
        f"pooled trials, best of three lengths; found (dashed): {gp.frequency_hz:.5g} Hz", fontsize=10
    )
    panel.set_xlabel("frequency (Hz)")
    panel.set_ylabel("log likelihood below its peak (nats)")
    panel.grid(alpha=0.25)
    return figure


def save_all(gp: DisturbanceGP, time_s: ArrayLike, residual_n: ArrayLike, folder: str | Path) -> list[Path]:
    """Returns the PNG files written into `folder`: bands, scan; with diagnostics spectrum, calibration."""
    drawn = {"bands": bands(gp, time_s, residual_n), "scan": scan(gp)}
    if gp.diagnostics:
        drawn |= {"spectrum": spectrum(gp), "calibration": calibration(gp)}
    return [save(figure, Path(folder) / f"{name}.png") for name, figure in drawn.items()]


def save(figure: Figure, path: str | Path) -> Path:
    """Returns `path` (.png), now holding the figure, whole or not at all."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    return _files.write_atomic(path, buffer.getvalue())


def _figure(width: float, height: float) -> Figure:
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _diagnostics(gp: DisturbanceGP) -> dict:
    if not gp.diagnostics:
        raise ValueError("this process was fitted without diagnostics; fit it again with diagnose=True")
    return gp.diagnostics
