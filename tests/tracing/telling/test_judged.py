"""The errors that a verdict's word is chosen by: shares of thrust and torque, zeros of the trials' own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting.tracing import trace
from mjx_cutting.tracing.records.levels import zeros_known
from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo, Trial

RATE_HZ, NOISE = 500.0, 0.02
FEEDS_MM_S = (1.0, 2.0, 3.5, 1.4, 2.6, 4.5, 3.0)


def _holes(torque_of, zero=0.0, zeroed="trial") -> Dataset:
    """Seven holes by a sharp drill, noise 2 % of thrust and torque; the torque is multiplied by `torque_of`
    the time [T] and a random generator, zeros are off by a share `zero` of the force."""
    draw, time, trials = np.random.default_rng(5), np.arange(1500) / RATE_HZ, []
    for index, feed in enumerate(FEEDS_MM_S):
        thrust, torque = 200.0 + 100.0 * feed, 0.5 + 0.3 * feed
        off = zero * draw.normal(size=2)
        force = np.full((len(time), 3), np.nan)
        force[:, 2] = thrust + 450.0 * (off[0] + NOISE * draw.normal(size=len(time)))
        trials.append(
            Trial(
                file=f"{index}.csv",
                kind="cut",
                milling=None,
                spindle_speed_rev_s=12.0,
                feed_speed_m_s=1e-3 * feed,
                radial_depth_m=4e-3,
                axial_width_m=4e-3,
                tool_id="a",
                cut_length_before_m=0.01 * index,
                clock_start_s=60.0 * index,
                time_s=time,
                force_n=force,
                torque_nm=torque * torque_of(time, draw)
                + 1.25 * (off[1] + NOISE * draw.normal(size=len(time))),
            )
        )
    told = {"name": "holes", "source": "made by calculation", "licence": "Apache-2.0"}
    sensor = Sensor(RATE_HZ, None, zeroed=zeroed)
    return Dataset(**told, tool=ToolInfo("drill", 2, 8e-3), sensor=sensor, trials=tuple(trials))


def _steady(time, draw):
    return np.ones_like(time)


def _jams(time, draw):
    """Chips that jam and come free again, every half second or so."""
    freed = np.cumsum(draw.uniform(0.2, 0.8, 20))
    last = np.concatenate([[0.0], freed])[np.searchsorted(freed, time)]
    return 1.0 + 0.5 * (time - last)


def test_what_the_torque_alone_does_is_missing_though_the_thrust_is_larger_in_number():
    assert trace(_holes(_steady), effects=()).verdict["verdict"] == "nothing missing"
    said = trace(_holes(_jams), effects=()).verdict
    assert said["verdict"] == "unexplained"
    assert {"previous force", "time in trial"} & set(said["remaining"]["depends_on"])
    assert "each as a share of itself" in said["remaining"]["description"]


@pytest.mark.parametrize(("zeroed", "word"), [("trial", "nothing missing"), ("session", "unexplained")])
def test_a_level_that_each_trials_zero_may_be_is_nothing_missing(zeroed, word):
    found = trace(_holes(_steady, zero=0.07, zeroed=zeroed), effects=())
    assert found.verdict["verdict"] == word
    told = "zeroed before every trial" in found.verdict["remaining"]["description"]
    assert told == (zeroed == "trial") == any("which its zero may be" in each for each in found.caveats)


def test_a_level_far_off_is_no_zero():
    assert trace(_holes(_steady, zero=0.3), effects=()).verdict["verdict"] == "unexplained"


def test_the_zero_is_known_where_most_records_show_the_air():
    dataset = _holes(_steady)
    assert not zeros_known(dataset)
    assert zeros_known(replace(dataset, sensor=replace(dataset.sensor, zeroed="session")))
    air = np.arange(1500) < 200
    begun = []
    for trial in dataset.trials:
        noise = np.random.default_rng(1).normal(size=(1500, 2)) * [9.0, 0.025]
        force = trial.force_n.copy()
        force[air, 2] = noise[air, 0]
        torque = np.where(air, noise[:, 1], trial.torque_nm)
        begun.append(replace(trial, force_n=force, torque_nm=torque))
    assert zeros_known(replace(dataset, trials=tuple(begun)))
