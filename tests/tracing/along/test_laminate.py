"""Layers of other materials: each direction of the force changes by a share of its own."""

from __future__ import annotations

import numpy as np
import pytest

from mjx_cutting.tracing.along.layers import borders_on
from mjx_cutting.tracing.along.slow import search_slow
from mjx_cutting.tracing.along.slow_kinds import kind_of
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.records.course import Course

RATE_HZ, SECONDS, NOISE_N = 500.0, 4.0, 0.1
FEEDS = (0.008, 0.010, 0.0125, 0.015, 0.018, 0.02)
LAYERS = ((0.008, 0.016, 0.5, (1.0, 0.3)), (0.020, 0.026, -0.3, (-0.5, 1.0)))


def _laminate(
    shares_of, border_power=(1.0, 1.0, 1.0), border_m=2e-5, lips=None
) -> tuple[tuple[Course, ...], HeldOut]:
    """Six cuts; of tangential and radial force, `shares_of` makes what each layer adds; of a drill `lips` are
    the powers that its point would have of a border."""
    time = np.arange(int(RATE_HZ * SECONDS)) / RATE_HZ
    found = []
    for index, feed in enumerate(FEEDS):
        place = feed * time
        angle = 2.0 * np.pi * 20.0 * time + index
        turned = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
        parts = np.zeros((len(time), 3, 3))
        parts[..., 0] = np.array([3.0, 8.0, 0.0]) + turned
        parts[..., 1] = np.array([5.0, -2.0, 0.0]) + np.roll(turned, 1, axis=1) * [1.0, 1.0, 0.0]
        parts[..., 2] = [0.0, 0.0, 2.0]
        left = NOISE_N * np.random.default_rng(index).normal(size=(len(time), 3))
        for start, end, change, share in LAYERS:
            ways = [np.clip(0.5 + (place - at) / border_m, 0.0, 1.0)[:, None] for at in (start, end)]
            inside = ways[0] ** np.array(border_power) - ways[1] ** np.array(border_power)
            by_direction = change * np.array([*shares_of(share), 1.0])
            left += np.einsum("ta,tad,d->ta", inside, parts, by_direction)
        chip = 0.8 * parts.sum(axis=-1)
        course = Course(
            time, place, None, chip, 0.25 * chip, left - left.mean(axis=0), RATE_HZ, (0.0, 200.0),
            by_direction=lambda parts=parts: parts, border_power=lips or border_power,
        )  # fmt: skip
        found.append(course)
    error = np.stack([np.sum(each.left_n**2, axis=0) for each in found])
    energy = np.stack([np.sum((1.25 * each.chip_n + each.left_n) ** 2, axis=0) for each in found])
    return tuple(found), HeldOut(error, energy, None, np.arange(len(FEEDS)))


def _layers(trials, before):
    rounds = search_slow(trials, before, np.full(3, 1.0 / NOISE_N), ["layered_material"])
    found = [each.accepted for each in rounds if each.accepted is not None]
    return sorted(found, key=lambda each: float(each.effect.values()["start_m"])), rounds


def test_layers_that_change_each_direction_by_its_own_are_told_so():
    found, _ = _layers(*_laminate(lambda share: share))
    assert len(found) == len(LAYERS)
    for each, (start, end, change, share) in zip(found, LAYERS, strict=True):
        values = each.effect.values()
        assert float(values["start_m"]) == pytest.approx(start, abs=2e-4)
        assert float(values["start_m"] + values["length_m"]) == pytest.approx(end, abs=2e-4)
        assert float(values["change"]) == pytest.approx(change, rel=0.08)
        np.testing.assert_allclose(values["direction_share"][:2], share, atol=0.08)
    noise = NOISE_N * np.sqrt(3.0 * RATE_HZ * SECONDS * len(FEEDS))
    assert np.sqrt(found[-1].heldout.error_n2.sum()) < 1.5 * noise


def test_layers_that_change_all_alike_are_told_as_such():
    found, _ = _layers(*_laminate(lambda share: (1.0, 1.0)))
    assert len(found) == len(LAYERS)
    assert all(np.all(np.asarray(each.effect.values()["direction_share"]) == 1.0) for each in found)


def test_borders_follow_the_power_of_each_axis():
    """A drill's point: along the axis of the torque the force comes with the square of the way."""
    squared, _ = _layers(*_laminate(lambda share: (1.0, 1.0), (1.0, 2.0, 1.0), 0.002))
    assert len(squared) == len(LAYERS)
    assert all(float(each.effect.values()["border_m"]) == pytest.approx(0.002, rel=0.1) for each in squared)
    assert all(float(each.effect.values()["torque_power"]) == 2.0 for each in squared)


def test_layers_that_blend_are_told_where_a_drills_torque_comes_with_its_thrust():
    blended, _ = _layers(*_laminate(lambda share: (1.0, 1.0), (1.0, 1.0, 1.0), 0.002, (1.0, 2.0, 1.0)))
    assert len(blended) == len(LAYERS)
    for each, (start, end, _, _) in zip(blended, LAYERS, strict=True):
        values = each.effect.values()
        assert (float(values["torque_power"]), float(values["border_m"])) == pytest.approx(
            (1.0, 0.002), rel=0.1
        )
        assert float(values["start_m"]) == pytest.approx(start, abs=2e-4)
        assert float(values["start_m"] + values["length_m"]) == pytest.approx(end, abs=2e-4)


@pytest.mark.parametrize(("border_m", "borders"), [(2e-5, False), (1.2e-3, True)])
def test_a_layer_borders_on_another_within_the_width_of_their_borders(border_m, borders):
    one, other = np.array([0.0134, 0.002, 2e-5]), np.array([0.0092, 0.0035, border_m])
    assert borders_on(one, [other]) == borders
    assert borders_on(other, [one]) == borders


def test_a_laminate_read_from_a_model_makes_the_force_it_was_found_with():
    trials, before = _laminate(lambda share: share)
    found, _ = _layers(trials, before)
    for each in found:
        kind = kind_of(each.effect)
        shape, c = kind.parts(each.effect)
        for course, whole in zip(trials, each.whole_n, strict=True):
            np.testing.assert_allclose(kind.columns(course, shape) @ c, whole, atol=1e-9)
