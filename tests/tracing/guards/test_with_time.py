"""A force that is multiplied as time goes by, or jumps, is neither wear nor drift; these still are named."""

from __future__ import annotations

import numpy as np
import pytest

from mjx_cutting.tracing import trace
from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo, Trial

RATE_HZ, SPEED, DEPTH_M, WIDTH_M, NOISE_N = 500.0, 20.0, 0.002, 0.002, 0.1
CHIP_N_M2, EDGE_N_M = np.array([9e8, 4e8, 3e8]), np.array([2e4, 1.5e4, 1e4])
WAY = np.array([-1.0, 1.0, -1.0])


def _turned(force_of) -> Dataset:
    """Fourteen cuts on a lathe, a minute apart, feeds 6 : 1, `force_of(chip, clock, length)` [3]."""
    generator, trials, length_m = np.random.default_rng(8), [], 0.0
    time = np.arange(1000) / RATE_HZ
    chips = 5e-5 * np.array([2, 1, 6, 3, 1, 2, 6, 1, 3, 2, 6, 3, 1, 6.0])
    for index, chip_m in enumerate(chips):
        clock_s = 60.0 * (index + 1)
        force = force_of(chip_m, clock_s, length_m) * WAY
        noisy = force + generator.normal(0.0, NOISE_N, (len(time), 3))
        trials.append(
            Trial(
                file=f"t{index:02d}.csv",
                kind="cut",
                milling=None,
                time_s=time,
                force_n=noisy,
                spindle_speed_rev_s=SPEED,
                feed_speed_m_s=chip_m * SPEED,
                radial_depth_m=DEPTH_M,
                axial_width_m=WIDTH_M,
                tool_id="a",
                cut_length_before_m=length_m,
                clock_start_s=clock_s,
            )
        )
        length_m += chip_m * SPEED * 60.0
    sensor = Sensor(RATE_HZ, (NOISE_N,) * 3, zeroed="session")
    return Dataset(name="made", tool=ToolInfo("turning", 1, 0.05), sensor=sensor, trials=tuple(trials))


def _sharp(chip_m):
    return DEPTH_M * (CHIP_N_M2 * chip_m + EDGE_N_M)


def _warming(chip_m, clock_s, length_m):
    """The transducer's gain grows by 9 %, half of it in five minutes."""
    return _sharp(chip_m) * (1.0 - 0.09 * np.expm1(-clock_s / 420.0))


def _wearing(chip_m, clock_s, length_m):
    return _sharp(chip_m) + DEPTH_M * 1e4 * np.array([0.6, 1.0, 0.4]) * length_m


def _creeping(chip_m, clock_s, length_m):
    return _sharp(chip_m) - 8.0 * np.array([1.0, 0.6, -0.8]) * np.expm1(-clock_s / 420.0)


def _chipped(chip_m, clock_s, length_m):
    """From the eighth cut on the force on the edge is half as large again."""
    return _sharp(chip_m) + 0.5 * DEPTH_M * EDGE_N_M * (clock_s > 450.0)


def _moved(chip_m, clock_s, length_m):
    """From the eighth cut on the sensor's zero is another."""
    return _sharp(chip_m) + np.array([5.0, 3.0, 2.0]) * (clock_s > 450.0)


def _harder(chip_m, clock_s, length_m):
    """From the tenth cut on the bar is of another batch."""
    return _sharp(chip_m) * (1.0 + 0.08 * (clock_s > 570.0))


MULTIPLIED = "a factor on all of the force that grows with the clock leaves"


@pytest.mark.parametrize(
    ("force_of", "named", "why", "told"),
    [
        (_wearing, ["flank_wear"], "", ""),
        (_creeping, ["thermal_drift"], "", ""),
        (_warming, [], MULTIPLIED, "clock time"),
        (_chipped, [], "a step of the zero or of the edge at 451 s of the clock leaves", "clock time"),
        (_moved, [], "a step of the zero or of the edge at 451 s of the clock leaves", "clock time"),
        (_harder, [], "a step of the gain at 571 s of the clock leaves", "feed"),
    ],
    ids=["wear", "drift", "gain", "chipped edge", "moved zero", "another batch"],
)
def test_what_multiplies_the_force_or_jumps_is_neither_wear_nor_drift(force_of, named, why, told):
    found = trace(_turned(force_of), effects=("flank_wear", "thermal_drift"))
    assert [each["name"] for each in found.verdict["effects"]] == named
    if not named:
        assert found.verdict["verdict"] == "unexplained"
        reasons = [each.decision.reasons for each in found.search.rounds[0].candidates]
        assert any(why in reason for each in reasons for reason in each), reasons
        assert told in found.verdict["remaining"]["depends_on"]
