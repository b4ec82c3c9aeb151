"""The verdict in the format mjx-cutting-verdict/1: what is missing, how sure that is, what remains."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect, effect_class, effect_names
from mjx_cutting.tracing.along.droop import NAME as DROOP
from mjx_cutting.tracing.along.flutes import FLUTES
from mjx_cutting.tracing.along.presliding import HYSTERESIS
from mjx_cutting.tracing.along.selfexcited import NAME as VIBRATION
from mjx_cutting.tracing.along.slow_kinds import BY_PLACE, KINDS
from mjx_cutting.tracing.along.slow_round import SlowRound
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.naming.candidate import Round
from mjx_cutting.tracing.naming.intervals import Interval
from mjx_cutting.tracing.naming.search import Search
from mjx_cutting.tracing.records.course import beside_path, feeds_differ
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.lines import Lines
from mjx_cutting.tracing.records.spindle import measured_speed
from mjx_cutting.tracing.telling.dependence import Dependence
from mjx_cutting.tracing.telling.judged import Judged
from mjx_cutting.tracing.telling.own_factor import SCATTER
from mjx_cutting.tracing.telling.ties import tie
from mjx_cutting.tracing.telling.unseen import BESIDE_LINES, needs
from mjx_cutting.trials.dataset import Dataset

FORMAT = "mjx-cutting-verdict/1"
AT_FLOOR = 1.1
_CLEARLY = 1.5
_CLEARLY_OF_LEVELS = 3.0
_MUCH_SCATTER = 2.0 * SCATTER
_MUCH = 0.01
_NOT_OF_NOISE = ("time in trial", "position", "cut length", "clock time")


def verdict(
    dataset: Dataset,
    lines: Lines,
    found: Search,
    slow: Sequence[SlowRound],
    before: Sequence[Dependence],
    after: Sequence[Dependence],
    evidence: dict[str, list[str]],
    floor_nrmse: float,
    grown: float | None = None,
    judged: Judged | None = None,
) -> dict[str, Any]:
    """The verdict as a dictionary ready for verdict.json.

    Arguments:
        dataset, lines: the data and its lines.
        found, slow: the outcome of the searches over steady effects and over those along a trial.
        before, after: what the residual depends on under the base and under the final model.
        evidence: sentences for each accepted effect, by name.
        floor_nrmse: share of the force that the noise of the records is.
        grown: share of the force that is noise growing with it, where that is what the model leaves.
        judged: the errors the word is chosen by; default those on held-out trials.
    """
    end = final(found, slow)
    floor = max(floor_nrmse, grown or 0.0)
    judged = judged or Judged(found.base.nrmse, end.nrmse, floor, noise=floor)
    tolerance, levels = found.problem.tolerance, dataset.tool.kind in LEVEL_KINDS
    if judged.own_zero:
        before, after = ([each for each in some if each.covariate != "trial"] for some in (before, after))
    accepted = [each for each in found.rounds if each.accepted is not None]
    kinds = [each.accepted.kind for each in accepted if each.accepted is not None]
    # a second of one kind asks for no other cause than that which is there already
    firsts = (each for place, each in enumerate(accepted) if kinds[place] not in kinds[:place])
    ties = (tie(each, kinds, dataset, lines, found, floor) for each in firsts)
    ambiguous = [pair for pair in ties if pair is not None]
    named: list[dict[str, Any]] = []
    for each, own in zip(accepted, found.intervals, strict=True):
        _add(named, _effect(each, own, evidence))
    for one in slow:
        if one.accepted:
            _add(named, _effect(one, one.accepted.decision.parameters, evidence))
    shown = _shown(before, dataset, judged.before, judged.noise, reached(judged.noise, tolerance))
    error, most, left = _remains(after, judged, tolerance, levels, nameless=shown and not named)
    return {
        "format": FORMAT,
        "verdict": _word(error, most, bool(named), bool(ambiguous), shown, left),
        "before": _errors(found.base, lines),
        "after": _errors(end, lines),
        "noise_floor_nrmse": floor,
        "band_hz": list(lines.band_hz),
        "effects": named,
        "ambiguous": ambiguous,
        "not_testable": not_testable(dataset),
        "remaining": _remaining(found.base, end, left, next(filter(_of_the_trial, after), None)),
        "left_out": [{"file": each.file, "reason": each.reason} for each in dataset.left_out],
    }


def final(found: Search, slow: Sequence[SlowRound]) -> HeldOut:
    """Error on held-out trials of the model with everything accepted."""
    return next((each.accepted.heldout for each in reversed(slow) if each.accepted), found.final)


def not_testable(dataset: Dataset) -> list[dict[str, str]]:
    """Registered effects whose telling covariate is absent, or that tracing cannot look for."""
    missing = []
    slow = {kind.name for kind in KINDS}
    shown = (slow | {VIBRATION}) - (set() if dataset.tool.kind == "drill" else {FLUTES.name})
    by_place = set(BY_PLACE) if dataset.tool.kind not in LEVEL_KINDS else {*BY_PLACE, FLUTES.name}
    if has(dataset, "tool velocity"):
        by_place.discard(HYSTERESIS.name)  # there, by what the tool does across the path
    cuts = [trial for trial in dataset.trials if trial.kind == "cut"]
    for name in _physical():
        absent = [need for need in effect_class(name).needs if not has(dataset, need)]
        if absent:
            missing.append({"name": name, "needs": needs(name, absent)})
        elif dataset.tool.kind in LEVEL_KINDS and name == DROOP:
            if any(measured_speed(trial) is None for trial in cuts):
                missing.append({"name": name, "needs": "spindle angle or spindle speed"})
        elif dataset.tool.kind in LEVEL_KINDS and not (name in shown or _shows_in_levels(effect_class(name))):
            missing.append({"name": name, "needs": "a cutter whose force changes over a turn"})
        elif name in by_place and not feeds_differ([trial.feed_speed_m_s for trial in cuts]):
            missing.append({"name": name, "needs": "cuts at different feeds, which tell a place from a time"})
        elif not effect_class(name).steady and name not in slow and name not in BESIDE_LINES:
            missing.append({"name": name, "needs": needs(name)})
    return missing


def _shows_in_levels(kind: type[AbstractEffect]) -> bool:
    """Whether an effect changes the level of a tool that is always engaged; one in the lines does not."""
    in_lines = kind.transfer is not AbstractEffect.transfer
    return kind.steady and kind.stage in ("edge", "sensor") and not in_lines


def testable(dataset: Dataset) -> list[type[AbstractEffect]]:
    """Effects tried without being asked for: all registered ones that these trials can test."""
    absent = {entry["name"] for entry in not_testable(dataset)}
    return [effect_class(name) for name in _physical() if name not in absent]


def _physical() -> list[str]:
    """Names of the effects that are causes."""
    return [name for name in effect_names() if effect_class(name).physical]


def has(dataset: Dataset, need: str) -> bool:
    """Whether the trials carry a covariate an effect needs."""
    cuts = [trial for trial in dataset.trials if trial.kind == "cut"]
    present = {
        "position": any(trial.position_m is not None for trial in cuts),
        "spindle angle": any(trial.spindle_angle_rad is not None for trial in cuts),
        "spindle speed": any(trial.spindle_speed_measured_rev_s is not None for trial in cuts),
        "feed speed": any(trial.feed_speed_measured_m_s is not None for trial in cuts),
        "tool velocity": any(beside_path(trial, dataset.axes, 0.0) is not None for trial in cuts),
        "air cut": any(trial.kind == "air" for trial in dataset.trials),
        "cut length": len({trial.cut_length_before_m for trial in cuts}) > 1,
        "clock": dataset.sensor.zeroed == "session" and len({trial.clock_start_s for trial in cuts}) > 1,
    }
    return present.get(need, False)


def _word(error: float, most: float, named: bool, tied: bool, shown: bool, left: list[Dependence]) -> str:
    """The verdict; `most` is the error up to which a model explains all, where nothing is left to be seen."""
    if not named:
        return "unexplained" if shown else "nothing missing"
    if tied:
        return "ambiguous"
    return "partly explained" if error > most or left else "explained"


def _shown(before: Sequence[Dependence], dataset: Dataset, base: float, floor: float, least: float) -> bool:
    """Whether something is missing: the residual depends on something, or is clearly more than noise.

    Levels, of which a trial has one, scatter more than the noise within a trial. A small factor of each
    trial's own is taken first. Where the noise had to be read beside the lines, all that is not periodic
    counts as noise; no noise follows the path or the session by more than a hundredth of the force.
    """
    clearly = _of_levels(least) if dataset.tool.kind in LEVEL_KINDS else _CLEARLY * least
    error = less_scatter(base, before)
    shown = [
        each
        for each in before
        if each.found
        and not (_of_the_trial(each) or _colour(each, least) or _no_more_than_noise(each, floor, least))
    ]
    follows = any(each.covariate in _NOT_OF_NOISE and each.of_force > _MUCH for each in shown)
    return error > clearly or (error > least and bool(shown)) or follows


def _of_levels(least: float) -> float:
    """The error up to which levels may scatter where noise and calculation leave `least`: three times that,
    or twice what two cuts of one sheet may differ by, where samples are noisy, which a level need not be."""
    return min(_CLEARLY_OF_LEVELS * least, float(np.hypot(least, _MUCH_SCATTER)))


def _remains(
    after: Sequence[Dependence], judged: Judged, tolerance: float, levels: bool, nameless: bool
) -> tuple[float, float, list[Dependence]]:
    """The error of the final model less scatter, up to which one it explains all, and what its residual
    depends on. Where something is there that nothing named explains, `nameless`, that is told by the sensor's
    noise, as what asks for a name is; what a name leaves, by that of chips not alike as well."""
    noise = judged.noise if nameless else judged.floor
    least, quiet = reached(noise, tolerance), reached(judged.noise, tolerance)
    most = max(least, _of_levels(quiet)) if levels else least
    error = less_scatter(judged.after, after)
    if judged.unlike is not None:
        # one chip larger than the next is so on all axes
        after = [each for each in after if not (each.covariate == "another axis" and each.of_force <= least)]
    return error, most, _left(after, error, noise, least, most)


def _left(
    after: Sequence[Dependence], error: float, floor: float, least: float, most: float
) -> list[Dependence]:
    """What the residual of the final model depends on; where its `error` is no more than noise leaves at
    `most`, the noise's own colour does not count, nor what would make it no more than `least`."""
    found = (each for each in after if each.found and not _of_the_trial(each))
    if error > most:
        return list(found)
    shown = (each for each in found if not _colour(each, least))
    return [each for each in shown if not _no_more_than_noise(each, floor, least)]


