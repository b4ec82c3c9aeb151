"""Every guard, in the order in which they are asked about an effect that has passed the tests."""

from __future__ import annotations

from mjx_cutting.tracing.guards.gain import Gain
from mjx_cutting.tracing.guards.gain_with_time import rather_multiplied
from mjx_cutting.tracing.guards.level_with_speed import rather_with_speed
from mjx_cutting.tracing.guards.line_by_line import rather_by_line
from mjx_cutting.tracing.guards.own_gain import rather_a_factor
from mjx_cutting.tracing.guards.own_law import rather_their_law
from mjx_cutting.tracing.guards.share_of_lines import rather_unlike
from mjx_cutting.tracing.guards.smeared import rather_smeared
from mjx_cutting.tracing.guards.sudden import rather_sudden
from mjx_cutting.tracing.guards.turning_force import rather_at_any_speed
from mjx_cutting.tracing.guards.uneven_radii import rather_at_any_feed
from mjx_cutting.tracing.guards.unlike_teeth import rather_teeth_apart
from mjx_cutting.tracing.guards.within_a_sample import rather_the_reading

GUARDS = (
    rather_a_factor,
    rather_smeared,
    rather_the_reading,
    rather_by_line,
    rather_unlike,
    rather_their_law,
    rather_with_speed,
    rather_at_any_speed,
    rather_multiplied,
    rather_sudden,
    rather_at_any_feed,
    rather_teeth_apart,
)


def refusal(gain: Gain) -> str | None:
    """Why the effect is refused, by the first guard that does; None where none does."""
    return next((why for guard in GUARDS if (why := guard(gain)) is not None), None)
