"""A residual measured on one machine, made ready for the simulation of another.

What a traced model leaves of the force repeats with the spindle, not with the clock. So it is taken against
the spindle angle, from the same tooth in every trial, and replayed at the spindle speed of the simulated saw;
its size keeps its proportion to the force. Assumes that what is left scales with the load and does not depend
on speed.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.sim.config import EnvConfig
from mjx_cutting.tracing import Prediction


def replayed(
    predictions: Sequence[Prediction], speed_rev_s: float, rate_hz: float, load_n: float
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """The residuals of several trials on one time axis.

    Arguments:
        predictions: trials beside their prediction.
        speed_rev_s: spindle speed at which they are replayed, rev/s.
        rate_hz: samples a second of the result.
        load_n: root-mean-square force of the simulated cut, N; each residual is scaled by it over the trial's
        own.

    Returns:
        time [T], s, and residual [R, T, 3], N, of the turns that every trial has.

    Raises:
        ValueError: a trial holds fewer than two whole turns.
    """
    first = [np.ceil(each.angle_rad[0] / (2.0 * np.pi)) for each in predictions]
    last = [np.floor(each.angle_rad[-1] / (2.0 * np.pi)) for each in predictions]
    turns = min(end - start for start, end in zip(first, last, strict=True))
    if turns < 2:
        raise ValueError(f"a trial holds {turns:g} whole turns of the spindle; at least 2 are needed")
    time = np.arange(int(turns / speed_rev_s * rate_hz)) / rate_hz
    residuals = []
    for each, start in zip(predictions, first, strict=True):
        angle = 2.0 * np.pi * (start + speed_rev_s * time)
        own = np.sqrt(np.mean(np.sum(each.measured_n**2, axis=1)))
        left = each.residual_n * (load_n / max(float(own), 1e-12))
        residuals.append(np.stack([np.interp(angle, each.angle_rad, left[:, axis]) for axis in range(3)], 1))
    return time, np.stack(residuals)


def fit_rest(predictions: Sequence[Prediction], env: EnvConfig, path: Path) -> Path:
    """Fit the disturbance model to what a prediction leaves, at the size it was measured; the file's path.

    Arguments:
        predictions: trials beside their prediction.
        env: the simulation in which it is to be replayed.
        path: npz file to write.

    Raises:
        ValueError: a trial holds fewer than two whole turns.
    """
    from mjx_cutting.disturbance import fit

    turn = env.spindle_speed_rev_s
    sizes = [np.sqrt(np.mean(np.sum(each.measured_n**2, axis=1))) for each in predictions]
    time_s, residual_n = replayed(predictions, turn, env.physics_rate_hz, float(np.mean(sizes)))
    gp = fit(
        time_s,
        residual_n,
        frequency_range_hz=(0.9 * turn, 1.1 * turn),
        trial_effects=False,  # a trial's own mean is not known: its bias was fitted away
        diagnose=False,
    )
    return Path(gp.save(path))
