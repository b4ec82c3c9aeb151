"""Tracing from end to end: measured trials in; verdict.json, model.json and report.html out."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mjx_cutting import _platform
from mjx_cutting._files import write_atomic
from mjx_cutting.cutting import effect_class
from mjx_cutting.cutting.effects.broken_tooth import BrokenTooth
from mjx_cutting.cutting.effects.material_periodicity import MaterialPeriodicity
from mjx_cutting.cutting.effects.tool_gravity import ToolGravity
from mjx_cutting.cutting.effects.torque_ripple import TorqueRipple as RIPPLE
from mjx_cutting.tracing.along.droop import NAME as DROOP
from mjx_cutting.tracing.along.ends import NAME as ENDS
from mjx_cutting.tracing.along.engaged import (
    SURELY_TURNS,
    Engaged,
    at_places_of_their_own,
    engaged,
    mostly_in_the_cut,
)
from mjx_cutting.tracing.along.offset import NAME as OFFSET
from mjx_cutting.tracing.along.presliding import HYSTERESIS
from mjx_cutting.tracing.along.selfexcited import NAME as VIBRATION
from mjx_cutting.tracing.along.selfexcited import SelfExcited, find_vibration
from mjx_cutting.tracing.along.turning_chatter import find_chatter
from mjx_cutting.tracing.before_others import with_droop, with_offset, with_ripple
from mjx_cutting.tracing.breakage import parted_at_breakage
from mjx_cutting.tracing.by_place import in_ramps
from mjx_cutting.tracing.droop_on_ramps import with_droop_on_ramps
from mjx_cutting.tracing.entered import entered
from mjx_cutting.tracing.fitting.measured_path import pose_on_path, steady_cuts
from mjx_cutting.tracing.fitting.tooth_path import on_true_path
from mjx_cutting.tracing.loop_in_air import loop_in_air
from mjx_cutting.tracing.naming.decision import gain_over_trials
from mjx_cutting.tracing.once import once
from mjx_cutting.tracing.one_material import of_one_material
from mjx_cutting.tracing.passes import Pass, for_use, missing, near_floor, without_names
from mjx_cutting.tracing.records.followed_angle import as_followed
from mjx_cutting.tracing.records.levels import LEVEL_KINDS, as_levels, zeros_known
from mjx_cutting.tracing.records.lines import trusted_band
from mjx_cutting.tracing.records.noise import noise_in_shares
from mjx_cutting.tracing.records.spindle import as_turned
from mjx_cutting.tracing.sheet import begin_in_air, inside_the_sheet
from mjx_cutting.tracing.spoiled import spoiled, without
from mjx_cutting.tracing.telling.above_band import above_band
from mjx_cutting.tracing.telling.at_level import at_level
from mjx_cutting.tracing.telling.axes import (
    Reading,
    better_reading,
    most_left,
    other_columns,
    read_as,
    reading_with_an_effect,
)
from mjx_cutting.tracing.telling.dependence import Dependence, dependences
from mjx_cutting.tracing.telling.evidence import evidence
from mjx_cutting.tracing.telling.growing_noise import growing_noise
from mjx_cutting.tracing.telling.isolability import isolability
from mjx_cutting.tracing.telling.judged import Judged, judged
from mjx_cutting.tracing.telling.own_factor import followed
from mjx_cutting.tracing.telling.ties import TIED
from mjx_cutting.tracing.telling.unnamed import Unnamed, unnamed_gain
from mjx_cutting.tracing.telling.verdict import only_scatter, testable, verdict
from mjx_cutting.tracing.telling.zero_in_air import zero_in_air
from mjx_cutting.trials.dataset import Dataset
from mjx_cutting.trials.dropouts import without_dropouts
from mjx_cutting.trials.spikes import without_spikes

_CLEARER = 0.5
_OPEN = ("unexplained", "partly explained")


@dataclass(frozen=True, eq=False, kw_only=True)
class Tracing(Pass):
    """Everything a tracing found: the fields of `Pass`, and what was made of them.

    Fields:
        dataset: the trials, cut down to where the tool is in the sheet if they went beyond it.
        depends_before, depends_after: what the two residuals depend on.
        verdict: the dictionary written to verdict.json.
        unnamed: the factor fitted where no named effect explains what is left; `model` holds it too.
        caveats: what else limits the conclusions, in words.
        reading: of the columns of force, a way to read them that fits far better.
    """

    depends_before: tuple[Dependence, ...]
    depends_after: tuple[Dependence, ...]
    verdict: dict[str, Any]
    unnamed: Unnamed | None = None
    caveats: tuple[str, ...] = ()
    reading: Reading | None = None


def trace(
    dataset: Dataset,
    *,
    band_hz: tuple[float, float] | None = None,
    effects: Sequence[str] | None = None,
    material: str | None = None,
    seed: int = 0,
    progress: Callable[[str], None] = lambda text: None,
) -> Tracing:
    """Find what the base model lacks on these trials.

    Arguments:
        dataset: trials of one tool; at least two of kind "cut".
        band_hz: band in which the sensor is trusted; default the anti-alias corner or half the sampling rate.
        effects: names to try; default every registered effect that the data can test.
        material: of the trials traced; default that of most, where the others are unlike it, else of all.
        seed: for the folds of more than twelve trials.
        progress: told what is being tried.

    Raises:
        ValueError: unknown effect or material, fewer than two cut trials, or an empty band.
    """
    _check(dataset)
    _platform.spare_mappings()
    with _platform.x64():
        dataset = of_one_material(dataset, trusted_band(dataset, band_hz), material)
    _check(dataset)
    dataset, filled = without_dropouts(dataset)
    dataset, replaced = without_spikes(dataset)
    found = _with_every_trial_or_one_less(dataset, band_hz, effects, seed, progress)
    return replace(found, caveats=(*found.caveats, *filled, *replaced))


def _with_every_trial_or_one_less(
    dataset: Dataset,
    band_hz: tuple[float, float] | None,
    effects: Sequence[str] | None,
    seed: int,
    progress: Callable[[str], None],
) -> Tracing:
    """`trace` of checked trials: of all, without one spoiled, or their columns read otherwise if need be."""
    said = dataset.axes
    found = _trace(dataset, said, band_hz, effects, seed, progress)

    def less_one() -> Tracing:
        tried = [(each.before, one.heldout) for each in found.slow[-1:] for one in each.candidates]
        tried += [(each.before, one.heldout) for each in found.search.rounds[-1:] for one in each.candidates]
        one = spoiled(found.dataset, found.final, tried, found.floor_nrmse)
        if one is None or found.verdict["verdict"] not in _OPEN:
            return found
        progress(f"once more, without {one.file}")
        return _trace(without(dataset, one), said, band_hz, effects, seed, progress)

    fewer = less_one()
    if fewer.verdict["verdict"] not in _OPEN:
        return fewer
    if (reading := found.reading or _reading(found)) is not None:
        progress(f"once more, the columns of force read as {list(reading.axes)}")
        otherwise = read_as(dataset, reading.axes)
        again = _trace(otherwise, said, band_hz, effects, seed, progress)
        explained = again.verdict["verdict"] not in _OPEN
        if missing(again) < most_left(said, reading, explained) * missing(found):
            dataset, found = otherwise, again
            fewer = less_one()
    word = found.verdict["verdict"]
    settled = word in _OPEN and fewer.verdict["verdict"] not in _OPEN[: _OPEN.index(word) + 1]
    return fewer if settled or fewer.final.nrmse < _CLEARER * found.final.nrmse else found


def _reading(found: Tracing) -> Reading | None:
    """Another reading of the columns, of those that one effect explains, where the present one is not."""
    if found.verdict["verdict"] not in _OPEN or not found.search.rounds:
        return None
    screened = found.search.rounds[0].screened
    with _platform.x64():
        return reading_with_an_effect(
            found.dataset, found.lines, found.search.problem, screened, found.final.nrmse
        )


def _trace(
    dataset: Dataset,
    said: tuple[str, str, str] | None,
    band_hz: tuple[float, float] | None,
    effects: Sequence[str] | None,
    seed: int,
    progress: Callable[[str], None],
) -> Tracing:
    """`trace`, with every trial; `said` is what the data set itself says of its axes."""
    kinds = testable(dataset) if effects is None else [effect_class(name) for name in effects]
    # droop is not in lines read at the loaded speed, but in where they stand
    steady = [kind for kind in kinds if kind.steady and kind.name != DROOP]
    levels = as_levels(dataset)
    level, known = at_level(dataset, levels), zeros_known(dataset)
    dataset = as_followed(as_turned(levels))
    columns = other_columns(dataset, said)
    if BrokenTooth in kinds:
        dataset = parted_at_breakage(dataset)
    with _platform.x64():
        band = trusted_band(dataset, band_hz)
        with_ends = any(kind.name == ENDS for kind in kinds)
        dataset, on_path = steady_cuts(dataset)

        def one_pass(trials: Dataset) -> Pass:
            return once(trials, band, kinds, steady, seed, progress)

        def by_parts(trials: Dataset) -> tuple[Pass, Engaged | None]:
            found = None
            if with_ends and at_places_of_their_own(trials):
                progress("where each tool is in the sheet")
                return _where_engaged(once(trials, band, (), (), seed, progress), one_pass, with_ends)
            begins, cut = with_ends and begin_in_air(trials), with_ends and mostly_in_the_cut(trials)
            if begins or cut:
                # whatever else a pass over ramps and air found would be looked for once more inside the sheet
                progress("where the tool is in the sheet")
                bare = once(trials, band, [effect_class(ENDS)], (), seed, progress)
                inside = inside_the_sheet(bare, one_pass) if begins else bare
                found = None if inside is bare else inside
                known = any(kind.name == ENDS for kind in bare.kinds)
                if cut and found is None and not (known or near_floor(bare)):
                    return _where_engaged(bare, one_pass, with_ends)
            if found is None:
                found = inside_the_sheet(one_pass(trials), one_pass)
            return _where_engaged(in_ramps(found, band, seed, progress), one_pass, with_ends)

        found = cut_down = None
        if on_path:
            progress("on the measured path of the tool")
            bare = once(dataset, band, (), (), seed, progress)
            found = _if_better(once(dataset, band, kinds, steady, seed, progress, pose_on_path), bare)
        if found is None:
            found, cut_down = by_parts(dataset)
            if any(kind.name == HYSTERESIS.name for kind in kinds):
                found = loop_in_air(dataset, found, lambda rest: by_parts(rest)[0], progress)
        if any(kind.name == VIBRATION for kind in kinds):
            progress("lines off the spindle's multiples")
            found = _with_vibration(found)
        if any(kind.name == DROOP for kind in kinds):
            found = with_droop_on_ramps(dataset, with_droop(found))
        if any(kind.name == OFFSET for kind in kinds) and found.search.problem.motion is None:
            found = with_offset(found)
        if RIPPLE in kinds and RIPPLE not in found.kinds and found.search.problem.motion is None:
            found = with_ripple(found)
        reading = better_reading(found.dataset, found.lines, found.search.problem, found.final.nrmse)
        progress("testing what remains")
        teeth, orders = dataset.tool.teeth, found.lines.orders
        depends_before = dependences(found.dataset, found.before, teeth, orders)
        depends_after = dependences(found.dataset, found.after, teeth, orders)
        cutter = dataset.tool.kind not in LEVEL_KINDS
        if cutter and found.kinds and only_scatter(found.search.base, depends_before, found.floor_nrmse):
            size = sum(kind.size(found.search.problem.tool) for kind in found.kinds)
            if not followed(found.before, found.after, size):
                found = without_names(found, once(found.dataset, band, (), (), seed, progress))
                depends_after = depends_before
        reasons = {
            kind.name: [
                *evidence(kind, found.dataset, found.before, found.after), *found.evidence.get(kind.name, ())
            ]
            for kind in found.kinds
        }  # fmt: skip
        grown = None
        if dataset.tool.kind not in LEVEL_KINDS:
            grown = growing_noise(found.after, dataset.sensor.sample_rate_hz, band)
        by = _judged(found, known, grown)
        word = verdict(
            found.dataset,
            found.lines,
            found.search,
            found.slow,
            depends_before,
            depends_after,
            reasons,
            found.floor_nrmse,
            grown,
            by,
        )
        if grown is not None:
            word["remaining"]["description"] += (
                f"; what is left is noise that grows with the force: {grown:.1%} of it"
            )
        if reading is not None:
            word["remaining"]["description"] += f"; {reading}"
        unnamed = None if found.along else unnamed_gain(found.search, found.lines, depends_after)
        if unnamed is not None:
            found = replace(found, model=for_use(found.dataset, unnamed.model))
            word["remaining"]["description"] += f"; {unnamed}"
        above = above_band(found.dataset, found.model, band)
        zero = zero_in_air(found.dataset, found.model)
        for told in (by.by_axis, above, cut_down, zero, by.zeros, columns, level):
            if told is not None:
                word["remaining"]["description"] += f"; {told}"
    return Tracing(
        **vars(found),
        depends_before=depends_before,
        depends_after=depends_after,
        verdict=word,
        unnamed=unnamed,
        caveats=_caveats(found, reading, unnamed, above, cut_down, zero, by.zeros, columns, level),
        reading=reading,
    )


def _judged(found: Pass, known: bool, grown: float | None) -> Judged:
    """The errors by which the word of the verdict is chosen; `known` whether the trials' zeros are."""
    kind, floor = found.dataset.tool.kind, found.floor_nrmse
    if kind == "drill":
        floor = found.noise_over * noise_in_shares(found.dataset, found.lines)
    errors, models = (found.search.base, found.final), (found.before, found.after)
    return judged(kind, known, errors, models, max(floor, grown or 0.0))


