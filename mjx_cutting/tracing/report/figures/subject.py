"""What the figures are drawn from: the cut trials, each with its conditions, two predictions and a label."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.fitting.prediction import Prediction
from mjx_cutting.tracing.told import Tracing
from mjx_cutting.trials.dataset import Trial

Array = NDArray[np.floating]
BASE_LABEL = "before: base model"
AXES = ("x (feed)", "y (normal to feed)", "z (tool axis)")


@dataclass(frozen=True, eq=False)
class Subject:
    """One cut trial: its number in the report, its conditions and what the two models predict."""

    number: int
    trial: Trial
    before: Prediction
    after: Prediction
    feed_per_tooth_m: float

    @property
    def label(self) -> str:
        """Short name for a figure: number and feed per tooth."""
        return f"trial {self.number}, {1e3 * self.feed_per_tooth_m:.3g} mm/tooth"


def subjects(tracing: Tracing) -> tuple[Subject, ...]:
    """Returns the cut trials in the order of the dataset."""
    trials = {trial.file: trial for trial in tracing.dataset.trials}
    found = []
    for index, (before, after) in enumerate(zip(tracing.before, tracing.after, strict=True)):
        trial = trials[before.file]
        found.append(Subject(index + 1, trial, before, after, feed_per_tooth_m(trial, tracing)))
    return tuple(found)


def feed_per_tooth_m(trial: Trial, tracing: Tracing) -> float:
    """Returns v / (N f), m."""
    return trial.feed_speed_m_s / (tracing.dataset.tool.teeth * trial.spindle_speed_rev_s)


def named(tracing: Tracing) -> bool:
    """True where an effect was named, so that a model after differs from the one before."""
    return bool(tracing.verdict["effects"])


def force_unit(tracing: Tracing) -> str:
    """Returns the unit of forces for axis labels."""
    return "N" if tracing.dataset.sensor.units == "SI" else "arb. units"


def after_label(tracing: Tracing) -> str:
    """Returns what the final model is called in legends."""
    words = [entry["name"].replace("_", " ") for entry in tracing.verdict["effects"]]
    return "after: with " + " and ".join(words)


def line_amplitude(angle_rad: Array, force_n: Array, order: float) -> float:
    """Returns the amplitude of a force [T, A] at one spindle order, root of the squares over its axes, N."""
    phase = angle_rad * order
    columns = np.stack([np.ones_like(phase), np.cos(phase), np.sin(phase)], axis=-1)
    weights, *_ = np.linalg.lstsq(columns, force_n, rcond=None)
    return float(np.sqrt(np.sum(weights[1:] ** 2)))


def spread_over(count: int, most: int) -> list[int]:
    """Returns at most `most` positions of 0..count-1, first and last among them, evenly spaced."""
    return sorted({round(each) for each in np.linspace(0, count - 1, min(count, most))})
