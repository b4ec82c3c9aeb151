"""One small cutting environment with a disturbance on the observation, and rollouts in it, made once."""

import numpy as np
import pytest

from mjx_cutting.disturbance import PeriodicPosterior
from mjx_cutting.evaluation import controllers, rollouts
from mjx_cutting.learning import networks
from mjx_cutting.learning.environment import describe
from mjx_cutting.learning.policy import Policy
from mjx_cutting.sim import CuttingEnv, EnvConfig
from mjx_cutting.sim.baseline import baseline_action

FORCE = (7, 8, 9)


def make_policy(env, seed=0):
    import jax

    net = networks.make_networks(15, 5, (8,), (8,), "tanh")
    layers = networks.to_layers(net.policy_network.init(jax.random.PRNGKey(seed)))
    return Policy(
        mean=np.zeros(15, np.float32),
        std=np.ones(15, np.float32),
        layers=layers,
        value_layers=None,
        activation="tanh",
        description=describe(env),
    )


@pytest.fixture(scope="session")
def env():
    # A constant disturbance of 3 N along the feed plus 2 N that turns with 4 Hz, the same function every
    # time.
    mean = np.zeros((3, 3))
    mean[0, 0], mean[1, 1] = 3.0, 2.0
    posterior = PeriodicPosterior.build(mean, np.zeros((3, 3, 3)), np.zeros((3, 3, 3)), np.zeros(3), 4.0)
    config = EnvConfig(
        approach_m=0.005,
        cut_m=0.02,
        disturbance_mode="observation",
        disturbance_draw="mean",
        disturbance_in_air=True,
        max_episode_s=4.0,
    )
    return CuttingEnv(config, disturbance=posterior)


@pytest.fixture(scope="session")
def policy(env):
    return make_policy(env)


@pytest.fixture(scope="session")
def rolled(env, policy):
    acting = {
        "baseline": controllers.constant(baseline_action(env.config), policy),
        "policy": controllers.direct(policy),
        "again": controllers.direct(policy),
        "clean": controllers.direct(policy, clean=True),
        "low_pass": controllers.low_passed(policy, FORCE),
    }
    return rollouts.roll_out(env, acting, rollouts=6, seed=3)
