"""Depths count from the surface where the work goes by them, from the machine's zero where by that."""

from __future__ import annotations

import numpy as np
import pytest

from mjx_cutting.tracing.records.surface import surfaces_m
from mjx_cutting.trials.dataset import Trial

RATE_HZ, FEED_M_S = 250.0, 0.002
SURFACES_M = (2.0e-3, 3.1e-3, 2.6e-3, 4.0e-3)
AIR = 20


def _holes(counts_from: float, surfaces_m=SURFACES_M, measured: bool = True) -> list[Trial]:
    """Four holes of a drill that comes down; the work is harder between 4 and 7 mm below its surface
    (`counts_from` 1) or below the machine's zero (0)."""
    trials, generator = [], np.random.default_rng(0)
    time = np.arange(1500) / RATE_HZ
    for index, surface in enumerate(surfaces_m):
        place = FEED_M_S * time
        depth = place - counts_from * surface
        hard = 1.0 + 0.4 * ((depth > 4e-3) & (depth < 7e-3))
        force = np.zeros((len(time), 3))
        force[:, 2] = 200.0 * (1.0 + 0.2 * index) * hard * (place > surface) + generator.normal(
            0.0, 1.0, len(time)
        )
        position = np.stack([0 * place, 0 * place, 0.02 - place], axis=1)
        trials.append(
            Trial(
                file=f"t{index}.csv", kind="cut", milling=None, spindle_speed_rev_s=20.0,
                feed_speed_m_s=FEED_M_S, radial_depth_m=3e-3, axial_width_m=3e-3, time_s=time,
                force_n=force, position_m=position if measured else None,
            )
        )  # fmt: skip
    return trials


@pytest.mark.parametrize("measured", [True, False])
def test_depths_count_from_where_each_tool_touches(measured):
    found = surfaces_m(_holes(1.0, measured=measured), AIR)
    begins = 0.0 if not measured else -0.02
    np.testing.assert_allclose(list(found.values()), begins + np.array(SURFACES_M), atol=1e-4)


def test_a_place_that_the_machine_measured_stays_where_the_work_goes_by_it():
    assert surfaces_m(_holes(0.0), AIR) == {}


def test_holes_that_begin_at_one_height_or_in_the_work_are_left_as_they_are():
    assert surfaces_m(_holes(1.0, surfaces_m=4 * (2e-3,)), AIR) == {}
    assert surfaces_m(_holes(1.0, surfaces_m=(0.0, *SURFACES_M[1:])), AIR) == {}