def _where_engaged(
    found: Pass, one_pass: Callable[[Dataset], Pass], with_ends: bool
) -> tuple[Pass, Engaged | None]:
    """What was found, or where more than noise is left and records begin or end in the air, what `one_pass`
    finds where their tools are in the cut; `with_ends` the ramps too, if they are as geometry has them. What
    was found with the ends of the sheet in it stays where that leaves more: of records that are mostly ramp,
    little is cut fully."""
    if found.dataset.tool.kind in LEVEL_KINDS or near_floor(found):
        return found, None
    known = any(kind.name == ENDS for kind in found.kinds)
    part = engaged(found.dataset, SURELY_TURNS if known else 0.0)
    if part is None:
        return found, None
    inside = one_pass(part.dataset)
    inside = entered(found, inside, part, one_pass) if with_ends else inside
    return (found, None) if known and found.final.nrmse < inside.final.nrmse else (inside, part)


def _caveats(found: Pass, *others: object | None) -> tuple[str, ...]:
    caveats = [str(each) for each in others if each is not None]
    if on_true_path(found.search.problem):
        caveats.append(
            "the feed is not small against the radius, and these trials have the teeth on their true "
            "path, not on circles (a chip of c sin th): so has the base model, in the error before too"
        )
    motion = found.search.problem.motion
    if motion is not None:
        moved_m = np.sqrt(2.0 * np.sum(np.abs(np.asarray(motion)[..., :2]) ** 2, axis=(1, 2)))
        kg = next(
            float(np.asarray(each.mass_kg)) for each in found.model.effects if isinstance(each, ToolGravity)
        )
        rounds = found.search.rounds
        alone = rounds[0].before.nrmse if rounds else found.final.nrmse
        caveats.append(
            f"the chip was computed on the measured motion of the tool ({1e6 * moved_m.min():.1f} to "
            f"{1e6 * moved_m.max():.1f} um, root mean square within a turn), and the inertia of {kg:.2g} kg "
            "that the sensor carries was taken into account; the error before is that of a straight path; on "
            f"the measured one, where the teeth alone must explain it, the base model leaves {alone:.1%}"
        )
    return tuple(caveats)


