"""Do the teeth differ by their gaps, or by something that is as large at any feed?

A gap of its own gives a tooth a share more or less of the feed, so its lines rise with that; all gaps but one
are free, and so many unknowns take in much of whatever a turn repeats. Teeth that each cut on a radius of
their own have lines of any shape as well, but flat in feed: they leave of unequal gaps at least the part of
their lines that differs from trial to trial. An unequal pitch passes only where they leave about as much.
"""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from mjx_cutting.cutting import ForceModel
from mjx_cutting.cutting.chip import Cutter
from mjx_cutting.cutting.effects import Parameter
from mjx_cutting.cutting.effects.radial_runout import TYPICAL_M
from mjx_cutting.cutting.effects.unequal_pitch import UnequalPitch
from mjx_cutting.tracing.guards.each_tooth import EachTooth
from mjx_cutting.tracing.guards.gain import Gain
from mjx_cutting.tracing.records.levels import LEVEL_KINDS

_TELLS = 0.02
_LEAST = 0.25


class UnevenRadii(EachTooth):
    """Every tooth on a radius of its own, of unknown cause.

    Fields: `offset_m` [N] of each tooth, m; their mean is removed.
    """

    name = "uneven_radii"
    stage = "chip"
    strength = "offset_m"
    parameters: ClassVar[dict[str, Parameter]] = {
        "offset_m": Parameter("m", -1e-3, 1e-3, 0.0, TYPICAL_M, per_tooth=True, source="no physics: fitted")
    }

    offset_m: ArrayLike

    def cutter(self, cutter: Cutter, model: ForceModel) -> Cutter:
        offset = jnp.asarray(self.offset_m)
        return cutter._replace(radius_m=cutter.radius_m + offset - offset.mean(), even=False)


def rather_at_any_feed(gain: Gain) -> str | None:
    """Why an unequal pitch is refused that teeth on radii of their own do as well as; None where they do not,
    or it is none, or the chips of the trials are all alike."""
    problem = gain.problem
    if gain.kind is not UnequalPitch or problem.tool.kind in LEVEL_KINDS:
        return None
    chip = np.asarray(problem.cut.feed_speed_m_s) / np.asarray(problem.cut.spindle_speed_rev_s)
    # of lines that rise with feed, what those that are flat in it cannot be
    differs = 1.0 - np.mean(chip) ** 2 / np.mean(chip**2)
    if differs < _TELLS:
        return None
    found = float(gain.found.squares)
    gained, flat = float(gain.before.squares) - found, gain.squares_with(UnevenRadii)
    if flat - found >= _LEAST * differs * gained:
        return None
    share = 1.0 - (flat - found) / gained
    return (
        f"teeth that differ by as much at any feed explain {share:.0%} of what unequal gaps do: they differ "
        "in another way"
    )
