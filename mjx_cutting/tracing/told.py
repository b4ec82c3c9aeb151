"""What tracing tells of what it found: the verdict, what is left and on what it depends, what limits it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mjx_cutting.cutting.effects.tool_gravity import ToolGravity
from mjx_cutting.tracing.fitting.tooth_path import on_true_path
from mjx_cutting.tracing.passes import Pass, for_use
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.noise import noise_in_shares
from mjx_cutting.tracing.telling.above_band import above_band
from mjx_cutting.tracing.telling.axes import Reading, better_reading
from mjx_cutting.tracing.telling.comes_back import comes_back
from mjx_cutting.tracing.telling.dependence import Dependence
from mjx_cutting.tracing.telling.evidence import evidence
from mjx_cutting.tracing.telling.growing_noise import growing_noise
from mjx_cutting.tracing.telling.judged import Judged, in_shares, judged
from mjx_cutting.tracing.telling.own_constants import own_constants
from mjx_cutting.tracing.telling.own_teeth import OwnTeeth
from mjx_cutting.tracing.telling.unlike_chips import unlike_chips
from mjx_cutting.tracing.telling.unnamed import Unnamed, unnamed_factor
from mjx_cutting.tracing.telling.verdict import verdict
from mjx_cutting.tracing.telling.zero_in_air import zero_in_air


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


def told(
    found: Pass,
    depends: tuple[tuple[Dependence, ...], tuple[Dependence, ...]],
    zeros_known: bool,
    others: Sequence[object | None],
    own: OwnTeeth | None = None,
) -> Tracing:
    """What was found, told (call it in float64).

    Arguments:
        depends: what the residuals without and with what was found depend on.
        zeros_known: whether the zeros of the records are.
        others: what else limits the conclusions and was seen on the way, to be written as it is.
        own: shares of force of the teeth's own, which `depends` leaves out of account.
    """
    depends_before, depends_after = depends
    band = found.lines.band_hz
    reading = better_reading(found.dataset, found.lines, found.search.problem, found.final.nrmse)
    reasons = {
        kind.name: [
            *evidence(kind, found.dataset, found.before, found.after),
            *found.evidence.get(kind.name, ()),
        ]
        for kind in found.kinds
    }
    grown = None
    if found.dataset.tool.kind not in LEVEL_KINDS:
        grown = growing_noise(found.after, found.dataset.sensor.sample_rate_hz, band)
    by = _judged(found, zeros_known, grown)
    if own is not None:
        by = by.less(own.share, everywhere=not found.kinds)
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
    unnamed = None if found.along else unnamed_factor(found.search, found.lines, depends_after)
    if unnamed is not None:
        found = replace(found, model=for_use(found.dataset, unnamed.model))
    limits = (
        reading,
        unnamed,
        above_band(found.dataset, found.model, band),
        zero_in_air(found.dataset, found.model),
        by.zeros,
        comes_back(found.dataset, found.after),
        *others,
    )
    grows = None if grown is None else f"what is left is noise that grows with the force: {grown:.1%} of it"
    remarks = [str(each) for each in (own, grows, by.chips, by.by_axis, *limits) if each is not None]
    word["remaining"]["description"] = "; ".join([word["remaining"]["description"], *remarks])
    return Tracing(
        **vars(found),
        depends_before=depends_before,
        depends_after=depends_after,
        verdict=word,
        unnamed=unnamed,
        caveats=_caveats(found, limits),
        reading=reading,
    )


def _judged(found: Pass, known: bool, grown: float | None) -> Judged:
    """The errors by which the word of the verdict is chosen; `known` whether the trials' zeros are."""
    kind, floor, left = found.dataset.tool.kind, found.floor_nrmse, found.after
    if kind == "drill":
        floor = found.noise_over * noise_in_shares(found.dataset, found.lines)
        left = in_shares(left)
    noise = max(floor, grown or 0.0)
    between = unlike_chips(left, noise, found.dataset.sensor.sample_rate_hz, found.lines.band_hz)
    errors, models = (found.search.base, found.final), (found.before, found.after)
    return judged(kind, known, errors, models, noise, between)


def _caveats(found: Pass, limits: Sequence[object | None]) -> tuple[str, ...]:
    caveats = [str(each) for each in limits if each is not None]
    if (materials := own_constants(found.dataset, found.search.final_fit.model)) is not None:
        caveats.append(materials)
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
