"""Cuts in which the tool never cut: a plate that was not there, a wrong zero of the height.

Such a record holds a bias and noise. It is told from a light cut by both: its mean is a small share of what
the other trials' means have for the area that their tools sweep, and no line stands in its spectrum.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mjx_cutting.trials.dataset import Array, Trial
from mjx_cutting.trials.in_air import less_the_air

_SHARE = 0.12
_FEWEST = 3
_OF_NOISE = 4.0


def idle_cuts(trials: Sequence[Trial], zeroed_once: bool = False) -> dict[str, str]:
    """Why a trial of kind "cut" is none, by file.

    Of a sensor that was `zeroed_once` for all trials, what cuts in air, if any, read is its zero.
    """
    if zeroed_once:
        trials = less_the_air(trials)
    cuts = [trial for trial in trials if trial.kind == "cut"]
    if len(cuts) < _FEWEST:
        return {}
    area = np.array([trial.radial_depth_m * trial.axial_width_m for trial in cuts])
    mean = np.array([np.linalg.norm(_channels(trial).mean(axis=0)) for trial in cuts])
    usual = float(np.median(mean / area))
    found = {}
    for trial, level, swept in zip(cuts, mean, area, strict=True):
        if level < _SHARE * usual * min(swept, float(np.median(area))) and not _has_line(trial):
            found[trial.file] = (
                f"got a mean of {level:.3g} N and no line in its spectrum, expected some "
                f"{usual * swept:.3g} N as in the other cuts: the tool does not cut; leave the trial out or "
                'call it "air".'
            )
    return found


def _channels(trial: Trial) -> Array:
    """[T, 3 or 2] what was measured of the force; a drill's thrust alone."""
    return trial.force_n if trial.torque_nm is None else trial.force_n[:, 2:]


def _has_line(trial: Trial) -> bool:
    """Whether a line stands out of the record's spectrum by more than any of noise does."""
    force = _channels(trial) - _channels(trial).mean(axis=0)
    power = np.abs(np.fft.rfft(force * np.hanning(len(force))[:, None], axis=0)[1:]) ** 2
    share = power.max(axis=0) / np.maximum(power.sum(axis=0), 1e-300)
    return bool(share.max() > _OF_NOISE * np.log(len(force)) / len(power))
