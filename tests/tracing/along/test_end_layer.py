"""A layer of less force at an end of the paths is one where it is even, the tool's way in where it fades."""

from __future__ import annotations

import numpy as np
import pytest

from mjx_cutting.cutting import effect_class
from mjx_cutting.tracing.along.end_layer import at_the_end, rather_a_slope
from mjx_cutting.tracing.records.course import Course

BORDER_M, LONGEST_M = 3e-3, 10e-3


def _courses(missing, from_the_end: bool) -> list[Course]:
    """Trials at three feeds whose force is short by `missing` (way in over that to the border)."""
    generator, found = np.random.default_rng(4), []
    for feed in (2e-3, 4e-3, 5e-3):
        time = np.arange(0.0, LONGEST_M / feed, 2e-3)
        place = feed * time
        wave = np.outer(1.0 + 0.5 * np.sin(2.0 * np.pi * 20.0 * time), [-20.0, 40.0, 5.0])
        way = (LONGEST_M - place if from_the_end else place) / BORDER_M
        left = -missing(way)[:, None] * wave
        left += generator.normal(0.0, 1.0, wave.shape) - left.mean(axis=0)
        found.append(
            Course(
                time_s=time,
                position_m=place,
                feed_share=None,
                chip_n=0.8 * wave,
                edge_n=0.2 * wave,
                left_n=left,
                rate_hz=500.0,
                band_hz=(0.0, 200.0),
            )
        )
    return found


@pytest.mark.parametrize("from_the_end", [False, True])
@pytest.mark.parametrize(
    ("missing", "word"),
    [
        (lambda way: 0.3 * (way < 1.0), ""),
        (lambda way: 0.9 * (way < 1.0), "last"),
        (lambda way: 0.6 * np.clip(1.0 - way, 0.0, 1.0), "last"),
        (lambda way: 1.0 - np.sqrt(np.clip(way, 0.0, 1.0)), "last"),
    ],
    ids=["even", "air", "fading", "as an arc fills"],
)
def test_a_layer_at_an_end_is_one_only_where_it_is_even(missing, word, from_the_end):
    layer = effect_class("layered_material")(
        change=-min(float(np.mean(missing(np.linspace(0.0, 1.0, 99)))), 1.0),
        start_m=LONGEST_M - BORDER_M if from_the_end else 0.0,
        length_m=BORDER_M,
    )
    why = at_the_end(_courses(missing, from_the_end), layer)
    assert (why == "") == (word == "")
    assert (word if from_the_end else word.replace("last", "first")) in why


@pytest.mark.parametrize(
    ("start_m", "length_m", "border_m", "refused"),
    [
        (-1e-3, 7e-3, 8e-3, True),
        (5e-3, 9e-3, 9e-3, True),
        (-1e-3, 7e-3, 1e-3, False),
        (3e-3, 4e-3, 3.5e-3, False),
    ],
    ids=["slope down", "slope up", "one border", "both borders"],
)
def test_a_border_as_wide_as_the_paths_is_a_slope(start_m, length_m, border_m, refused):
    layer = effect_class("layered_material")(-0.2, start_m, length_m, border_m)
    why = rather_a_slope(_courses(lambda way: 0.0 * way, False), layer)
    assert ("evenly with the place" in why) == refused and bool(why) == refused
