"""What repeats with the turns of a tool that is always engaged is told, though its speed is not known."""

from __future__ import annotations

import numpy as np
import pytest

from mjx_cutting.tracing.fitting.prediction import Prediction
from mjx_cutting.tracing.telling.dependence import dependences
from mjx_cutting.tracing.telling.repeats import turned
from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo, Trial

RATE_HZ, SECONDS = 500.0, 6.0
TIME = np.arange(int(RATE_HZ * SECONDS)) / RATE_HZ
SPEEDS = (9.3, 11.2, 13.1, 9.3)
LEVEL_N = np.array([-150.0, 400.0, -100.0])


def _left(added, seed: int = 0, rate_share: int = 1) -> tuple[Dataset, list[Prediction]]:
    """Levels of four cuts, and what `added(time, speed, index)` [T, 1 or 3] and noise leave of them; every
    `rate_share`-th sample."""
    generator, time = np.random.default_rng(seed), TIME[::rate_share]
    trials, found = [], []
    for index, speed in enumerate(SPEEDS):
        level = (1.0 + 0.1 * index) * LEVEL_N
        extra = np.asarray(added(time, speed, index)).reshape(len(time), -1)
        force = level + extra + generator.normal(size=(len(time), 3))
        trials.append(
            Trial(
                file=f"t{index}.csv", kind="cut", milling=None, spindle_speed_rev_s=speed,
                feed_speed_m_s=1e-4 * speed * (1 + index), radial_depth_m=1e-3, axial_width_m=1e-3,
                time_s=time, force_n=force,
            )
        )  # fmt: skip
        predicted = np.tile(level, (len(time), 1))
        angle = 2.0 * np.pi * speed * time
        found.append(Prediction(trials[-1].file, time, angle, force, predicted, speed, np.zeros(3)))
    sensor = Sensor(RATE_HZ / rate_share)
    tool = ToolInfo("turning", 1, 0.03)
    return Dataset(name="bar", tool=tool, sensor=sensor, trials=tuple(trials)), found


def _told(added, seed: int = 0, rate_share: int = 1) -> dict[str, str]:
    tests = dependences(*_left(added, seed, rate_share), teeth=1, orders=0)
    return {each.covariate: each.look_for for each in tests if each.found}


def _out_of_round(lobes: int, off: float = 0.004):
    """A bar of so many lobes that turns faster than stated, by a share of its own in each trial."""

    def added(time, speed, index):
        true = speed * (1.0 + off * (-1.0) ** index)
        return 0.05 * np.cos(lobes * 2.0 * np.pi * true * time + index)[:, None] * LEVEL_N

    return added


@pytest.mark.parametrize(
    ("lobes", "often"), [(1, "once a turn"), (3, "3 times a turn"), (7, "7 times a turn")]
)
def test_a_bar_out_of_round_is_told_with_its_lobes(lobes, often):
    told = _told(_out_of_round(lobes))
    assert often in told["spindle order"]
    # all axes vary as the force itself does
    assert "proportions of the cut's force" in told["another axis"]


def test_noise_does_not_repeat_with_the_turns():
    for seed in range(20):
        assert "spindle order" not in _told(lambda time, speed, index: 0.0 * time, seed)


def test_a_line_of_one_frequency_is_none_of_every_speed():
    """61 Hz are within reach of no multiple of any speed."""
    assert "spindle order" not in _told(lambda time, speed, index: 5.0 * np.cos(2.0 * np.pi * 61.0 * time))


def test_a_tie_that_is_not_the_cuts_may_be_crosstalk():
    told = _told(
        lambda time, speed, index: np.outer(5.0 * np.cos(2.0 * np.pi * 61.0 * time), [1.0, 1.0, 0.0])
    )
    assert "crosstalk" in told["another axis"]


def test_sampling_slower_than_two_a_turn_shows_no_turns():
    assert "spindle order" not in _told(_out_of_round(1), rate_share=50)


def test_the_speed_of_each_record_is_found():
    _, left = _left(_out_of_round(3, off=0.006))
    found, ways = turned(left, 4)
    assert ways > 0.0
    for index, (as_stated, each) in enumerate(zip(left, found, strict=True)):
        factor = each.angle_rad[-1] / as_stated.angle_rad[-1]
        assert factor == pytest.approx(1.0 + 0.006 * (-1.0) ** index, abs=5e-4)
