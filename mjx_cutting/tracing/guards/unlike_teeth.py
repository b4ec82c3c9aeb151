"""Do the teeth differ by their gaps or radii, or does each cut with more or less force as a whole?

Teeth that are not equally sharp, or set, each have a force larger or smaller by a share of its own. Of that
all gaps but one, free, take in most: with the chip a gap changes the force in proportion to the feed. But not
the force of its edge, and it shifts the tooth. Runout of two or three teeth takes in as much, and is as large
at any feed. Either is refused where shares of the teeth, no more unknowns, leave surely less.
"""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jax.typing import ArrayLike

from mjx_cutting.cutting import Cut, ForceModel
from mjx_cutting.cutting.chip import Chip
from mjx_cutting.cutting.effects import Parameter
from mjx_cutting.cutting.effects.abstract import EdgeForce
from mjx_cutting.cutting.effects.radial_runout import RadialRunout
from mjx_cutting.cutting.effects.unequal_pitch import UnequalPitch
from mjx_cutting.tracing.guards.each_tooth import EachTooth
from mjx_cutting.tracing.guards.gain import Gain
from mjx_cutting.tracing.records.levels import LEVEL_KINDS

_TYPICAL = 0.02
_SURELY = 12.0


class UnlikeTeeth(EachTooth):
    """Every tooth with a share more or less of force than the others, of unknown cause.

    Fields: `share` [N] of each tooth; their mean is removed.
    """

    name = "unlike_teeth"
    stage = "edge"
    strength = "share"
    evens_out: ClassVar[bool] = True
    parameters: ClassVar[dict[str, Parameter]] = {
        "share": Parameter("1", -1.0, 1.0, 0.0, _TYPICAL, per_tooth=True, source="no physics: fitted")
    }

    share: ArrayLike

    def edge(self, force: EdgeForce, chip: Chip, cut: Cut, model: ForceModel) -> EdgeForce:
        share = jnp.asarray(self.share)
        times = (1.0 + share - share.mean())[:, None]
        return EdgeForce(force.chip * times, force.edge * times)


def rather_teeth_apart(gain: Gain) -> str | None:
    """Why an unequal pitch, or the runout of few teeth, is refused where teeth that each have a force of
    their own leave surely less; None where they do not, or it is neither."""
    problem = gain.problem
    if gain.kind not in (UnequalPitch, RadialRunout) or problem.tool.kind in LEVEL_KINDS:
        return None
    if problem.tool.teeth - 1 > gain.kind.size(problem.tool):
        return None
    found, apart = float(gain.found.squares), gain.squares_with(UnlikeTeeth)
    spread = apart / max(int(problem.whitened.size) - len(gain.found.x), 1)
    if found - apart < _SURELY * spread:
        return None
    gained = float(gain.before.squares) - found
    ratio = (float(gain.before.squares) - apart) / max(gained, 1e-300)
    return (
        f"teeth that each have a share more or less of force than the others explain {ratio:.2f} times as "
        "much: they are not alike in another way"
    )
