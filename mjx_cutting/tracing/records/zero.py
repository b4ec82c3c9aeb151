"""The zero of each record's sensor, read where the tool is in the air.

A force that swings with the teeth is still in the air, and its mean there is the sensor's zero. Teeth of
which many cut at once, or which pass faster than the sensor follows, hardly swing it themselves, so that
their record alone does not tell where it is still; air cuts and the other records show how still that is. Of
a sensor zeroed once a session, air cuts tell the zero of all records that do not show it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from mjx_cutting.tracing.records.course import rate_hz
from mjx_cutting.trials.dataset import Dataset, Trial

_STILL = 0.1
_HALF = 0.5
_AS_STILL = 1.5
_LIVELY = 4.0
_FAR = 2.0
_USUAL = 75.0
Array = NDArray[np.floating]


@dataclass(frozen=True)
class _Swing:
    """A record over each turn. Fields: `mean_n` [3] where it departs least from its mean; `least_n` by how
    much there; `usual_n` by how much in the cut; `away_n` how far its mean is from there then, N."""

    mean_n: Array
    least_n: float
    usual_n: float
    away_n: float

    def in_air(self, still_n: float = 0.0) -> bool:
        """Whether it hardly swings there beside what it does elsewhere; or no more than records in the air,
        which swing by `still_n`, where it does clearly more in the cut, and about quite another mean."""
        alike = self.least_n < _AS_STILL * still_n and self.usual_n > _LIVELY * still_n
        return self.least_n < _STILL * self.usual_n or (alike and self.away_n > _FAR * self.usual_n)


def zeros(dataset: Dataset) -> dict[str, Array]:
    """[3] by file what the sensor reads in the air, N; nil where neither record nor session shows it."""
    swings = {trial.file: _swing(trial) for trial in dataset.trials}
    air = {trial.file for trial in dataset.trials if trial.kind == "air"}
    seen = [each.least_n for file, each in swings.items() if file in air or each.in_air()]
    still_n = float(np.median(seen)) if seen else 0.0

    def zero(trial: Trial) -> Array | None:
        swing = swings[trial.file]
        if swing.in_air(still_n):
            return swing.mean_n
        return _without_teeth(trial, dataset.tool.teeth, swing.least_n) if trial.kind == "cut" else None

    found = {trial.file: zero(trial) for trial in dataset.trials}
    usual = _of_the_session(dataset)
    return {file: usual if each is None else each for file, each in found.items()}


def _of_the_session(dataset: Dataset) -> Array:
    """[3] what cuts in air read of a sensor zeroed once a session, N; nil of another, or without any."""
    air = [trial.force_n.mean(axis=0) for trial in dataset.trials if trial.kind == "air"]
    known = dataset.sensor.zeroed == "session" and air
    return np.mean(air, axis=0) if known else np.zeros(3)


def samples_a_turn(trial: Trial) -> int:
    """Samples in a turn of the spindle at its nominal speed, at least one."""
    return max(round(rate_hz(trial) / trial.spindle_speed_rev_s), 1)


def _without_teeth(trial: Trial, teeth: int, noise_n: float) -> Array | None:
    """[3] mean of the turn in which tooth passing is heard least, N; None unless it is hardly heard there,
    well elsewhere beside noise of `noise_n`, and the force is quite another then. As a tool enters, its teeth
    are not heard either where they cut over a whole number of pitches, but before and after they are."""
    turn = samples_a_turn(trial)
    if len(trial.time_s) <= turn:
        return None
    wave = np.exp(-2j * np.pi * teeth * trial.spindle_speed_rev_s * trial.time_s)[:, None]
    around = trial.force_n - trial.force_n.mean(axis=0)
    whole = slice(turn // 2, len(trial.time_s) - turn // 2)
    lines = uniform_filter1d(wave * around, turn, axis=0)[whole]
    heard = np.sqrt(2.0 * np.sum(np.abs(lines) ** 2, axis=1))
    mean = uniform_filter1d(trial.force_n, turn, axis=0)[whole]
    quiet = int(np.argmin(heard))
    away = np.linalg.norm(mean - mean[quiet], axis=1)
    usual, far = (float(np.percentile(each, _USUAL)) for each in (heard, away))
    lively = usual > _LIVELY * noise_n * np.sqrt(2.0 / turn)
    to_an_end = min(heard[: quiet + 1].max(), heard[quiet:].max())
    still = heard[quiet] < _STILL * usual and to_an_end < _HALF * usual
    return mean[quiet] if still and lively and far > _FAR * usual else None


def _swing(trial: Trial) -> _Swing:
    turn = samples_a_turn(trial)
    mean = uniform_filter1d(trial.force_n, turn, axis=0, mode="nearest")
    square = uniform_filter1d(trial.force_n**2, turn, axis=0, mode="nearest")
    swing = np.sqrt(np.maximum(np.sum(square - mean**2, axis=1), 0.0))
    quiet = int(np.argmin(swing))
    away = np.linalg.norm(mean - mean[quiet], axis=1)
    usual, far = (float(np.percentile(each, _USUAL)) for each in (swing, away))
    return _Swing(mean[quiet], float(swing[quiet]), usual, far)