def _if_better(moved: Pass, bare: Pass) -> Pass | None:
    """The pass on the measured path, where held-out trials say that it tells clearly more than the `bare`
    base model on a straight one. That stays the error before: it knows nothing of how the tool moves."""
    gain, error = gain_over_trials(bare.final, moved.final)
    if not gain > TIED * error:
        return None
    search = replace(moved.search, base=bare.search.base)
    return replace(moved, search=search, base_model=bare.base_model, before=bare.before)


def _with_vibration(found: Pass) -> Pass:
    """Vibration that the cut itself keeps up, of which the frequency is told and no model made."""
    if found.dataset.tool.kind in LEVEL_KINDS:
        shaken = find_chatter(found.dataset, found.lines.band_hz, found.after, found.final)
        return found if shaken is None else _shaken(found, shaken)
    weight = np.asarray(found.search.problem.weight)
    feed = {trial.file: trial.feed_speed_m_s for trial in found.dataset.trials}
    waves = [each.effect for each in found.along if isinstance(each.effect, MaterialPeriodicity)]
    waves_hz = np.array([[feed[each.file] / wave.wavelength_m for wave in waves] for each in found.after])
    shaken = find_vibration(found.dataset, found.lines, found.after, found.final, weight, waves_hz)
    return found if shaken is None else _shaken(found, shaken)


def _shaken(found: Pass, shaken: SelfExcited) -> Pass:
    return replace(found.with_round(shaken.round, shaken.evidence), model=found.model)


def save(tracing: Tracing, out: Path) -> None:
    """Write verdict.json, model.json, report.html and isolability.json into the folder `out`."""
    from mjx_cutting.tracing.report.page import render

    page = render(tracing)
    out.mkdir(parents=True, exist_ok=True)
    write_atomic(out / "verdict.json", json.dumps(tracing.verdict, indent=2, allow_nan=False) + "\n")
    write_atomic(out / "model.json", json.dumps(tracing.model.to_dict(), indent=2, allow_nan=False) + "\n")
    write_atomic(out / "report.html", page)
    found = isolability(tracing.search)
    if found is not None:
        write_atomic(out / "isolability.json", json.dumps(found.to_dict(), indent=2) + "\n")


def _check(dataset: Dataset) -> None:
    cuts = sum(trial.kind == "cut" for trial in dataset.trials)
    if cuts < 2:
        raise ValueError(f"{cuts} cut trial; tracing holds out by trial and needs at least two")
