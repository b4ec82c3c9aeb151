"""Of many orders those are followed that are heard; what is heard at any harmonic is."""

from __future__ import annotations

from dataclasses import replace

import jax
import numpy as np
import pytest

from mjx_cutting.tracing.records.followed import without_far_orders
from mjx_cutting.tracing.records.lines import compress
from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo, Trial

TEETH, RATE_HZ, SAMPLES, NOISE_N = 10, 2000.0, 4000, 0.5
BAND = (0.0, 1000.0)


def _session(lines: dict[int, float], seed: int = 0) -> Dataset:
    """Six trials whose force has the amplitudes, N, of the orders given."""
    generator, trials = np.random.default_rng(seed), []
    for index, speed in enumerate((12.0, 14.0, 16.5) * 2):
        time = np.arange(SAMPLES) / RATE_HZ
        wave = sum(size * np.cos(2.0 * np.pi * order * speed * time + order) for order, size in lines.items())
        force = np.asarray(wave)[:, None] * np.array([1.0, -0.7, 0.3])
        trials.append(
            Trial(
                file=f"t{index}.csv",
                kind="cut",
                milling="slot",
                spindle_speed_rev_s=speed,
                feed_speed_m_s=0.01,
                radial_depth_m=0.02,
                axial_width_m=1e-3,
                time_s=time,
                force_n=force + generator.normal(0.0, NOISE_N, (SAMPLES, 3)),
            )
        )
    tool, sensor = ToolInfo("end_mill", TEETH, 0.02), Sensor(RATE_HZ, (NOISE_N,) * 3, zeroed="trial")
    return Dataset(name="lines", tool=tool, sensor=sensor, trials=tuple(trials))


def _followed(lines: dict[int, float], seed: int = 0) -> np.ndarray:
    with jax.enable_x64(True):
        return np.flatnonzero(compress(_session(lines, seed), BAND).followed)


def test_orders_that_hold_noise_alone_are_not_followed():
    followed = _followed({10: 30.0, 20: 10.0, 30: 3.0})
    assert set(range(25)) <= set(followed) and 30 in followed
    assert len(followed) < 40


@pytest.mark.parametrize("order", [71, 88, 100])
def test_a_weak_line_at_a_high_harmonic_is_followed_with_those_of_its_kind_below(order):
    """.1 N beneath .5 N of noise: three standard errors in each of the six trials."""
    followed = _followed({10: 30.0, 20: 10.0, order: 0.1})
    apart = min(order % TEETH, -order % TEETH)
    alike = [n for n in range(25, order + 1) if min(n % TEETH, -n % TEETH) == apart]
    assert set(alike) <= set(followed)


def test_a_dead_channel_hides_nothing():
    """A weak line is heard alike whether the third axis, which shows least of it, is there or nil."""
    made = _session({10: 30.0, 88: 0.08})
    dead = tuple(replace(trial, force_n=trial.force_n * np.array([1.0, 1.0, 0.0])) for trial in made.trials)
    with jax.enable_x64(True):
        whole, part = (compress(each, BAND).followed for each in (made, replace(made, trials=dead)))
    np.testing.assert_array_equal(whole, part)


def test_what_is_not_followed_counts_as_noise_and_nothing_is_lost():
    dataset = _session({10: 30.0, 20: 10.0, 50: 1.0})
    with jax.enable_x64(True):
        lines = compress(dataset, BAND)
        again = compress(dataset, BAND, lines.speed_rev_s, like=lines)
    assert 50 <= lines.orders < 100 and not lines.followed.all()
    told = np.sum(lines.whitened**2, axis=1) + lines.rest_n2
    np.testing.assert_allclose(told, lines.energy_n2, rtol=1e-9)
    assert np.all(lines.present[:, np.repeat(~lines.followed[1:], 2).nonzero()[0] + 1] == 0.0)
    np.testing.assert_allclose(lines.noise_std_n(), NOISE_N, rtol=0.02)
    np.testing.assert_array_equal(again.followed, lines.followed)


def test_few_orders_are_all_followed():
    with jax.enable_x64(True):
        lines = compress(_session({10: 30.0}), (0.0, 120.0))
    assert lines.followed.all()


@pytest.mark.parametrize(("size", "highest"), [(0.0, 160), (3e-4, 160), (3e-2, 400)])
def test_orders_far_up_that_together_hold_next_to_nothing_are_not_followed(size, highest):
    """At orders 200 and 400, beside a force of one at order 40."""
    whitened, followed = np.zeros((2, 801, 3)), np.zeros(401, bool)
    followed[[0, 40, 160, 200, 400]] = True
    whitened[:, 2 * 40] = 1.0
    whitened[:, [2 * 200, 2 * 400]] = size
    energy_n2 = float(np.sum(whitened**2))
    kept = without_far_orders(followed, whitened, energy_n2, near=160)
    assert np.flatnonzero(kept).max() == highest
    np.testing.assert_array_equal(kept[:161], followed[:161])
