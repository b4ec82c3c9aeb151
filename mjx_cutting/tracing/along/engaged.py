"""Records that begin or end in the air, each at a place of its own: cut down to where the tool is in the cut.

Where the sheet ends at one place for all trials, `sheet` finds that place and holds its ramps against
geometry. A recorder that was started by hand, or sheets clamped anew, show the same ramps at other places in
every trial. Lines of a whole record then mix cut and air, and nothing that is found on them can be believed.
So if the force, over one revolution, is next to none at the beginning or the end of records, those are cut
down to where it has reached its level and the arc, by geometry, has become full. A line once a turn is no
cut: an unbalance is there in the air too. What the sheet is like at a place counts from its edge, so where
no position was measured and all records show the touch, but at places of their own, places do too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from mjx_cutting.tracing.along.ends import way_in_m
from mjx_cutting.tracing.records.course import along_path, rate_hz
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.part import part_of
from mjx_cutting.tracing.records.zero import samples_a_turn, zeros
from mjx_cutting.trials.dataset import Dataset, LeftOut, ToolInfo, Trial

_AIR = 0.2
_LEVEL = 0.85
_USUAL = 75.0
_HIGHEST = 98.0
_HALF = 0.5
_STRAY = 0.05
_CLEAR = 1.1
_AT_ONCE = 0.85
_AT_ONCE_TURNS = 4
_ANGLES = 400
_FEWEST_TURNS = 0.25
SURELY_TURNS = 3.0
_LEAST_TURNS = 6.0
_FEWEST_IN_AIR = 10
_FEWEST_A_PITCH = 4
_LONGER = 1.5
_LEAST_SHARE = 1.0 / 3.0
_FEWEST = 3
_AT_ONE_PLACE = 0.1
Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Engaged:
    """The trials cut down. Fields: `dataset`; `spans_s` first and last time kept of every trial that was cut
    down, by file; `whole` the same trials with all of their records; `touched_m` where along the path the
    force of those begins and ends, by file, m, infinite at an end that lies in the cut; `from_the_edge`
    whether places count from where the axis crosses the edge of the sheet, at a place of its own in each."""

    dataset: Dataset
    spans_s: dict[str, tuple[float, float]]
    whole: Dataset
    touched_m: dict[str, tuple[float, float]]
    from_the_edge: bool = False

    def __str__(self) -> str:
        said = "the tool enters or leaves the sheet within records"
        if not self.spans_s:
            return f"{said}; too little of those was in the cut, so they are left out"
        told = ", ".join(f"{file} {low:.2f} to {high:.2f} s" for file, (low, high) in self.spans_s.items())
        counted = "; places count from where its axis meets the edge" if self.from_the_edge else ""
        return f"{said}; they were traced where it is in the cut ({told}){counted}"


def engaged(dataset: Dataset, shown_by_turns: float = 0.0) -> Engaged | None:
    """The trials where their tools are in the cut; None where no record begins or ends in the air, or none
    for `shown_by_turns`."""
    cuts = [trial for trial in dataset.trials if trial.kind == "cut"]
    zeros_n = zeros(dataset)
    found = {trial.file: _stay(trial, dataset.tool, zeros_n[trial.file]) for trial in cuts}
    stays = {file: stay for file, stay in found.items() if stay is not None}
    if not any(stay.outside_turns >= shown_by_turns for stay in stays.values()):
        return None
    edges_m = _edges_m(cuts, stays, dataset.tool)
    if edges_m:
        counted = tuple(
            _counted_from(trial, edges_m[trial.file]) if trial.file in edges_m else trial
            for trial in dataset.trials
        )
        dataset = replace(dataset, trials=counted)
        stays = {file: stay.counted_from(edges_m[file]) for file, stay in stays.items()}
    shown = all(trial.file in stays and stays[trial.file].air >= _FEWEST_IN_AIR for trial in cuts)
    zeroed = shown and dataset.sensor.zeroed == "trial"
    read = [_at_zero(trial, stays) if zeroed else trial for trial in dataset.trials]
    parts = {t.file: (along_path(t), stays[t.file].part) for t in read if t.file in stays}
    rest = cut_down(replace(dataset, trials=tuple(read)), parts)
    if sum(trial.kind == "cut" for trial in rest.trials) < 2:
        return None
    kept = {trial.file for trial in rest.trials}
    spans = {t.file: (float(t.time_s[0]), float(t.time_s[-1])) for t in rest.trials if t.file in stays}
    if zeroed:
        # so all share a bias, of which the air says that it is none
        rest = replace(rest, sensor=replace(rest.sensor, zeroed="session"))
    whole = replace(rest, trials=tuple(trial for trial in read if trial.file in kept))
    if zeroed:
        air = _air(max(cuts, key=lambda trial: stays[trial.file].air), stays)
        rest = replace(rest, trials=(*rest.trials, air))
    return Engaged(rest, spans, whole, {file: stays[file].touched_m for file in spans}, bool(edges_m))


def mostly_in_the_cut(dataset: Dataset) -> bool:
    """Whether records of a cutter surely begin or end in the air, and together hold the tool fully in the cut
    over more than half of them, each over more than a third."""
    if dataset.tool.kind in LEVEL_KINDS or (part := engaged(dataset, SURELY_TURNS)) is None:
        return False
    kept = {trial.file: len(trial.time_s) for trial in part.dataset.trials}
    samples = {trial.file: len(trial.time_s) for trial in dataset.trials if trial.kind == "cut"}
    share = [kept.get(file, 0) / whole for file, whole in samples.items()]
    return min(share) > _LEAST_SHARE and 2 * sum(kept.get(file, 0) for file in samples) > sum(
        samples.values()
    )


def at_places_of_their_own(dataset: Dataset) -> bool:
    """Whether every record of a cutter shows where the tool touches the sheet, at a place of its own, and
    most hold it fully in the cut: a model of whole records has it at one place."""
    if dataset.tool.kind in LEVEL_KINDS or (part := engaged(dataset, SURELY_TURNS)) is None:
        return False
    before, after = (sum(each.kind == "cut" for each in one.trials) for one in (dataset, part.dataset))
    return part.from_the_edge and 2 * after > before and after >= _FEWEST


def one_place(touched_m: Array, reach_m: Array) -> tuple[Array, float] | None:
    """[R] where the records have the sheet begin, m, and whether the axis meets it there, 1, or the rim, 0,
    whichever has the places closer together; None where those are not one place.

    Arguments: [R] where the rim touches first, and the way from there until the arc is full, m.
    """
    ways = [(touched_m + by_axis * reach_m, by_axis) for by_axis in (0.0, 1.0)]
    places, by_axis = min(ways, key=lambda way: float(np.ptp(way[0])))
    return (places, by_axis) if np.ptp(places) <= _AT_ONE_PLACE * reach_m.min() else None


def cut_down(
    dataset: Dataset, parts: Mapping[str, tuple[Array, slice]], least_samples: float = 0.0
) -> Dataset:
    """The trials with those in `parts` cut down to where the tool is fully in the cut.

    Arguments:
        parts: by file, the way along the path [T], m, and the samples kept. Where these are fewer than six
            turns of the spindle, or than `least_samples`, the trial is left out.
    """
    trials, left_out = [], list(dataset.left_out)
    for trial in dataset.trials:
        if trial.file in parts:
            place, part = parts[trial.file]
            samples = max(part.stop - part.start, 0)
            turns = samples / len(trial.time_s) * float(np.ptp(trial.time_s)) * trial.spindle_speed_rev_s
            if turns < _LEAST_TURNS or samples < least_samples:
                asked = f"{_LEAST_TURNS:g}" + (f" ({least_samples:.0f})" if least_samples else "")
                why = (
                    f"got {turns:.0f} turns of the spindle ({samples} samples) with the tool fully in the "
                    f"cut, expected {asked} or more; cut further before the record ends."
                )
                left_out.append(LeftOut(trial.file, why))
                continue
            trial = part_of(trial, place, part)
        trials.append(trial)
    return replace(dataset, trials=tuple(trials), left_out=tuple(left_out))


def _at_zero(trial: Trial, stays: dict[str, _Stay]) -> Trial:
    """A trial less what it reads in the air: before the cut, or where it is all in air."""
    air = trial.force_n if trial.kind == "air" else trial.force_n[: stays[trial.file].air]
    return replace(trial, force_n=trial.force_n - air.mean(axis=0))


def _air(trial: Trial, stays: dict[str, _Stay]) -> Trial:
    """What a record shows before the cut, less its mean, as a cut in air."""
    air = part_of(trial, along_path(trial), slice(0, stays[trial.file].air))
    force_n = air.force_n - air.force_n.mean(axis=0)
    return replace(air, kind="air", file=f"{trial.file}, before the cut", force_n=force_n)


@dataclass(frozen=True)
class _Stay:
    """Where a tool is in the cut. Fields: `part` samples; `air` samples before the first touch; `touched_m`
    places along the path where the force begins and ends, or the record does on the way there, infinite where
    it is in the cut then; `outside_turns` turns in the air at the end at which there are more."""

    part: slice
    air: int
    touched_m: tuple[float, float]
    outside_turns: float

    def counted_from(self, place_m: float) -> _Stay:
        """The same, places counted from one of them."""
        first, last = self.touched_m
        return replace(self, touched_m=(first - place_m, last - place_m))


def _at_level_by(depth_share: float) -> float:
    """Share of the way in after which geometry has the force at its level: the thickest chips, ahead of the
    axis, are met first, so in a slot that is soon. `depth_share` is the radial depth over the diameter."""
    angle = np.linspace(0.0, np.arccos(1.0 - 2.0 * min(depth_share, 1.0)), _ANGLES)
    ahead = np.sin(angle)
    order = np.argsort(ahead)[::-1]
    energy = np.cumsum(ahead[order] ** 2)
    reached = order[int(np.searchsorted(energy, _LEVEL**2 * energy[-1]))]
    return float(1.0 - ahead[reached] / ahead.max())


def _edges_m(cuts: Sequence[Trial], stays: Mapping[str, _Stay], tool: ToolInfo) -> dict[str, float]:
    """By file, where along its path the axis crosses the edge of the sheet, m, where no position was measured
    and every cut shows the touch, at a place of its own whether it is the rim or the axis that meets it."""
    if any(t.position_m is not None or t.file not in stays for t in cuts):
        return {}
    touched = np.array([stays[trial.file].touched_m[0] for trial in cuts])
    reach = np.array([float(way_in_m(trial.radial_depth_m, tool.diameter_m)) for trial in cuts])
    if not np.all(np.isfinite(touched)) or one_place(touched, reach) is not None:
        return {}
    return dict(zip((trial.file for trial in cuts), (touched + reach).tolist(), strict=True))


def _counted_from(trial: Trial, place_m: float) -> Trial:
    """A trial of which the place along the path is counted from one of them."""
    place = along_path(trial) - place_m
    return replace(trial, position_m=np.column_stack([place, np.zeros((len(place), 2))]))


def touches_m(dataset: Dataset) -> NDArray[np.floating]:
    """[R] position along the path where each cut trial first touches, m; nan where it begins in the cut."""
    found, zeros_n = [], zeros(dataset)
    for trial in dataset.trials:
        if trial.kind == "cut":
            touching, _ = _sizes(trial, dataset.tool.teeth, zeros_n[trial.file])
            in_air = touching[0] >= round(SURELY_TURNS * samples_a_turn(trial))
            found.append(along_path(trial)[touching[0]] if in_air else np.nan)
    return np.asarray(found)


def in_the_air(dataset: Dataset) -> dict[str, NDArray[np.bool_]]:
    """[T] where each cut trial surely is in the air before or after its cut, by file: half the way in and a
    turn away from where the force is seen to begin or to end."""
    found, zeros_n = {}, zeros(dataset)
    for trial in dataset.trials:
        if trial.kind == "cut":
            touching, _ = _sizes(trial, dataset.tool.teeth, zeros_n[trial.file])
            place, turn = along_path(trial), samples_a_turn(trial)
            away_m = 0.5 * float(way_in_m(trial.radial_depth_m, dataset.tool.diameter_m))
            sample = np.arange(len(place))
            before = (sample < touching[0] - turn) & (place < place[touching[0]] - away_m)
            behind = (sample > touching[-1] + turn) & (place > place[touching[-1]] + away_m)
            found[trial.file] = before | behind
    return found


def _sizes(trial: Trial, teeth: int, zero_n: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Samples at which the force over a tooth's pitch is more than next to none, and that over a turn has
    reached its level, counted from the sensor's zero `zero_n` [3]."""
    turn = samples_a_turn(trial)
    energy = np.sum((trial.force_n - zero_n) ** 2, axis=1)
    pitch = max(round(turn / teeth), min(_FEWEST_A_PITCH, turn))
    over_pitch, over_turn = (
        np.sqrt(np.maximum(uniform_filter1d(energy, each, mode="nearest"), 0.0)) for each in (pitch, turn)
    )
    level = _level(over_turn)
    # of a record of no force at all every sample is at its level
    touching, full = np.flatnonzero(over_pitch >= _AIR * level), np.flatnonzero(over_turn >= _LEVEL * level)
    cutting = np.flatnonzero(_beside_once_a_turn(trial, turn, energy, zero_n) >= _AIR * level)
    if cutting.size:
        touching = _without_strays(touching, cutting, turn, len(energy))
        surely, last = SURELY_TURNS * turn, len(energy) - 1
        # a tool that balances is known to touch by the sample
        begin = int(cutting[0]) if touching[0] < turn and cutting[0] > surely else 0
        end = int(cutting[-1]) if touching[-1] > last - turn and cutting[-1] < last - surely else last
        touching = touching[(touching >= begin) & (touching <= end)]
    return touching, full


