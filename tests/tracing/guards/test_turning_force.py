"""A force that turns with the spindle is an unbalance only where it goes with the square of the speed, and a
runout only where its lines are those of a runout."""

from __future__ import annotations

import numpy as np
import pytest

from mjx_cutting.cutting import Cut, ForceModel, Material, Tool
from mjx_cutting.cutting.effects import RadialRunout, Unbalance
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.guards.turning_force import TurningForce
from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo, Trial

TEETH, DIAMETER_M, RATE_HZ, NOISE_N = 4, 0.016, 2500.0, 0.2
SPEEDS, CHIPS_M = (40.0, 60.0), (5e-5, 1e-4, 1.5e-4)
FLAT = TurningForce(np.array([1.5, 0.8, -0.6, 1.2]))
OFF_CENTRE = Unbalance(1.2e-5, 0.7)


def _slots(by_lines, *effects) -> Dataset:
    """Slots at two speeds and three feeds, of which nothing but the effects repeats once a turn."""
    model = ForceModel(
        Tool("end_mill", TEETH, DIAMETER_M), Material(4e7, 4e3, 1.5e7, 2e3, 4e6, 500.0), effects
    )
    generator, trials, time_s = np.random.default_rng(3), [], np.arange(2500) / RATE_HZ
    for speed in SPEEDS:
        for chip in CHIPS_M:
            feed = chip * TEETH * speed
            orders = int(0.499 * RATE_HZ / speed)
            cut = Cut(0.0, speed, feed, DIAMETER_M, 0.006, 0.0, np.pi)
            force = by_lines(model, cut, orders, time_s, len(trials))
            trials.append(
                Trial(
                    file=f"t{len(trials)}.csv",
                    kind="cut",
                    milling="slot",
                    spindle_speed_rev_s=speed,
                    feed_speed_m_s=feed,
                    radial_depth_m=DIAMETER_M,
                    axial_width_m=0.006,
                    time_s=time_s,
                    force_n=force + generator.normal(0.0, NOISE_N, force.shape),
                )
            )
    tool = ToolInfo("end_mill", TEETH, DIAMETER_M)
    return Dataset(name="slots", tool=tool, sensor=Sensor(RATE_HZ, (NOISE_N,) * 3), trials=tuple(trials))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "named"),
    [
        ((FLAT,), []),
        ((OFF_CENTRE,), ["unbalance"]),
        ((OFF_CENTRE, RadialRunout(3e-6, 0.4)), ["radial_runout", "unbalance"]),
    ],
    ids=["as large at any speed", "with the square of the speed", "beside runout"],
)
def test_a_force_that_turns_is_named_by_what_goes_with_it(by_lines, hidden, named):
    found = trace(_slots(by_lines, *hidden), effects=("unbalance", "radial_runout"))
    assert sorted(each["name"] for each in found.verdict["effects"]) == named
    if not named:
        tried = {each.kind.name: each.decision.reasons for each in found.search.rounds[0].candidates}
        for name in ("unbalance", "radial_runout"):
            assert any("as large at any speed" in why for why in tried[name])
