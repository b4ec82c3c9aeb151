"""Whole records of a spindle that gives way, followed on the ramps at the ends of the sheet.

Lines stand where the loaded spindle turned in the full cut, and ends of the sheet are held against whole
records as if it had turned so all along. Where both were named, the records are judged again with the tool
ahead by what `along.slip` says, on the ramps and where the tool is just fully in. The phase there tells the
droop far better than the speeds of whole cuts do, so its value and interval are then those of the ramps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import ForceModel, effect_class
from mjx_cutting.tracing.along.droop import NAME as DROOP
from mjx_cutting.tracing.along.ends import NAME as ENDS
from mjx_cutting.tracing.along.ends import effect_at, places_of
from mjx_cutting.tracing.along.slip import Slip, closest_slip, loads
from mjx_cutting.tracing.along.slip import Slipping as Record
from mjx_cutting.tracing.along.slow_round import SlowCandidate, SlowRound
from mjx_cutting.tracing.fitting.heldout import HeldOut, on_other_lines
from mjx_cutting.tracing.fitting.prediction import Prediction, predictions
from mjx_cutting.tracing.fitting.problem import pose, shared_bias
from mjx_cutting.tracing.naming.chance import gain_over_trials
from mjx_cutting.tracing.naming.intervals import interval
from mjx_cutting.tracing.passes import Pass
from mjx_cutting.tracing.records.lines import compress
from mjx_cutting.tracing.records.spindle import spindle_angle
from mjx_cutting.tracing.telling.verdict import final
from mjx_cutting.tracing.whole_records import Told, held_against, met, outside_the_cut
from mjx_cutting.trials.dataset import Dataset

_ALIKE = 0.01
_CLEARLY = 2.0
_DROOP_AND_ENDS = 2
Array = NDArray[np.floating]


def with_droop_on_ramps(whole: Dataset, found: Pass) -> Pass:
    """The pass with the ends of the sheet held against whole records anew, the spindle slowing there as its
    droop has it, and that droop as the ramps tell it; `found` where they do not clearly say so.

    Arguments: `whole` the records; `found` in the cut, with droop first of what was found along the trials
        and the ends of the sheet last.
    """
    accepted = [each.accepted for each in found.slow]
    droop, ends = (accepted[0], accepted[-1]) if len(accepted) > 1 else (None, None)
    if droop is None or ends is None or (droop.kind.name, ends.kind.name) != (DROOP, ENDS):
        return found
    inside, weight = final(found.search, found.slow[1:-1]), np.asarray(found.search.problem.weight)
    outside, places = outside_the_cut(whole, found), np.array(places_of(ends.effect))
    even = held_against([each.missing(places) for each in outside], outside, inside, weight)
    if abs(even.after.nrmse - ends.heldout.nrmse) > _ALIKE * ends.heldout.nrmse:
        # where they begin and end is each record's own
        return found
    edge, chip = loads(found.search.problem, found.model)
    records = [
        Record.of(each.course, each.ramps, each.where, edge[index], chip[index])
        for index, each in enumerate(outside)
    ]
    first = Slip(places, float(droop.effect.values()["droop_rev_s_nm"]), 0.0)
    best, by_fold = closest_slip(records, first, weight, inside.fold)
    slips = [by_fold[f] for f in inside.fold]
    ahead = [record.ahead(own) for record, own in zip(records, slips, strict=True)]
    turned = [each.turned(further) for each, further in zip(outside, ahead, strict=True)]
    missing = [each.missing(own.places) for each, own in zip(turned, slips, strict=True)]
    inside, after = _followed(
        found, inside, [further[~each.where] for further, each in zip(ahead, outside, strict=True)]
    )
    told = held_against(missing, turned, inside, weight)
    gain, error = gain_over_trials(even.after, told.after)
    if not gain > _CLEARLY * error:
        return found
    return _Judged(best, by_fold, told, after).in_place_of(found, droop, ends)


def _followed(
    found: Pass, inside: HeldOut, further_rad: Sequence[Array]
) -> tuple[HeldOut, tuple[Prediction, ...]]:
    """Error on held-out trials in the cut, and predictions there, where every tool is by [T] rad further than
    evenly turned: a spindle that lags is still slowing as its tool is fully in."""
    if len(found.slow) > _DROOP_AND_ENDS:
        # what stands beside the lines was found on an even turn
        return inside, found.after
    rest, speeds, trials = iter(further_rad), iter(found.lines.speed_rev_s), []
    for trial in found.dataset.trials:
        if trial.kind == "cut":
            angle = spindle_angle(trial, float(next(speeds))) + next(rest)
            trial = replace(trial, spindle_angle_rad=angle)
        trials.append(trial)
    dataset = replace(found.dataset, trials=tuple(trials))
    lines = compress(dataset, found.lines.band_hz, found.lines.speed_rev_s, like=found.lines)
    problem = pose(dataset, lines)
    bias = shared_bias(found.search.problem, found.search.final_fit.x)
    after = predictions(dataset, lines, problem, found.search.final_fit.model, bias)
    return on_other_lines(problem, lines, found.search.effects, inside), after


@dataclass(frozen=True, eq=False)
class _Judged:
    """Whole records judged again. Fields: `best` over all trials, and `by_fold`; what they have `told`;
    predictions `after`, in the cut."""

    best: Slip
    by_fold: Sequence[Slip]
    told: Told
    after: tuple[Prediction, ...]

    def in_place_of(self, found: Pass, droop: SlowCandidate, ends: SlowCandidate) -> Pass:
        """The pass with `droop` and `ends` as found on the ramps."""
        slowed, sheet = self._droop(droop), self._ends(ends)
        was, now = (met(float(x[0]), float(x[2])) for x in (places_of(ends.effect), self.best.places))
        placed = tuple(each.replace(was, now) for each in found.evidence.get(ENDS, ()))
        said = (
            "on the ramps at the ends of the sheet the spindle gives way with a lag of "
            f"{self.best.lag_s:.2g} s; the phase of the teeth there tells how far"
        )
        others = tuple(each for each in found.model.effects if each.name not in (DROOP, ENDS))
        rounds = (
            replace(found.slow[0], candidates=(slowed,), accepted=slowed),
            *found.slow[1:-1],
            SlowRound(self.told.before, (sheet,), sheet),
        )
        return replace(
            found,
            after=self.after,
            model=ForceModel(found.model.tool, found.model.material, (*others, slowed.effect, sheet.effect)),
            slow=rounds,
            evidence=found.evidence | {DROOP: (*found.evidence.get(DROOP, ()), said), ENDS: placed},
        )

    def _droop(self, known: SlowCandidate) -> SlowCandidate:
        name = "droop_rev_s_nm"
        found = interval(
            known.kind,
            name,
            self.best.droop,
            np.array([each.droop for each in self.by_fold]),
            # the torque is known no better than the force is
            model_error=self.best.droop * self.told.after.nrmse,
        )
        decision = replace(known.decision, parameters={name: found})
        return replace(known, effect=effect_class(DROOP)(self.best.droop), decision=decision)

    def _ends(self, known: SlowCandidate) -> SlowCandidate:
        share, name = np.array([self.told.share]), "share"
        parameters = known.decision.parameters | {
            name: interval(known.kind, name, self.told.share, self.told.by_fold)
        }
        sheet, sheets = effect_at(self.best.places, share), [effect_at(x.places, share) for x in self.by_fold]
        for name in ("start_m", "length_m"):
            value, *values = (float(each.values()[name]) for each in (sheet, *sheets))
            # an end that the records do not reach stays where it is
            if np.ptp(values) > 0.0:
                parameters[name] = interval(known.kind, name, value, np.array(values))
        decision = replace(known.decision, parameters=parameters)
        return replace(known, effect=sheet, heldout=self.told.after, decision=decision)
