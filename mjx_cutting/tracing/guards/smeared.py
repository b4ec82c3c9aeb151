"""Are lines weaker because something takes from them, or because the spindle turns unevenly?

A spindle whose angle wanders by sigma turns line n by n sigma to and fro: of its energy the share (n sigma)^2
goes from the line to its sides, and the higher orders lose most, as under a helix or a low-pass filter. But
these destroy what a wander only moves. So where as much lies between the lines as the effect takes from them,
beside the noise that is alike at all frequencies, it has lost nothing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.fitting.descent import Descent
from mjx_cutting.tracing.guards.gain import Gain
from mjx_cutting.tracing.records.lines import Lines
from mjx_cutting.tracing.records.noise import white_power

_SHARE = 0.5


def rather_smeared(gain: Gain) -> str | None:
    """Why an effect that damps is refused, whose losses are found beside the lines; None where they are
    not."""
    if not gain.kind.damps:
        return None
    problem = gain.problem
    without, with_it = (
        float(np.sum(Descent(problem, each).mark(at[None]) ** 2))
        for each, at in ((gain.others, gain.rest), (gain.effects, np.asarray(gain.found.x)))
    )
    beside = float(np.sum(_beside_n2(gain.lines) * np.asarray(problem.weights) ** 2))
    lost = without - with_it
    if lost <= 0.0 or beside < _SHARE * lost:
        return None
    return (
        f"{beside / lost:.1f} times the energy that it takes from the lines lies between them: nothing is "
        "lost, as under a spindle that turns unevenly"
    )


def _beside_n2(lines: Lines) -> NDArray[np.float64]:
    """[R, 3] energy between the lines of every trial, N^2, without white noise."""
    rate_hz = lines.dataset.sensor.sample_rate_hz
    cuts = (trial for trial in lines.dataset.trials if trial.kind == "cut")
    white = np.array([white_power(trial.force_n, rate_hz, lines.band_hz) for trial in cuts])
    return np.maximum(lines.rest_n2 - white * np.asarray(lines.samples)[:, None], 0.0)
