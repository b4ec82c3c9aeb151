"""A speed that swings within the turn, held against the motion integrated in time."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mjx_cutting.cutting.swing import ahead

pytestmark = pytest.mark.usefixtures("float64")

SPEED = 40.0
LINES = np.array([0.0, 0.02 - 0.05j, 0.0, -0.03 + 0.02j, 0.01j])


def deviation(angle_rad: float) -> float:
    """The speed's deviation, of 40 rev/s, at an angle, were it to answer at once."""
    order = np.arange(len(LINES))
    return float(np.sum(2.0 * (LINES * np.exp(1j * order * angle_rad)).real))


def turned(bandwidth_hz: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Angles [T], rad, of a spindle after it has settled, at times [T], s, and its mean speed, rev/s."""

    def rates(_: float, state: np.ndarray) -> list[float]:
        wanted = SPEED * deviation(state[0])
        speed = SPEED + (wanted if np.isinf(bandwidth_hz) else state[1])
        follows = 0.0 if np.isinf(bandwidth_hz) else 2.0 * np.pi * bandwidth_hz * (wanted - state[1])
        return [2.0 * np.pi * speed, follows]

    def whole(_: float, state: np.ndarray) -> float:
        return float(np.sin(0.5 * state[0]))

    found = solve_ivp(
        rates, (0.0, 1.0), [0.1, 0.0], rtol=1e-10, atol=1e-12, events=whole, dense_output=True, max_step=1e-3
    )
    begins = found.t_events[0][-11]
    ends = found.t_events[0][-1]
    time = np.linspace(begins, ends, 2001)
    return found.sol(time)[0], time - begins, 10.0 / (ends - begins)


@pytest.mark.parametrize(("bandwidth_hz", "within"), [(np.inf, 2e-6), (150.0, 4e-3)])
def test_the_tool_is_ahead_as_the_motion_in_time_has_it(bandwidth_hz, within):
    """Exactly where the speed answers at once; to second order in the deviation where it lags."""
    angle, time, mean = turned(bandwidth_hz)
    even = 2.0 * np.pi * mean * time
    order = np.arange(len(LINES))
    answer = np.ones(len(LINES)) if np.isinf(bandwidth_hz) else 1.0 / (1.0 + 1j * order * mean / bandwidth_hz)
    found = ahead(jnp.asarray(LINES * SPEED / mean), jnp.asarray(answer, complex))
    # where a turn begins is each one's own
    gained = angle - angle[0] - even
    offset = np.linspace(0.0, 2.0 * np.pi, 20001)
    start = offset[np.argmin(np.abs((offset + np.asarray(found.at(offset))) - angle[0] % (2.0 * np.pi)))]
    told = np.asarray(found.at(even + start)) - float(found.at(start))
    assert np.ptp(gained) > 0.05
    np.testing.assert_allclose(told, gained, atol=within + 2e-4)
    if np.isinf(bandwidth_hz):
        assert SPEED / mean - 1.0 == pytest.approx(float(found.excess), abs=1e-7)
        assert float(found.excess) > 1e-3


def test_its_rate_is_the_slope_of_it():
    found = ahead(jnp.asarray(LINES), jnp.ones(len(LINES), complex))
    angles = jnp.linspace(-3.0, 9.0, 301)
    slope = jax.vmap(jax.grad(lambda angle: found.at(angle)))(angles)
    step = 1e-5
    rise = (found.at(angles + step) - found.at(angles - step)) / (2.0 * step)
    np.testing.assert_allclose(slope, rise, atol=1e-6)
    np.testing.assert_allclose(found.at(angles), found.at(angles + 2.0 * np.pi), atol=1e-12)


def test_an_even_load_leaves_the_turn_even():
    found = ahead(jnp.asarray([0.3 + 0j, 0.0, 0.0]), jnp.ones(3, complex))
    np.testing.assert_array_equal(np.asarray(found.value), 0.0)
    assert float(found.excess) == 0.0
