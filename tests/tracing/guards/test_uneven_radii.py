"""Teeth that differ by as much at any feed have no unequal pitch, however well that takes their lines."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from mjx_cutting import _platform
from mjx_cutting.cutting import Cut, ForceModel, Material, Tool
from mjx_cutting.cutting.effects import RadialRunout, UnequalPitch
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.guards.gain import Gain
from mjx_cutting.tracing.guards.uneven_radii import UnevenRadii, rather_at_any_feed
from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo, Trial

TEETH, DIAMETER_M, DEPTH_M, RATE_HZ, NOISE_N = 12, 0.08, 0.004, 2000.0, 0.3
SPEED, CHIPS_M = 12.0, (2e-5, 4e-5, 8e-5)
STEPS = np.random.default_rng(1).normal(size=TEETH)

squares_with = Gain.squares_with


def _sawn(by_lines, *effects) -> Dataset:
    """Cuts of a saw at three feeds, twice, of which nothing but the effects repeats once a turn."""
    tool = Tool("slitting_saw", TEETH, DIAMETER_M)
    model = ForceModel(tool, Material(8e8, 9e3, 3e8, 7e3, 5e7, 1e3), effects)
    generator, trials, time_s = np.random.default_rng(3), [], np.arange(3000) / RATE_HZ
    exit_rad = float(np.arccos(1.0 - 2.0 * DEPTH_M / DIAMETER_M))
    orders = int(0.45 * RATE_HZ / SPEED)
    for index, chip in enumerate(CHIPS_M * 2):
        feed = chip * TEETH * SPEED
        cut = Cut(0.0, SPEED, feed, DEPTH_M, 0.0015, 0.0, exit_rad)
        force = by_lines(model, cut, orders, time_s, index)
        trials.append(
            Trial(
                file=f"t{index}.csv",
                kind="cut",
                milling="conventional",
                spindle_speed_rev_s=SPEED,
                feed_speed_m_s=feed,
                radial_depth_m=DEPTH_M,
                axial_width_m=0.0015,
                time_s=time_s,
                force_n=force + generator.normal(0.0, NOISE_N, force.shape),
            )
        )
    sensor, told = Sensor(RATE_HZ, (NOISE_N,) * 3), ToolInfo("slitting_saw", TEETH, DIAMETER_M)
    return Dataset(name="saw", tool=told, sensor=sensor, trials=tuple(trials))


@pytest.mark.slow
def test_an_unequal_pitch_is_named(by_lines, monkeypatch):
    told = []
    monkeypatch.setattr(
        Gain, "squares_with", lambda gain, kind: told.append(kind) or squares_with(gain, kind)
    )
    found = trace(_sawn(by_lines, UnequalPitch(0.02 * STEPS)), effects=("unequal_pitch",))
    assert [each["name"] for each in found.verdict["effects"]] == ["unequal_pitch"]
    assert UnevenRadii in told


@pytest.mark.parametrize(
    ("kind", "chips_m", "flat", "refused"),
    [
        (UnequalPitch, (3e-5, 4.5e-5, 6e-5), 110.0, True),
        (UnequalPitch, (3e-5, 4.5e-5, 6e-5), 80.0, True),
        (UnequalPitch, (3e-5, 4.5e-5, 6e-5), 165.0, False),
        (UnequalPitch, (4.5e-5, 4.6e-5, 4.7e-5), 100.0, False),
        (RadialRunout, (3e-5, 4.5e-5, 6e-5), 80.0, False),
    ],
    ids=["as well", "better", "as lines that rise", "feeds alike", "runout"],
)
def test_teeth_that_differ_by_as_much_at_any_feed_have_no_unequal_pitch(kind, chips_m, flat, refused):
    """Unequal gaps take 1,000 to 100; of lines that rise so, flat ones leave 6.9 % of that, 62, at least."""
    speed = np.full(3, 12.0)
    cut = SimpleNamespace(feed_speed_m_s=np.array(chips_m) * TEETH * speed, spindle_speed_rev_s=speed)
    gain = SimpleNamespace(
        kind=kind,
        problem=SimpleNamespace(cut=cut, tool=SimpleNamespace(kind="slitting_saw")),
        before=SimpleNamespace(squares=1000.0),
        found=SimpleNamespace(squares=100.0),
        squares_with=lambda instead: flat,
    )
    why = rather_at_any_feed(gain)
    assert (why is not None) == refused
    assert why is None or "as much at any feed" in why


def test_teeth_on_radii_of_their_own_repeat_once_a_turn():
    """A mean offset is another diameter, and none of theirs."""
    tool = Tool("slitting_saw", TEETH, DIAMETER_M)
    model = ForceModel(tool, Material(8e8, 9e3, 3e8, 7e3, 5e7, 1e3))
    with _platform.x64():
        radii = [
            np.asarray(UnevenRadii(1e-6 * STEPS + mean).cutter(model.cutter(), model).radius_m)
            for mean in (0.0, 5e-6)
        ]
    np.testing.assert_allclose(radii[0], radii[1], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(np.ptp(radii[0]), 1e-6 * np.ptp(STEPS), rtol=1e-6)
