"""A tool whose centre moves within the turn: a circle once a turn is a runout, whatever the teeth are."""

import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.cutting import Cut, ForceModel, Material, Tool, order_lines
from mjx_cutting.cutting.effects.abstract import AbstractEffect
from mjx_cutting.cutting.effects.radial_runout import RadialRunout
from mjx_cutting.cutting.effects.unequal_pitch import UnequalPitch

OFFSET_M, ANGLE_RAD = 1.2e-5, 0.7
MATERIAL = Material(6e8, 2e4, 2e8, 1e4, 0.0, 0.0)


class Centre(AbstractEffect):
    name = "centre"
    stage = "chip"
    lines: jnp.ndarray

    def cutter(self, cutter, model):
        return cutter._replace(path=self.lines, even=False)


def circle(offset_m):
    """Lines of x = rho sin(th - lam), y = rho cos(th - lam)."""
    turn = 0.5 * offset_m * np.exp(-1j * ANGLE_RAD)
    return Centre(jnp.asarray([[-1j * turn, turn], [0.0, 0.0]]))


def lines_of(tool, *effects):
    cut = Cut.milling(
        "conventional",
        tool.diameter_m,
        angle_rad=0.3,
        spindle_speed_rev_s=19.0,
        feed_speed_m_s=0.012,
        radial_depth_m=1.5e-3,
        axial_width_m=1.6e-3,
    )
    return order_lines(ForceModel(tool, MATERIAL, effects), cut, orders=25, angles=960, arc_rad=0.5)


@pytest.mark.parametrize("teeth", [3, 20])
def test_a_centre_on_a_circle_once_a_turn_is_a_runout(teeth):
    tool = Tool("slitting_saw", teeth, 0.05, 0.0)
    errors = 0.03 * jnp.cos(2.1 * jnp.arange(teeth))
    for beside in ((), (UnequalPitch(errors - errors.mean()),)):
        on_path = lines_of(tool, *beside, circle(OFFSET_M))
        runout = lines_of(tool, *beside, RadialRunout(OFFSET_M, ANGLE_RAD))
        if beside:  # runout is counted from where the teeth should be, the circle from where they are
            np.testing.assert_allclose(on_path, runout, atol=0.02 * float(np.abs(runout).max()))
        else:
            np.testing.assert_allclose(on_path, runout, atol=1e-5 * float(np.abs(runout).max()))


def test_a_centre_that_follows_the_runout_leaves_even_chips():
    tool = Tool("slitting_saw", 20, 0.05, 0.0)
    both = lines_of(tool, RadialRunout(OFFSET_M, ANGLE_RAD), circle(-OFFSET_M))
    largest = float(np.abs(both).max())
    np.testing.assert_allclose(both[1:20], 0.0, atol=1e-5 * largest)
    # teeth that are not alike are let go smoothly where the chip begins, which an even cutter need not be
    np.testing.assert_allclose(both, lines_of(tool), atol=0.01 * largest)