def _without_strays(
    touching: NDArray[np.int64], cutting: NDArray[np.int64], turn: int, samples: int
) -> NDArray[np.int64]:
    """Samples that touch, but for the few that noise lets do so more than a turn away from the cut."""
    first, last = int(cutting[0]) - turn, int(cutting[-1]) + turn
    before, behind = touching < first, touching > last
    stray = before & (before.sum() < _STRAY * max(first, 0))
    stray |= behind & (behind.sum() < _STRAY * max(samples - last, 0))
    return touching[~stray]


def _level(size: Array) -> float:
    """The usual size of a force in the cut, of [T] all along a record that may be mostly air."""
    usual, highest = np.percentile(size, (_USUAL, _HIGHEST))
    return float(np.median(size[size >= _HALF * highest]) if usual < _AIR * highest else usual)


def _beside_once_a_turn(trial: Trial, turn: int, energy: Array, zero_n: Array) -> Array:
    """[T] size of the force over a turn, N, without what goes round once in it; `energy` [T] its square."""
    wave = np.exp(-2j * np.pi * trial.spindle_speed_rev_s * trial.time_s)[:, None] * (trial.force_n - zero_n)
    once = uniform_filter1d(wave, turn, axis=0, mode="nearest")
    rest = uniform_filter1d(energy, turn, mode="nearest") - 2.0 * np.sum(np.abs(once) ** 2, axis=1)
    return np.asarray(np.sqrt(np.maximum(rest, 0.0)))


