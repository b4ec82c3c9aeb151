"""Tracing on the measured motion of the tool: the motion is read, cuts that are not steady are left out, and
runout that a compliant arm hides is found."""

from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting.cutting import Cut, ForceModel, Material, Tool, order_lines
from mjx_cutting.cutting.centre_motion import CentreMotion
from mjx_cutting.cutting.effects.radial_runout import RadialRunout
from mjx_cutting.tracing.fitting.measured_path import measured_motion, pose_on_path, steady_cuts
from mjx_cutting.tracing.records.line_gain import line_gain
from mjx_cutting.tracing.records.lines import compress
from mjx_cutting.tracing.trace import trace
from mjx_cutting.trials.dataset import AntiAlias, Dataset, Sensor, ToolInfo, Trial

SAW = ToolInfo("slitting_saw", 20, 0.05)
RATE_HZ, SPEED_REV_S = 500.0, 19.0
OFFSET_M, ANGLE_RAD, MASS_KG = 1.2e-5, 0.7, 1.5
AXES = ("-y", "+x", "+z")
MATERIAL = Material(4e7, 6e3, 1.5e7, 4e3, 0.0, 0.0)


def motion_lines(share: float, depth_m: float) -> np.ndarray:
    """The centre follows most of the runout, a little of it at the second order, and tooth passing."""
    lines = np.zeros((20, 3), complex)
    once = -0.5 * share * OFFSET_M * np.exp(-1j * ANGLE_RAD)
    lines[0] = -1j * once, once, 4e-6
    lines[1] = 1.5e-6 * (1.0 + depth_m / 1e-3), 5e-7j, 1e-6j
    lines[19] = 1e-6, 3e-7, 0.0
    return lines


def trial(feed_m_s: float, depth_m: float, seed: int, restless_m: float = 0.0) -> Trial:
    draw = np.random.default_rng(seed)
    time = np.arange(1500) / RATE_HZ
    angle = 2.0 * np.pi * SPEED_REV_S * time + draw.uniform(0.0, 2.0 * np.pi)
    lines = motion_lines(draw.uniform(0.6, 0.9), depth_m)
    cut = Cut.milling(
        "conventional", SAW.diameter_m, angle_rad=0.0, spindle_speed_rev_s=SPEED_REV_S,
        feed_speed_m_s=feed_m_s, radial_depth_m=depth_m, axial_width_m=1.6e-3,
    )  # fmt: skip
    model = ForceModel(
        Tool(SAW.kind, SAW.teeth, SAW.diameter_m), MATERIAL,
        (RadialRunout(OFFSET_M, ANGLE_RAD), CentreMotion(lines)),
    )  # fmt: skip
    force = np.array(order_lines(model, cut, orders=24, angles=960, arc_rad=0.5))
    rate = 2.0 * np.pi * SPEED_REV_S * np.arange(1, 21)
    force[1:21] += MASS_KG * rate[:, None] ** 2 * lines
    force *= line_gain(dataset().sensor, np.array([SPEED_REV_S]), 24)[0][:, None]
    turns = np.exp(1j * np.multiply.outer(angle, np.arange(25)))
    record = np.real(turns @ (force * np.where(np.arange(25) > 0, 2.0, 1.0)[:, None]))
    place = 2.0 * np.real(np.exp(1j * np.multiply.outer(angle, np.arange(1, 21))) @ lines)
    place += restless_m * draw.normal(size=place.shape)
    process = np.column_stack([place[:, 0] + feed_m_s * time, place[:, 1], place[:, 2]])
    columns = np.stack([-process[:, 1], process[:, 0], process[:, 2]], axis=1)
    return Trial(
        file=f"t{seed:02d}.csv", kind="cut", milling="conventional", spindle_speed_rev_s=SPEED_REV_S,
        feed_speed_m_s=feed_m_s, radial_depth_m=depth_m, axial_width_m=1.6e-3, time_s=time,
        force_n=record + draw.normal(size=record.shape) * 0.05, position_m=columns, spindle_angle_rad=angle,
    )  # fmt: skip


def dataset(*trials: Trial) -> Dataset:
    sensor = Sensor(RATE_HZ, (0.05, 0.05, 0.05), anti_alias=AntiAlias(order=4, hz=120.0))
    return Dataset(name="x", source="made", licence="none", tool=SAW, sensor=sensor, trials=trials, axes=AXES)


@pytest.fixture(scope="module")
def trials() -> list[Trial]:
    conditions = [(f, d) for f in (0.006, 0.012, 0.022) for d in (6e-4, 1.5e-3)]
    return [trial(feed, depth, seed) for seed, (feed, depth) in enumerate(conditions)]


def test_motion_is_read_beyond_half_the_sampling_rate(trials):
    """Order 20 is 380 Hz, sampled at 500 Hz; the columns are not in process axes."""
    draw = np.random.default_rng(0)
    draw.uniform(0.0, 2.0 * np.pi)
    expected = motion_lines(draw.uniform(0.6, 0.9), 6e-4)
    found = measured_motion(dataset(*trials))[0]
    np.testing.assert_allclose(found.lines[:20], expected, atol=1e-8)
    assert found.steady and found.unsteady_m < 1e-8


def test_no_motion_without_angle_or_with_a_tool_that_goes_straight(trials):
    assert measured_motion(dataset(*trials[:-1], replace(trials[-1], spindle_angle_rad=None))) == ()
    straight = [
        replace(t, position_m=np.column_stack([t.feed_speed_m_s * t.time_s] + [0 * t.time_s] * 2))
        for t in trials
    ]
    assert measured_motion(dataset(*straight)) == ()
    with pytest.raises(ValueError, match="expected position and spindle angle"):
        pose_on_path(dataset(*straight), compress(dataset(*straight), (0.0, 120.0)))


def test_cuts_that_are_not_steady_are_left_out(trials):
    wild = trial(0.012, 1e-3, 9, restless_m=5e-6)
    kept, on_path = steady_cuts(dataset(*trials, wild))
    assert on_path and [t.file for t in kept.trials] == [t.file for t in trials]
    assert kept.left_out[0].file == wild.file and "not steady" in kept.left_out[0].reason
    few = dataset(*trials[:2], wild)
    assert steady_cuts(few) == (few, False)


def test_noise_of_the_positions_is_no_motion(trials):
    draw = np.random.default_rng(1)
    noisy = [
        replace(
            t,
            position_m=np.column_stack([t.feed_speed_m_s * t.time_s] + [0 * t.time_s] * 2)
            + 2e-5 * draw.normal(size=(len(t.time_s), 3)),
        )
        for t in trials
    ]
    still = dataset(*noisy)
    assert steady_cuts(still) == (still, False)


@pytest.mark.slow
def test_runout_that_the_arm_follows_is_found(trials):
    found = trace(dataset(*trials), band_hz=(0.0, 120.0), effects=["radial_runout", "size_effect"])
    assert [each["name"] for each in found.verdict["effects"]] == ["radial_runout"]
    told = found.verdict["effects"][0]["parameters"]
    assert told["offset_m"]["value"] == pytest.approx(OFFSET_M, rel=0.03)
    assert told["angle_rad"]["value"] == pytest.approx(ANGLE_RAD, abs=0.05)
    assert found.verdict["after"]["heldout_nrmse"] < 0.5 * found.verdict["before"]["heldout_nrmse"]
    assert "measured motion" in found.caveats[-1] and f"{MASS_KG:.2g} kg" in found.caveats[-1]