def less_scatter(error: float, depends: Sequence[Dependence]) -> float:
    """An `error` on held-out trials less the small factors of each trial's own: on trials not seen they count
    more than once, since the other trials' are in the constants."""
    own = next(filter(_of_the_trial, depends), None)
    if own is None:
        return error
    return min(error, own.of_force * float(np.sqrt(1.0 / own.share - 1.0)))


def only_scatter(base: HeldOut, before: Sequence[Dependence], floor: float) -> bool:
    """Whether the base model leaves noise, `floor` of the force, and a small factor of each trial's own that
    goes with nothing: what an effect explains of that, it explains by chance."""
    found = [each for each in before if each.found]
    scatter = bool(found) and all(map(_of_the_trial, found))
    return scatter and less_scatter(base.nrmse, before) <= AT_FLOOR * floor


def _of_the_trial(each: Dependence) -> bool:
    """Whether this is a factor of each trial's own, too small to be called something missing."""
    return each.covariate == "trial" and each.found and each.factor < SCATTER


def _colour(each: Dependence, least: float) -> bool:
    """Whether this may be the colour of noise that leaves `least` of the force: what one sample has of that
    before it, or all samples of a trial have of those around them."""
    return each.covariate in ("previous force", "time in trial") and each.of_force <= least


def _no_more_than_noise(each: Dependence, floor: float, least: float) -> bool:
    """Whether noise and this together would leave no more than counts as noise alone, `least`."""
    return float(np.hypot(floor, each.of_force)) <= least


