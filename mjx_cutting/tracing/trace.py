"""Tracing from end to end: measured trials in; verdict.json, model.json and report.html out."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from mjx_cutting import _platform
from mjx_cutting._files import write_atomic
from mjx_cutting.cutting import effect_class
from mjx_cutting.cutting.effects.broken_tooth import BrokenTooth
from mjx_cutting.tracing.breakage import parted_at_breakage
from mjx_cutting.tracing.every_pass import every_pass
from mjx_cutting.tracing.exchanged import exchanged, two_unlike
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.fitting.sheets import of_the_first
from mjx_cutting.tracing.fitting.unsaid_filter import as_filtered
from mjx_cutting.tracing.materials import of_known_materials
from mjx_cutting.tracing.once import once
from mjx_cutting.tracing.passes import Pass, missing, near_floor, without_names
from mjx_cutting.tracing.records.followed_angle import as_followed
from mjx_cutting.tracing.records.levels import LEVEL_KINDS, as_levels, zeros_known
from mjx_cutting.tracing.records.lines import trusted_band
from mjx_cutting.tracing.records.spindle import as_turned
from mjx_cutting.tracing.spoiled import spoiled, without
from mjx_cutting.tracing.telling.at_level import at_level
from mjx_cutting.tracing.telling.axes import (
    Reading,
    most_left,
    other_columns,
    read_as,
    reading_with_an_effect,
)
from mjx_cutting.tracing.telling.dependence import Dependence, dependences
from mjx_cutting.tracing.telling.heard_speeds import heard_speeds
from mjx_cutting.tracing.telling.isolability import isolability
from mjx_cutting.tracing.telling.own_factor import followed
from mjx_cutting.tracing.telling.own_teeth import own_teeth
from mjx_cutting.tracing.telling.verdict import only_scatter, testable
from mjx_cutting.tracing.told import Tracing, told
from mjx_cutting.trials.dataset import Dataset
from mjx_cutting.trials.dropouts import without_dropouts
from mjx_cutting.trials.spikes import without_spikes

_CLEARER = 0.5
_OPEN = ("unexplained", "partly explained")
_CLOSED = 2


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
        material: of the trials traced; default all that enough of them are of, each with its own constants.
        seed: for the folds of more than twelve trials.
        progress: told what is being tried.

    Raises:
        ValueError: unknown effect or material, fewer than two cut trials, or an empty band.
    """
    _check(dataset)
    _platform.spare_mappings()
    with _platform.x64():
        dataset = of_known_materials(dataset, trusted_band(dataset, band_hz), material)
    _check(dataset)
    dataset, filled = without_dropouts(dataset)
    dataset, replaced = without_spikes(dataset)
    with _platform.x64():
        dataset, band_hz, unsaid = as_filtered(dataset, band_hz)
    found = _with_every_trial_or_one_less(dataset, band_hz, effects, seed, progress)
    return replace(found, caveats=(*found.caveats, *filled, *replaced, *unsaid))


def _with_every_trial_or_one_less(
    dataset: Dataset,
    band_hz: tuple[float, float] | None,
    effects: Sequence[str] | None,
    seed: int,
    progress: Callable[[str], None],
) -> Tracing:
    """`trace` of checked trials: of all, without one spoiled, with two exchanged, or their columns read
    otherwise, if need be."""
    said = dataset.axes
    found = _trace(dataset, said, band_hz, effects, seed, progress)

    def tried() -> list[tuple[HeldOut, HeldOut]]:
        along = [(each.before, one.heldout) for each in found.slow[-1:] for one in each.candidates]
        steady = [(each.before, one.heldout) for each in found.search.rounds[-1:] for one in each.candidates]
        return along + steady

    def less_one() -> Tracing:
        one = spoiled(found.dataset, found.final, tried(), found.floor_nrmse)
        if one is None or _settled(found) == _CLOSED:
            return found
        progress(f"once more, without {one.file}")
        return _trace(without(dataset, one), said, band_hz, effects, seed, progress)

    fewer = less_one()
    if _settled(fewer) == _CLOSED:
        return fewer
    left = [found.final, *(after for _, after in tried())]
    if (pair := two_unlike(dataset, found.dataset, left, found.floor_nrmse)) is not None:
        progress(f"once more, {pair.first} and {pair.second} exchanged")
        again = _trace(exchanged(dataset, pair), said, band_hz, effects, seed, progress)
        if _settled(again) == _CLOSED or _clearer(again, fewer):
            return replace(again, caveats=(*again.caveats, str(pair)))
    if (reading := found.reading or _reading(found)) is not None:
        progress(f"once more, the columns of force read as {list(reading.axes)}")
        otherwise = read_as(dataset, reading.axes)
        again = _trace(otherwise, said, band_hz, effects, seed, progress)
        explained = again.verdict["verdict"] not in _OPEN
        if missing(again) < most_left(said, reading, explained) * missing(found):
            dataset, found = otherwise, again
            fewer = less_one()
    return fewer if _settled(fewer) > _settled(found) or _clearer(fewer, found) else found


