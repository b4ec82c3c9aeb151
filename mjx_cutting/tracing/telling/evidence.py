"""Sentences a machinist can check: how the measured lines behave where an effect says they should."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect
from mjx_cutting.cutting.effects.radial_runout import RadialRunout
from mjx_cutting.tracing.fitting.prediction import Prediction, energy
from mjx_cutting.tracing.records.lines import basis
from mjx_cutting.trials.dataset import Dataset, Trial

_ROUNDING_M = 1e-6
_IN_WHOLE = 0.095


def line_amplitudes(predictions: Sequence[Prediction], order: int) -> NDArray[np.float64]:
    """[R] amplitude of the measured force at one spindle order, N, over the two radial axes."""
    amplitudes = []
    for each in predictions:
        columns = basis(each.angle_rad * order, 1)
        weights, *_ = np.linalg.lstsq(columns, each.measured_n[:, :2], rcond=None)
        amplitudes.append(np.sqrt(np.sum(weights[1:] ** 2)))
    return np.asarray(amplitudes)


def evidence(
    kind: type[AbstractEffect], dataset: Dataset, before: Sequence[Prediction], after: Sequence[Prediction]
) -> list[str]:
    """What in the measurements speaks for an effect: signature, lines over feed, what it took away."""
    teeth = dataset.tool.teeth
    sentences = [f"signature: {kind.signature}"]
    once, passing = line_amplitudes(before, 1), line_amplitudes(before, teeth)
    feeds = [_trial(dataset, each).feed_speed_m_s for each in before]
    if teeth > 1 and len(set(feeds)) > 1:
        order = np.argsort(feeds)
        first, last = order[0], order[-1]
        sentences.append(
            f"once-per-revolution line {once[first]:.3g} N at the lowest feed, {once[last]:.3g} N at the "
            f"highest "
            f"({once.min():.3g}-{once.max():.3g} N over all trials) while tooth passing goes from "
            f"{passing[first]:.3g} to {passing[last]:.3g} N"
        )
    if teeth > 1 and _from_a_tooth(kind):
        sentences.append(
            f"its angle is counted from a tooth that nothing marks: known up to whole teeth, "
            f"{360 / teeth:.3g} degrees"
        )
    if teeth == 2 and kind is RadialRunout:
        sentences.append(
            "two teeth show only the offset times the cosine of its angle to them, which is the offset told"
        )
    if "onset_m" in kind.held:
        sentences.append(_sets_in(dataset, kind.held["onset_m"][1]))
    old, new = (energy([each.residual_n for each in told]) for told in (before, after))
    if new < old:
        share = f"{new / old:.0%}" if new >= _IN_WHOLE * old else f"{new / old:.1%}"
        sentences.append(f"the final model leaves {share} of the base model's residual energy")
    return sentences


def _sets_in(dataset: Dataset, onset_m: float) -> str:
    """Between which trials an effect sets in that is there from the length cut `onset_m` on."""
    cuts = sorted(
        (trial for trial in dataset.trials if trial.kind == "cut"), key=lambda each: each.cut_length_before_m
    )
    late = [trial for trial in cuts if trial.cut_length_before_m >= onset_m - _ROUNDING_M]
    before = len(cuts) - len(late)
    if not late or not before:
        return f"it sets in after {onset_m:.4g} m cut"
    return (
        f"it sets in between {cuts[before - 1].file} and {late[0].file}, after {onset_m:.4g} m cut: nothing "
        f"of it in {before} cuts before, the same in {len(late)} from then on"
    )


def _from_a_tooth(kind: type[AbstractEffect]) -> bool:
    """Whether one of the effect's parameters is an angle on the tool."""
    on_the_tool = kind.stage in ("spindle", "chip", "tool")
    return on_the_tool and any(
        each.unit == "rad" and each.identity is None for each in kind.parameters.values()
    )


def _trial(dataset: Dataset, prediction: Prediction) -> Trial:
    return next(trial for trial in dataset.trials if trial.file == prediction.file)