def _stay(trial: Trial, tool: ToolInfo, zero_n: Array) -> _Stay | None:
    """Where the tool is in the cut; None where it is from the first sample to the last."""
    touching, full = _sizes(trial, tool.teeth, zero_n)
    turn = samples_a_turn(trial)
    gaps = np.diff(touching)
    # teeth that miss leave gaps within every turn
    usual = int(np.max(gaps[gaps < turn], initial=1))
    least = max(round(_FEWEST_TURNS * turn), round(_LONGER * usual))
    last_sample = len(trial.time_s) - 1
    before, after = int(touching[0]), last_sample - int(touching[-1])
    if max(before, after) < least:
        return None
    way_in = float(way_in_m(trial.radial_depth_m, tool.diameter_m)) / trial.feed_speed_m_s * rate_hz(trial)
    soonest = _AT_ONCE * _at_level_by(trial.radial_depth_m / tool.diameter_m) * way_in

    def within(touched: int, reached: int) -> int:
        """Samples from the first touch until force and arc are full. Where the force is at its level within a
        few turns, and long before geometry would have it, the tool began in a pocket, its arc full at once. A
        sheet shorter than the way in has its highest force early too, but not within turns."""
        risen = abs(reached - touched)
        at_once = risen < min(soonest, _AT_ONCE_TURNS * turn)
        ramp = 0 if at_once else round(_CLEAR * way_in)
        return turn + max(risen, ramp)

    def on_ramp(level_for: int) -> bool:
        """Whether a record that does not reach the air is seen to end, or to begin, on the way there."""
        return turn < level_for < turn + way_in

    comes = before >= least or on_ramp(int(full[0]))
    goes = after >= least or on_ramp(last_sample - int(full[-1]))
    first = int(touching[0]) + within(touching[0], full[0]) if comes else 0
    last = int(touching[-1]) - within(touching[-1], full[-1]) if goes else last_sample
    place = along_path(trial)
    touched = (
        float(place[touching[0]]) if comes else -np.inf,
        float(place[touching[-1]]) if goes else np.inf,
    )
    air = max(before - turn, 0) if before >= least else 0
    return _Stay(slice(first, last + 1), air, touched, max(before, after) / turn)