def _clearer(again: Tracing, found: Tracing) -> bool:
    """Whether `again` leaves half or less of what `found` did beside noise, if that was more than noise."""
    return not near_floor(found) and missing(again) < _CLEARER**2 * missing(found)


def _settled(found: Tracing) -> int:
    """How far a tracing has come: 0 unexplained, 1 in part, `_CLOSED` where nothing more is to be looked for.
    A name that is ambiguous closes nothing while much is left."""
    word = found.verdict["verdict"]
    if word in _OPEN:
        return _OPEN.index(word)
    return 1 if word == "ambiguous" and not near_floor(found) else _CLOSED


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
    levels = as_levels(dataset)
    level, zeros = at_level(dataset, levels), zeros_known(dataset)
    turned = as_followed(as_turned(levels))
    columns = other_columns(turned, said)
    if BrokenTooth in kinds:
        turned = parted_at_breakage(turned)
    with _platform.x64():
        band = trusted_band(turned, band_hz)
        found, part = every_pass(turned, band, kinds, seed, progress)
        progress("testing what remains")
        teeth, orders = turned.tool.teeth, found.lines.orders
        before, after = (
            dependences(found.dataset, each, teeth, orders) for each in (found.before, found.after)
        )
        if _by_chance(found, before):
            found = without_names(found, once(found.dataset, band, (), (), seed, progress))
            after = before
        own = None
        if any(each.found and each.covariate == "spindle order" for each in after):
            own = own_teeth(found.dataset, found.lines, found.search, found.after)
        if own is not None:
            after = dependences(found.dataset, own.without, teeth, orders)
            before = before if found.kinds else after
        heard = heard_speeds(turned, found.dataset)
        return told(found, (before, after), zeros, (part, columns, level, heard), own)


def _by_chance(found: Pass, before: Sequence[Dependence]) -> bool:
    """Whether all that the names explain is how the force of a cutter scatters from trial to trial."""
    if found.dataset.tool.kind in LEVEL_KINDS or not found.kinds:
        return False
    if not only_scatter(found.search.base, before, found.floor_nrmse):
        return False
    return not followed(
        found.before, found.after, sum(kind.size(found.search.problem.tool) for kind in found.kinds)
    )


def save(tracing: Tracing, out: Path) -> None:
    """Write verdict.json, model.json, report.html and isolability.json into the folder `out`."""
    from mjx_cutting.tracing.report.page import render

    page = render(tracing)
    out.mkdir(parents=True, exist_ok=True)
    write_atomic(out / "verdict.json", json.dumps(tracing.verdict, indent=2, allow_nan=False) + "\n")
    write_atomic(
        out / "model.json",
        json.dumps(of_the_first(tracing.model).to_dict(), indent=2, allow_nan=False) + "\n",
    )
    write_atomic(out / "report.html", page)
    found = isolability(tracing.search)
    if found is not None:
        write_atomic(out / "isolability.json", json.dumps(found.to_dict(), indent=2) + "\n")


def _check(dataset: Dataset) -> None:
    cuts = sum(trial.kind == "cut" for trial in dataset.trials)
    if cuts < 2:
        raise ValueError(f"{cuts} cut trial; tracing holds out by trial and needs at least two")
