"""The zero of a record is read where its tool is in the air, if it is anywhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting.tracing.records.zero import zeros
from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo, Trial

RATE_HZ, SPEED_REV_S, TEETH = 2000.0, 13.7, 24
BIAS_N = np.array([-8.0, 1.5, 0.5])
NOISE_N = 0.26


def _record(begins_s: float, before: float, swing_n: float) -> Trial:
    """A cut that swings by `swing_n` about its mean from `begins_s` on, before that `before` of it."""
    time = np.arange(4000) / RATE_HZ
    share = np.where(time < begins_s, before, 1.0)[:, None]
    teeth = np.cos(2 * np.pi * TEETH * 1.003 * SPEED_REV_S * time)[:, None]
    force = share * (np.array([30.0, 28.0, -3.0]) + swing_n * teeth * np.array([1.0, 0.7, 0.2]))
    noise = NOISE_N * np.random.default_rng(0).normal(size=force.shape)
    return Trial(
        file="t.csv", kind="cut", milling="climb", spindle_speed_rev_s=SPEED_REV_S, feed_speed_m_s=0.01,
        radial_depth_m=0.002, axial_width_m=0.0016, time_s=time, force_n=BIAS_N + force + noise,
    )  # fmt: skip


def _zero(*trials: Trial, zeroed: str = "session") -> np.ndarray:
    tool = ToolInfo("slitting_saw", TEETH, 0.063)
    sensor = Sensor(RATE_HZ, zeroed=zeroed)
    return zeros(Dataset(name="one", tool=tool, sensor=sensor, trials=trials))["t.csv"]


@pytest.mark.parametrize("swing_n", [20.0, 0.6])
def test_the_zero_is_read_in_the_air_also_where_a_filter_leaves_hardly_any_swing(swing_n):
    # a hundredth of the force; of noise, three standard errors of a mean over a turn are half of that
    found = _zero(_record(0.3, before=0.0, swing_n=swing_n))
    np.testing.assert_allclose(found, BIAS_N, atol=0.01 * 41.0)


@pytest.mark.parametrize(("begins_s", "before"), [(0.0, 0.0), (0.3, 0.5)])
def test_a_record_that_is_all_in_the_cut_shows_no_zero(begins_s, before):
    """Also where a softer layer comes first: there its teeth are heard less, but they are heard."""
    np.testing.assert_array_equal(_zero(_record(begins_s, before, swing_n=0.6)), 0.0)


def test_a_tool_whose_teeth_cut_over_whole_pitches_as_it_enters_is_not_in_the_air():
    """Over one to one and a half pitches, on the way in: tooth passing goes through nil in the cut."""
    cut = _record(0.0, before=1.0, swing_n=0.0)
    pitches = np.interp(cut.time_s, [0.0, 0.8], [0.6, 1.5])
    teeth = np.cos(2 * np.pi * TEETH * SPEED_REV_S * cut.time_s)
    swing = 0.6 * np.outer(np.sin(np.pi * pitches) * teeth, [1.0, 0.7, 0.2])
    force = (pitches / 1.5)[:, None] * (cut.force_n - BIAS_N) + swing
    np.testing.assert_array_equal(_zero(replace(cut, force_n=BIAS_N + force)), 0.0)


def test_where_no_teeth_are_heard_at_all_no_zero_is_read():
    np.testing.assert_array_equal(_zero(_record(0.3, before=0.5, swing_n=0.0)), 0.0)


@pytest.mark.parametrize(("zeroed", "told"), [("session", True), ("trial", False)])
def test_cuts_in_air_tell_the_zero_of_a_session_to_records_that_do_not(zeroed, told):
    cut = _record(0.3, before=0.5, swing_n=0.0)
    air = replace(_record(2.0, before=0.0, swing_n=0.0), file="air.csv", kind="air", milling=None)
    np.testing.assert_allclose(_zero(cut, air, zeroed=zeroed), BIAS_N if told else 0.0, atol=0.02)
