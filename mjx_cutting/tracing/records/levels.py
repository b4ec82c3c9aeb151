"""Drills and turning tools: what is traced is the level of each trial, not its lines.

Such a tool is always engaged, so a turn has no shape to speak of: thrust and torque of a drill, the three
forces of a turning tool, each at the steady part of the trial. A sensor zeroed before the trial reads nothing
there but the cut, so no bias is fitted; where records that begin in the air (of a turning tool, or end in
it: a drill rubs on its way out) show that it was not at zero, what it read there is taken off. Then a record
without air does not tell its force, and is left out where enough others do. Of a sensor zeroed once a
session, what it read there stands beside the cuts as cuts in air do, unless it is far from what those read:
then the tool was in something softer.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.records.course import along_path
from mjx_cutting.tracing.records.part import part_of
from mjx_cutting.tracing.records.steady import IN_CUT, sizes, steady
from mjx_cutting.tracing.records.surface import surfaces_m
from mjx_cutting.tracing.records.way_in import levels_of
from mjx_cutting.trials.dataset import Dataset, LeftOut, Trial
from mjx_cutting.trials.in_air import less_the_air

LEVEL_KINDS = ("drill", "turning")
_AIR = 0.5
_FEWEST_IN_AIR = 20
_AT_REST = 3.0
_SHORTER = 0.8
_FEWEST_ALIKE = 3
_ONE_SHARE = 0.05
_UNLIKE_AIR = 0.15
_MAIN = 1.2
_FEWEST_TOLD = 4
_OFF = 0.02
_NEVER_IN = (
    "ends before the tool is as far in as the others are at their level, expected a record that goes on from "
    "there; record for longer"
)
Array = NDArray[np.floating]


def axes_of(kind: str) -> tuple[str, str, str]:
    """What the three columns of the force are for a tool of this kind."""
    return ("nothing", "torque", "thrust") if kind == "drill" else ("x", "y", "z")


def as_levels(dataset: Dataset) -> Dataset:
    """The dataset with every trial of a drill or turning tool cut down to its steady part; others unchanged.

    For drills the columns of `force_n` become nothing, torque (N m) and thrust (N), which both count positive
    against the cut, whichever way they were recorded. Those of a turning tool are read as a lathe has them,
    the largest along y; where that is not how they were recorded, `axes` changes too.
    """
    if dataset.tool.kind not in LEVEL_KINDS:
        return dataset
    kind = dataset.tool.kind
    trials = [_channels(trial, kind) for trial in dataset.trials]
    once = dataset.sensor.zeroed != "trial"
    known = less_the_air(trials) if once else trials
    airs = [_beside_the_cut(trial, kind) for trial in known]
    if _go_with_the_cut(known, airs):
        airs = [None] * len(trials)
    in_air: list[Trial] = []
    unknown: tuple[LeftOut, ...] = ()
    if once:
        airs = _as_in_air(known, airs, kind)
        known = _at_zero(known, airs)
        in_air = [_air_of(trial, air) for trial, air in zip(trials, airs, strict=True) if air is not None]
    else:
        unknown = _of_unknown_zero(trials, airs, kind)
        trials = _at_zero(trials, airs)
        trials = [trial for trial in trials if trial.file not in {each.file for each in unknown}]
        known = trials
    begins, part = surfaces_m(known, _FEWEST_IN_AIR), levels_of(known)
    short = tuple(LeftOut(file, _NEVER_IN) for file, level in part.items() if level is None)
    cut = []
    for trial in trials:
        if trial.kind != "cut":
            cut.append(trial)
        elif (level := part[trial.file]) is not None:
            cut.append(_level(trial, level, begins.get(trial.file, 0.0)))
    trials = cut + in_air
    levels = replace(dataset, trials=tuple(trials), left_out=(*dataset.left_out, *unknown, *short))
    mean = sum((trial.force_n.mean(axis=0) for trial in trials if trial.kind == "cut"), np.zeros(3))
    if kind == "turning":
        return _as_on_a_lathe(levels, mean)
    against = np.where(mean < 0.0, -1.0, 1.0)
    return replace(levels, trials=tuple(replace(t, force_n=against * t.force_n) for t in trials))


def zeros_known(dataset: Dataset) -> bool:
    """Whether the zero of every trial as recorded is known: the sensor was zeroed once, or most cuts show the
    air beside them; of a cutter it does not matter."""
    if dataset.tool.kind not in LEVEL_KINDS or dataset.sensor.zeroed != "trial":
        return True
    kind = dataset.tool.kind
    cuts = [_channels(trial, kind) for trial in dataset.trials if trial.kind == "cut"]
    airs = [_beside_the_cut(trial, kind) for trial in cuts]
    return 2 * sum(air is not None for air in airs) > len(airs) and not _go_with_the_cut(cuts, airs)


def _as_on_a_lathe(dataset: Dataset, mean_n: Array) -> Dataset:
    """A turning tool's forces, [3] on the mean, in the axes of its base law, which `axes` then says: the
    largest is the main cutting force, along y, and the feed force is against x. What says so as it is stays,
    and so does the sign along z, which the law leaves open."""
    of, main = [0, 1, 2], int(np.argmax(np.abs(mean_n)))
    if abs(mean_n[main]) > _MAIN * abs(mean_n[1]):
        of[main], of[1] = 1, main
    sign = np.where(np.sign(mean_n[of]) * [-1.0, 1.0, 0.0] < 0.0, -1.0, 1.0)
    if of == [0, 1, 2] and np.all(sign > 0.0):
        return dataset
    axes = []
    for was in dataset.axes or ("+x", "+y", "+z"):
        now = of.index("xyz".index(was[1]))
        axes.append(("+" if (was[0] == "+") == (sign[now] > 0.0) else "-") + "xyz"[now])
    noise = dataset.sensor.noise_std_n
    if noise is not None and len(noise) == 3:
        noise = (noise[of[0]], noise[of[1]], noise[of[2]])
    return replace(
        dataset,
        axes=(axes[0], axes[1], axes[2]),
        sensor=replace(dataset.sensor, noise_std_n=noise),
        trials=tuple(replace(trial, force_n=sign * trial.force_n[:, of]) for trial in dataset.trials),
    )


def _level(trial: Trial, steady_part: slice, begins_m: float) -> Trial:
    """The steady part of a trial, at what was fed over it on the mean where that was measured; its place
    counts from where along the path the work begins."""
    place = along_path(trial) - begins_m
    if begins_m:
        trial = replace(trial, position_m=np.column_stack([place, np.zeros((len(place), 2))]))
    level = part_of(trial, place, steady_part)
    measured = level.feed_speed_measured_m_s
    fed = 0.0 if measured is None else float(np.mean(measured))
    return replace(level, feed_speed_m_s=fed) if fed > 0.0 else level


def _channels(trial: Trial, kind: str) -> Trial:
    """The trial with what is measured of it in the columns of the force."""
    force = trial.force_n
    if kind == "drill":
        torque = np.zeros(len(force)) if trial.torque_nm is None else trial.torque_nm
        force = np.stack([np.zeros(len(force)), torque, force[:, 2]], axis=-1)
    return replace(trial, force_n=force, torque_nm=None)


def _at_zero(trials: list[Trial], airs: list[slice | None]) -> list[Trial]:
    """The trials less what they read in the air beside the cut, where that is more than its noise."""
    beside = [None if air is None else trial.force_n[air] for trial, air in zip(trials, airs, strict=True)]
    read = [(air.mean(axis=0), _AT_REST * _error(air)) for air in beside if air is not None]
    if not read:
        return trials
    mean, error = (np.stack(each) for each in zip(*read, strict=True))
    measured = mean.any(axis=0)
    off = (mean / np.maximum(error, 1e-9 * np.abs(mean).max()))[:, measured]
    if not measured.any() or np.mean(off**2) < 1.0:
        return trials
    return [
        trial if air is None else replace(trial, force_n=trial.force_n - air.mean(axis=0))
        for trial, air in zip(trials, beside, strict=True)
    ]


def _of_unknown_zero(trials: list[Trial], airs: list[slice | None], kind: str) -> tuple[LeftOut, ...]:
    """The cuts without air beside them, where those that have it show that the zero of each is its own, and
    off by more than a model is, and where they are enough by themselves."""
    pairs = [pair for pair in zip(trials, airs, strict=True) if pair[0].kind == "cut"]
    told = [(trial, trial.force_n[air].mean(axis=0)) for trial, air in pairs if air is not None]
    without = [trial for trial, air in pairs if air is None]
    if len(told) < max(_FEWEST_TOLD, len(without)):
        return ()
    off = np.sqrt(np.mean([zero**2 for _, zero in told], axis=0))
    level = np.abs(
        np.mean([trial.force_n[steady(trial.force_n)].mean(axis=0) - zero for trial, zero in told], axis=0)
    )
    force = np.maximum(level, 1e-12) if kind == "drill" else np.linalg.norm(level)
    share = float(np.max(off / force))
    if share < _OFF:
        return ()
    why = (
        f"shows no air beside the cut, while the zeros of the {len(told)} cuts that do are off by "
        f"{share:.0%} of the force; begin the record before the tool touches"
    )
    return tuple(LeftOut(trial.file, why) for trial in without)


def _air_of(trial: Trial, air: slice) -> Trial:
    """What a record shows beside the cut, as a cut in air."""
    return replace(
        part_of(trial, along_path(trial), air), kind="air", file=f"{trial.file}, beside the cut", milling=None
    )


def _beside_the_cut(trial: Trial, kind: str) -> slice | None:
    """Samples of the air before a cut, else of a turning tool after it; None where neither."""
    if trial.kind != "cut":
        return None
    before = _air(trial.force_n)
    if before:
        return slice(0, before)
    after = _air(trial.force_n[::-1]) if kind == "turning" else 0
    return slice(len(trial.force_n) - after, len(trial.force_n)) if after else None


def _as_in_air(trials: list[Trial], airs: list[slice | None], kind: str) -> list[slice | None]:
    """What was taken for air, but where it is far from what cuts in air, if any, read: that the `trials` are
    less already."""
    if not any(trial.kind == "air" for trial in trials):
        return airs

    def off(trial: Trial, air: slice) -> float:
        beside, cut = (trial.force_n[part].mean(axis=0) for part in (air, steady(trial.force_n)))
        scale = np.abs(cut) if kind == "drill" else np.full(3, np.linalg.norm(cut))
        return float(np.linalg.norm(beside / np.maximum(scale, 1e-12)))

    pairs = zip(trials, airs, strict=True)
    return [air if air is not None and off(trial, air) < _UNLIKE_AIR else None for trial, air in pairs]


def _go_with_the_cut(trials: list[Trial], airs: list[slice | None]) -> bool:
    """Whether what was taken for air is one share of the force of every cut, as in a soft layer it is."""
    cuts, beside = [], []
    for trial, air in zip(trials, airs, strict=True):
        if air is not None:
            size, usual = sizes(trial.force_n - trial.force_n[air].mean(axis=0))
            cuts.append(trial.force_n[size > IN_CUT * usual].mean(axis=0))
            beside.append(trial.force_n[air].mean(axis=0))
    if len(beside) < _FEWEST_ALIKE:
        return False
    scale = np.maximum(np.abs(cuts).max(axis=0), 1e-12)
    cut, read = np.stack(cuts) / scale, np.stack(beside) / scale
    share = np.sum(cut * read) / np.sum(cut**2)
    left = np.sum((read - share * cut) ** 2)
    return bool(left < _ONE_SHARE * np.sum(read**2) and left < np.sum((read - read.mean(axis=0)) ** 2))


def _air(force: Array) -> int:
    """The first three quarters of the samples before the tool touches; 0 where there are too few to tell
    where the zero is, or where it is none: half or more of what the cut then adds to it."""
    added = force - force[:_FEWEST_IN_AIR].mean(axis=0)
    size, usual = sizes(added)
    touched = int(np.argmax(size > IN_CUT * usual))
    while touched >= _FEWEST_IN_AIR:
        air = force[:touched]
        early, late = air[: 3 * touched // 4], air[3 * touched // 4 :]
        rise = np.abs(late.mean(axis=0) - early.mean(axis=0))
        if np.all(rise <= _AT_REST * _error(late)):
            level = np.linalg.norm(air.mean(axis=0) / np.maximum(np.abs(added).max(axis=0), 1e-12))
            return len(early) if level < _AIR * usual else 0
        touched = int(_SHORTER * touched)
    return 0


def _error(samples: Array) -> Array:
    """[3] standard error of the mean of samples."""
    return np.asarray(samples.std(axis=0) / np.sqrt(len(samples)))