def reached(floor: float, tolerance: float) -> float:
    """Heldout NRMSE up to which a model is as good as the noise floor, and its own tolerance, let it be."""
    return float(np.hypot(AT_FLOOR * floor, tolerance))


def _errors(heldout: HeldOut, lines: Lines) -> dict[str, Any]:
    return {
        "heldout_nrmse": heldout.nrmse,
        "per_axis": _plain(heldout.per_axis),
        "per_trial": dict(zip(lines.whole_files, _plain(heldout.per_trial), strict=True)),
    }


def _effect(
    each: Round | SlowRound, values: dict[str, Interval], evidence: dict[str, list[str]]
) -> dict[str, Any]:
    assert each.accepted is not None
    runner_up = each.runner_up
    return {
        "name": each.accepted.kind.name,
        "heldout_gain": each.accepted.decision.gain,
        "gain_standard_error": _plain(each.accepted.decision.gain_standard_error),
        "parameters": {name: _parameter(value) for name, value in values.items()},
        "runner_up": None
        if runner_up is None
        else {"name": runner_up.kind.name, "heldout_nrmse": runner_up.heldout.nrmse},
        "evidence": evidence.get(each.accepted.kind.name, []),
    }


def _add(named: list[dict[str, Any]], found: dict[str, Any]) -> None:
    """Add an effect to those named; of several modes, layers or harmonics the first stands for all, and what
    it is joined by is told as evidence."""
    first = next((each for each in named if each["name"] == found["name"]), None)
    if first is None:
        named.append(found)
        return
    first["heldout_gain"] += found["heldout_gain"]
    values = (
        (name, each.get("values", each["value"]), each["unit"]) for name, each in found["parameters"].items()
    )
    told = ", ".join(
        f"{name} {np.array2string(np.asarray(value), precision=4)} {'' if unit == '1' else unit}".rstrip()
        for name, value, unit in values
    )
    first["evidence"] = [*first["evidence"], f"and another: {told}"]


