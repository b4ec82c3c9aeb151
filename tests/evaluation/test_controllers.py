import dataclasses

import jax
import numpy as np
import pytest
from scipy import signal

from mjx_cutting.evaluation import controllers
from mjx_cutting.learning.policy import Policy, PolicyDescription

# A linear policy whose first action is a hundredth of the first observation.
GAIN = np.zeros((3, 2), np.float32)
GAIN[0, 0] = 0.01
LINEAR = Policy(
    mean=np.zeros(3, np.float32),
    std=np.full(3, 100.0, np.float32),
    layers=((100 * GAIN, np.zeros(2, np.float32)),),
    value_layers=None,
    activation="tanh",
    description=PolicyDescription.plain(3, 1, 0.02),
)


def run(controller, observations):
    memory = controller.begin(observations[0])
    act = jax.jit(controller.act)
    actions = []
    for observation in observations:
        memory, action = act(memory, observation)
        actions.append(action)
    return np.asarray(actions)


def test_direct_controller_is_the_policy():
    observations = np.random.default_rng(0).normal(size=(20, 4, 3)).astype(np.float32)
    np.testing.assert_allclose(
        run(controllers.direct(LINEAR), observations), LINEAR.apply(observations), atol=1e-7
    )


@pytest.mark.parametrize("order", [2, 4, 10])
def test_low_pass_is_the_butterworth_filter_of_scipy(order):
    observations = np.random.default_rng(0).normal(size=(200, 2, 3)).astype(np.float32)
    controller = controllers.low_passed(LINEAR, [0], order=order, corner_hz=5.0)
    sections = signal.butter(order, 5.0, fs=50.0, output="sos")
    start = signal.sosfilt_zi(sections)[:, :, None] * observations[0, :, 0]
    expected, _ = signal.sosfilt(sections, observations[:, :, 0], axis=0, zi=start)
    np.testing.assert_allclose(run(controller, observations)[:, :, 0], np.tanh(0.01 * expected), atol=2e-6)


def test_low_pass_leaves_other_entries_and_a_constant_alone():
    observations = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)
    plain = run(controllers.direct(LINEAR), observations)
    np.testing.assert_allclose(
        run(controllers.low_passed(LINEAR, [1, 2]), observations), plain, rtol=1e-6, atol=1e-7
    )
    still = np.full((50, 3), 0.7, np.float32)
    np.testing.assert_allclose(
        run(controllers.low_passed(LINEAR, [0]), still), run(controllers.direct(LINEAR), still), rtol=1e-6
    )


def test_paper_s_filter_delays_by_about_half_a_second():
    # Paper: a 10th-order 5 Hz Butterworth delays by about .5 s; .39 s at its peak by our computation.
    sections = signal.butter(10, 5.0, fs=50.0, output="sos")
    angle, delay = signal.group_delay(signal.sos2tf(sections), w=np.linspace(0.01, 0.9 * np.pi * 0.2, 400))
    assert delay.max() / 50.0 == pytest.approx(0.39, abs=0.1)
    assert angle[np.argmax(delay)] * 50 / (2 * np.pi) < 5.0


@pytest.mark.parametrize(("order", "corner"), [(3, 5.0), (12, 5.0), (4, 25.0), (4, 0.0)])
def test_filters_that_cannot_be_are_refused(order, corner):
    with pytest.raises(ValueError, match="expected an even order"):
        controllers.low_passed(LINEAR, [0], order=order, corner_hz=corner)


def test_constant_controller_ignores_what_it_sees():
    action = np.asarray([-0.3])
    controller = controllers.constant(action, LINEAR)
    out = run(controller, np.random.default_rng(0).normal(size=(5, 3)).astype(np.float32) * 1e3)
    np.testing.assert_allclose(out, -0.3, atol=1e-6)
    edge = controllers.constant(np.asarray([1.0]), LINEAR)
    np.testing.assert_allclose(run(edge, np.zeros((1, 3), np.float32)), 1.0, atol=1e-6)


def test_policies_of_different_environments_are_refused():
    other = dataclasses.replace(LINEAR, description=PolicyDescription.plain(3, 1, 0.01))
    with pytest.raises(ValueError, match="different observations"):
        controllers.comparable([controllers.direct(LINEAR), controllers.direct(other)])
