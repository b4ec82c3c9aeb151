"""Friction of the drive, seen in the air beside the cut: hysteresis where whole records have it.

Records that begin or end in the air are traced where the tool is in the cut, and there a drive that goes one
way has a constant drag, which is a bias. In the air nothing is cut, so that what its drag does as the tool
sets out, or turns back, stands there by itself, beside the sensor's zero. That is one for all trials, or each
trial's own; as the cut has it it is not known well enough.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect
from mjx_cutting.tracing.along.ends import NAME as ENDS
from mjx_cutting.tracing.along.engaged import in_the_air
from mjx_cutting.tracing.along.presliding import HYSTERESIS, Columns, rather_otherwise
from mjx_cutting.tracing.along.slow import search_slow
from mjx_cutting.tracing.along.slow_round import SlowRound
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.passes import Pass, near_floor
from mjx_cutting.tracing.records.course import Course, felt_at
from mjx_cutting.tracing.records.line_gain import filter_delay_s
from mjx_cutting.tracing.records.lines import band_limit
from mjx_cutting.trials.dataset import Dataset, Trial

_FEWEST = 3
Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class _Beside(Course):
    """A whole record of which the air is judged. Fields: `air` [T] where that is; `own_zero` whether its zero
    is its own."""

    air: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, bool))
    own_zero: bool = False


def loop_in_air(
    whole: Dataset, found: Pass, retrace: Callable[[Dataset], Pass], progress: Callable[[str], None]
) -> Pass:
    """The pass with hysteresis named where the air of whole records shows it, and all else as `retrace` finds
    it on records without that drag; `found` where the air does not show it.

    Arguments: `whole` the records; `found` in the cut, with entry and exit named, so that its errors are of
        whole records.
    """
    named = {kind.name for kind in found.kinds}
    if ENDS not in named or HYSTERESIS.name in named or near_floor(found):
        return found
    files = {trial.file for trial in whole.trials}
    if not all(trial.file in files for trial in found.dataset.trials if trial.kind == "cut"):
        return found
    courses, before = _beside_the_cut(whole, found)
    if sum(bool(each.air.any()) for each in courses) < _FEWEST:
        return found
    progress("in the air: hysteresis")
    weight, tolerance = np.asarray(found.search.problem.weight), found.search.problem.tolerance
    kind = replace(
        HYSTERESIS,
        columns=_in_air(HYSTERESIS.columns),
        rather=lambda courses, effect: rather_otherwise(courses, effect, _in_air),
        testable=lambda courses: True,
    )
    rounds = search_slow(courses, before, weight, kinds=(kind,), tolerance=tolerance)
    if not rounds or rounds[0].accepted is None:
        return found
    progress("once more, without the drag of the drive")
    accepted = rounds[0].accepted
    rest = retrace(_without_drag(whole, accepted.effect))
    if ENDS not in {kind.name for kind in rest.kinds} or len(rest.after) != len(courses):
        return found
    # the rest was traced without a drag that every trial had its part in: each pays for its own
    shown = [
        np.sum((c.left_n - added) ** 2, axis=0) for c, added in zip(courses, accepted.added_n, strict=True)
    ]
    error = rest.final.error_n2 + np.maximum(accepted.heldout.error_n2 - np.stack(shown), 0.0)
    after = HeldOut(error, found.final.energy_n2, None, rest.final.fold)
    silent = tuple(np.zeros_like(each.measured_n) for each in rest.after)
    told = replace(accepted, heldout=after, added_n=silent, whole_n=silent)
    said = "it shows in the air beside the cut, as the drive sets out or turns back; in the cut it is a bias"
    rest = replace(rest, search=replace(rest.search, base=found.search.base))
    return rest.with_round(SlowRound(found.final, (told,), told), (said,))


def _without_drag(dataset: Dataset, drag: AbstractEffect) -> Dataset:
    """The cuts less the drag of the drive along their way."""
    assert HYSTERESIS.parts is not None
    (shape, c), delay_s = HYSTERESIS.parts(drag), filter_delay_s(dataset.sensor)
    trials = []
    for trial in dataset.trials:
        if trial.kind == "cut":
            columns = HYSTERESIS.columns(_course(trial, dataset, delay_s), shape)
            trial = replace(trial, force_n=trial.force_n - columns @ c)
        trials.append(trial)
    return replace(dataset, trials=tuple(trials))


def _in_air(whole: Columns) -> Columns:
    """[T, 3, 3] columns of a drag in the air, of which the `whole` record has two, and of a zero along the
    feed that all trials have."""

    def columns(course: Course, shape: Array) -> Array:
        assert isinstance(course, _Beside)
        drag = whole(course, shape)
        zero = np.zeros((len(drag), 3, 1))
        if course.own_zero:
            drag = drag - drag[course.air].mean(axis=0) if course.air.any() else drag
        else:
            zero[:, 0] = 1.0
        return np.concatenate([drag, zero], axis=-1) * course.air[:, None, None]

    return columns


def _beside_the_cut(whole: Dataset, found: Pass) -> tuple[list[_Beside], HeldOut]:
    """Every whole record, of which only what is left in the air beside the zero there is judged; the error
    that is."""
    rate, band, delay_s = whole.sensor.sample_rate_hz, found.lines.band_hz, filter_delay_s(whole.sensor)
    trials = {trial.file: trial for trial in whole.trials if trial.kind == "cut"}
    cuts = [trials[cut.file] for cut in found.dataset.trials if cut.kind == "cut"]
    beside = in_the_air(whole)
    force = [band_limit(trial.force_n, rate, band) for trial in cuts]
    air = [each[beside[trial.file]] for each, trial in zip(force, cuts, strict=True)]
    own_zero = whole.sensor.zeroed != "session"
    common = np.concatenate(air).mean(axis=0) if sum(map(len, air)) else np.zeros(3)
    zeros = [each.mean(axis=0) if own_zero and len(each) else common for each in air]
    courses = [
        replace(
            _course(trial, whole, delay_s),
            edge_n=measured,
            left_n=(measured - zero) * beside[trial.file][:, None],
            band_hz=band,
            index=index,
            air=beside[trial.file],
            own_zero=own_zero,
        )
        for index, (trial, measured, zero) in enumerate(zip(cuts, force, zeros, strict=True))
    ]
    error = np.stack([np.sum(each.left_n**2, axis=0) for each in courses])
    return courses, HeldOut(error, found.final.energy_n2, None, found.final.fold)


def _course(trial: Trial, dataset: Dataset, delay_s: float) -> _Beside:
    """A whole record as the drive's way has it."""
    return _Beside(
        time_s=trial.time_s - trial.time_s[0],
        position_m=felt_at(trial, delay_s),
        feed_share=None,
        chip_n=np.zeros_like(trial.force_n),
        edge_n=trial.force_n,
        left_n=trial.force_n,
        rate_hz=dataset.sensor.sample_rate_hz,
        band_hz=(0.0, 0.5 * dataset.sensor.sample_rate_hz),
        apart=True,
        delay_s=delay_s,
    )
