"""Where a drill or a turning tool is in full engagement."""

from __future__ import annotations

import numpy as np
import pytest

from mjx_cutting.tracing.records.steady import steady

SAMPLES = 2000
TIME = np.arange(SAMPLES) / SAMPLES


def _record(share: np.ndarray, seed: int = 0) -> np.ndarray:
    """[T, 3] torque and thrust at a share [T] of those of the cut, with noise of half a per cent."""
    noise = np.random.default_rng(seed).normal(0.0, 0.005, (SAMPLES, 3))
    return (share[:, None] + noise) * [0.0, 2.0, 400.0]


@pytest.mark.parametrize("bend", [0.35, 0.6, 0.75])
@pytest.mark.parametrize("backwards", [False, True])
def test_a_ramp_longer_than_what_follows_is_left_out(bend, backwards):
    """In the air up to .15, over the point of the drill up to the bend, then at a level to .95."""
    share = np.clip((TIME - 0.15) / (bend - 0.15), 0.0, 1.0) * (TIME < 0.95)
    record = _record(share)
    part = steady(record[::-1] if backwards else record)
    first, last = (SAMPLES - part.stop, SAMPLES - part.start) if backwards else (part.start, part.stop)
    assert bend * SAMPLES - 2 <= first <= (bend + 0.1) * SAMPLES
    assert 0.8 * SAMPLES < last <= 0.95 * SAMPLES


@pytest.mark.parametrize(("bend", "leaves"), [(0.3, 0.6), (0.45, 0.6), (0.2, 0.5)])
def test_ramps_at_both_ends_are_left_out(bend, leaves):
    """Into a plate over the point of the drill, and out of it: at a low feed hardly anything is level."""
    share = np.clip((TIME - 0.1) / (bend - 0.1), 0.0, 1.0) * np.clip(
        (0.95 - TIME) / (0.95 - leaves), 0.0, 1.0
    )
    part = steady(_record(share))
    assert bend * SAMPLES <= part.start <= (bend + 0.06) * SAMPLES
    assert (leaves - 0.06) * SAMPLES <= part.stop <= leaves * SAMPLES


def test_a_force_that_grows_along_the_hole_is_no_ramp():
    inside = (TIME > 0.1) & (TIME < 0.9)
    part = steady(_record((0.7 + 0.4 * TIME) * inside))
    assert (part.start, part.stop) == (
        pytest.approx(0.18 * SAMPLES, abs=2),
        pytest.approx(0.82 * SAMPLES, abs=2),
    )


def test_a_step_up_within_the_cut_is_no_ramp():
    """As where the bar is harder from some place on: both halves are the cut."""
    part = steady(_record(np.where(TIME < 0.5, 1.0, 1.3)))
    assert part == slice(0, SAMPLES)


def test_a_record_with_hardly_a_sample_in_the_cut_is_kept_whole():
    share = np.zeros(SAMPLES)
    share[7] = 1.0
    assert steady(_record(share)) == slice(None)