def _parameter(found: Interval) -> dict[str, Any]:
    """One parameter: the surest value, and all of them where there are several."""
    told: dict[str, Any] = {"value": found.value, "low": found.low, "high": found.high}
    if found.values:
        value, half = np.asarray(found.values), np.asarray(found.half)
        told |= {"values": value, "lows": value - half, "highs": value + half}
    return {**{name: _plain(each) for name, each in told.items()}, "unit": found.unit}


def _remaining(base: HeldOut, end: HeldOut, left: list[Dependence], own: Dependence | None) -> dict[str, Any]:
    share = float(end.error_n2.sum() / max(base.error_n2.sum(), 1e-300))
    if left:
        says = "; ".join(
            f"{each.covariate} ({each.share:.0%} of what is left): {each.look_for}" for each in left
        )
        text = f"what is left still depends on {says}"
    else:
        text = "what is left depends on nothing that was measured"
    if own is not None:
        text += f"; the force of each trial is larger or smaller as a whole, by {own.factor:.1%} "
        text += f"({own.share:.0%} of what is left): below {SCATTER:.1%} that counts as scatter"
    return {
        "depends_on": [each.covariate for each in left],
        "description": text,
        "share_of_energy": share,
    }


def _plain(value: Any) -> Any:
    array: NDArray[np.floating] = np.asarray(value, dtype=float)
    listed = np.where(np.isfinite(array), array, np.nan).tolist()
    if isinstance(listed, list):
        return [None if each != each else each for each in listed]
    return None if listed != listed else listed
