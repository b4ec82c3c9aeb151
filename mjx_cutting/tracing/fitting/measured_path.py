"""Trials in which the tool's motion was measured too: the chip is then cut on that path, not a straight one.

An arm under impedance control follows the once-per-turn force of a runout by tens of micrometres, so that the
chip, and with it the force, hardly shows the runout. Position and spindle angle sampled beside the force tell
the motion at every order of the turn, also beyond half the sampling rate, since the angle is known. With that
path given, what is left to explain are the teeth. Assumes that the angle is that of tooth 0 (up to whole
teeth, if these are even), positions good to a small part of the chip, and a sensor zeroed before each trial
in the pose of the cut. A cut in which the motion is not alike from turn to turn is not steady: its lines are
no function of the conditions, and it is left out.

A chip of a few micrometres on a path measured to a part of one is not known as well as that of a stiff
tool: with its true constants and runout the model leaves 1.7 to 1.8 % of the force of the virtual cell
beyond the noise, so effects that account for less than 2 % are not named.

The mass that the sensor carries belongs to the base model here: it is felt wherever the tool is
accelerated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import arc
from mjx_cutting.cutting.effects.tool_gravity import ToolGravity
from mjx_cutting.tracing.fitting.problem import Problem, pose
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.lines import Lines, basis
from mjx_cutting.trials.dataset import Dataset, LeftOut, Trial, columns_to_process

_BEYOND_TOOTH_PASSING = 4
_SLOW_TERMS = 6
_LEAST_SHARE = 0.02
_OVER_NOISE = 3.0
_MOST_UNSTEADY = 0.5
_FEWEST_TRIALS = 3
_BIAS_SHARE = 0.05
_TOLERANCE = 0.02
Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Motion:
    """How the tool moved in one trial.

    Fields: `lines` [K, 3] complex, in process axes at orders 1 to K of the measured angle, m; `unsteady_m`
    what the chip under a tooth differs by from turn to turn (root mean square); `chip_m` mean chip fed;
    `moved_m` the motion in the cutting plane (root mean square); `noise_m` what of it the rest of the record
    would give if it were noise.
    """

    lines: NDArray[np.complexfloating]
    unsteady_m: float
    chip_m: float
    moved_m: float
    noise_m: float

    @property
    def steady(self) -> bool:
        """Whether the cut is alike from turn to turn."""
        return self.unsteady_m < _MOST_UNSTEADY * self.chip_m


def measured_motion(dataset: Dataset) -> tuple[Motion, ...]:
    """The motion in every cut trial; none at all where it was not measured in all of them, or moves the tool
    by less than 2 % of the feed per tooth, or than positions that are mere noise would show."""
    trials = [trial for trial in dataset.trials if trial.kind == "cut"]
    teeth = dataset.tool.teeth
    known = all(t.position_m is not None and t.spindle_angle_rad is not None for t in trials)
    long = all(len(t.time_s) > 4 * (teeth + _BEYOND_TOOTH_PASSING) for t in trials)
    if dataset.tool.kind in LEVEL_KINDS or not (known and long):
        return ()
    motion = tuple(_motion(trial, dataset) for trial in trials)
    fed_m = [trial.feed_speed_m_s / (teeth * trial.spindle_speed_rev_s) for trial in trials]
    clear = [
        each.moved_m > max(_LEAST_SHARE * fed, _OVER_NOISE * each.noise_m)
        for each, fed in zip(motion, fed_m, strict=True)
    ]
    return motion if sum(clear) > len(clear) / 2 else ()


def steady_cuts(dataset: Dataset) -> tuple[Dataset, bool]:
    """The dataset without the cuts whose measured motion says that they are not steady, and whether the rest
    can be traced on their measured path; the dataset as it is, and False, where fewer than three would stay.
    """
    motion = iter(measured_motion(dataset))
    left_out, kept = [], []
    for trial in dataset.trials:
        each = next(motion, None) if trial.kind == "cut" else None
        if each is None or each.steady:
            kept.append(trial)
            continue
        why = (
            f"the cut is not steady: from turn to turn the chip under a tooth differs by "
            f"{1e6 * each.unsteady_m:.1f} um, of {1e6 * each.chip_m:.1f} um that are fed"
        )
        left_out.append(LeftOut(trial.file, why))
    steady = replace(dataset, trials=tuple(kept), left_out=(*dataset.left_out, *left_out))
    if len(measured_motion(steady)) < _FEWEST_TRIALS:
        return dataset, False
    return steady, True


def pose_on_path(dataset: Dataset, lines: Lines) -> Problem:
    """The fitting problem of a dataset's cut trials on their measured path (call it in float64).

    Raises:
        ValueError: the motion was not measured (see `measured_motion`).
    """
    motion = measured_motion(dataset)
    if not motion:
        raise ValueError(
            "got trials without the tool's motion; expected position and spindle angle in every cut trial, "
            "and a tool that moves within the turn; trace them on the straight path"
        )
    problem = pose(dataset, lines)
    between_n2 = lines.rest_n2 / lines.samples[:, None]
    own = 1.0 / np.sqrt(between_n2 + 1.0 / np.asarray(problem.weight) ** 2)
    return replace(
        problem,
        motion=jnp.asarray([each.lines for each in motion]),
        trust=jnp.asarray(own / np.asarray(problem.weight)),
        given=(*problem.given, ToolGravity),
        bias_spread_n=_BIAS_SHARE * problem.bias_spread_n,
        tolerance=_TOLERANCE,
    )


def _motion(trial: Trial, dataset: Dataset) -> Motion:
    assert trial.position_m is not None and trial.spindle_angle_rad is not None
    orders = dataset.tool.teeth + _BEYOND_TOOTH_PASSING
    place = columns_to_process(trial.position_m, dataset.axes)
    place = place - place.mean(axis=0)
    since = trial.time_s - trial.time_s[0]
    turns = basis(np.unwrap(trial.spindle_angle_rad), orders)[:, 1:]
    columns = np.column_stack([turns, np.vander(since / since[-1], _SLOW_TERMS)])
    found = np.linalg.lstsq(columns, place, rcond=None)[0]
    entry, exit_ = (
        float(x) for x in arc(trial.milling or "slot", trial.radial_depth_m, dataset.tool.diameter_m)
    )
    middle = 0.5 * (entry + exit_)
    turn = max(2, round(dataset.sensor.sample_rate_hz / trial.spindle_speed_rev_s))
    rest = place - columns @ found
    slow = np.stack([np.convolve(axis, np.ones(turn) / turn, "same") for axis in rest.T], axis=1)
    still = (rest - slow)[turn:-turn]
    chip_of = still @ [np.sin(middle), np.cos(middle), 0.0]
    fed_m = trial.feed_speed_m_s / (dataset.tool.teeth * trial.spindle_speed_rev_s)
    chip_m = fed_m * (np.cos(entry) - np.cos(exit_)) / (exit_ - entry)
    lines = 0.5 * (found[: 2 * orders : 2] - 1j * found[1 : 2 * orders : 2])
    moved_m = float(np.sqrt(2.0 * np.sum(np.abs(lines[:, :2]) ** 2)))
    noise_m = float(np.sqrt(2.0 * orders / len(since) * np.sum(np.var(still[:, :2], axis=0))))
    # the chip is the difference between two passes
    return Motion(lines, float(np.sqrt(2.0) * np.std(chip_of)), float(chip_m), moved_m, noise_m)
