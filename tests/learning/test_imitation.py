import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brax.training.agents.bc import losses as bc_losses
from brax.training.agents.bc import networks as bc_networks

from mjx_cutting import _platform
from mjx_cutting.learning import networks
from mjx_cutting.learning.imitation import buffer
from mjx_cutting.learning.imitation.aggregation import Aggregation
from mjx_cutting.learning.imitation.schedule import Constant, Linear
from mjx_cutting.learning.policy import Policy, PolicyDescription
from mjx_cutting.learning.settings import ImitationConfig

# The optimal feedback of the point environment, as a linear policy: tanh(mu), mu = -1.34 x.
GAIN = np.asarray([[-1.34, 0, 0, 0], [0, -1.34, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]], np.float32).T
EXPERT = Policy(
    mean=np.zeros(4, np.float32),
    std=np.asarray([1, 1, 5, 5], np.float32),
    layers=((GAIN, np.zeros(4, np.float32)),),
    value_layers=None,
    activation="tanh",
    description=PolicyDescription.plain(4, 2, 0.02),
)
FORCE_GAIN = np.zeros((4, 4), np.float32)
FORCE_GAIN[2, 0] = FORCE_GAIN[3, 1] = -1.34
# The same feedback on a clean observation, but read from the force.
FORCE_EXPERT = dataclasses.replace(EXPERT, layers=((FORCE_GAIN, np.zeros(4, np.float32)),))
BLANK = dataclasses.replace(EXPERT, layers=((np.zeros((4, 4), np.float32), np.zeros(4, np.float32)),))


def imitate(env, schedule, config, start=None, seed=0, expert=EXPERT):
    algorithm = Aggregation(env, expert, schedule, config, env.config.max_episode_steps)
    state = algorithm.initialise(jax.random.PRNGKey(seed), start)
    iterate = _platform.jit(algorithm.iterate)
    history = []
    for _ in range(config.rounds):
        state, metrics = iterate(state)
        history.append({k: np.asarray(v) for k, v in metrics.items()})
    learner = dataclasses.replace(expert, **algorithm.policy_arrays(state))
    return state, learner, history


def test_beta_table_of_dagger():
    schedule = Linear(45)
    beta = np.asarray([float(schedule(i)) for i in range(50)])
    np.testing.assert_allclose(beta[[0, 1, 9, 22, 44]], [1, 44 / 45, 0.8, 23 / 45, 1 / 45], rtol=1e-6)
    np.testing.assert_array_equal(beta[45:], 0.0)
    np.testing.assert_allclose(np.diff(beta[:46]), -1 / 45, rtol=1e-4)


def test_beta_of_cloning_is_one():
    np.testing.assert_array_equal(jax.vmap(Constant(1.0))(jnp.arange(50)), 1.0)


@pytest.mark.parametrize("make", [lambda: Constant(1.5), lambda: Constant(-0.1), lambda: Linear(0)])
def test_schedules_out_of_range_are_refused(make):
    with pytest.raises(ValueError, match="expected"):
        make()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("rounds", 0),
        ("batch", 0),
        ("learning_rate", 0.0),
        ("capacity", 3),
        ("learner_observation", "x"),
        ("update", "y"),
    ],
)
def test_settings_out_of_range_are_refused(name, value):
    with pytest.raises(ValueError, match=rf"got {name}="):
        ImitationConfig(**{name: value})


def test_buffer_writes_masked_rows_and_overwrites_the_oldest():
    data = buffer.empty(5, 1, 1)
    append = jax.jit(buffer.append)
    for step in range(3):
        rows = jnp.asarray([[10 * step + i] for i in range(3)], jnp.float32)
        data = append(data, rows, -rows, jnp.asarray([True, False, True]))
    # written 0, 2, 10, 12, 20, 22; room for five
    np.testing.assert_array_equal(data.observation[:, 0], [22, 2, 10, 12, 20])
    np.testing.assert_array_equal(data.label, -data.observation)
    assert int(data.written) == 6
    assert int(data.size) == 5


def test_sample_draws_written_rows_only_and_evenly():
    data = buffer.empty(100, 1, 1)
    rows = jnp.arange(1.0, 5.0)[:, None]
    data = buffer.append(data, rows, 2 * rows, jnp.ones(4, bool))
    observation, label = buffer.sample(data, jax.random.PRNGKey(0), 4000)
    values, counts = np.unique(observation, return_counts=True)
    np.testing.assert_array_equal(values, [1, 2, 3, 4])
    assert np.all(np.abs(counts - 1000) < 120)
    np.testing.assert_array_equal(label, 2 * observation)


def test_gradient_of_the_loss_by_hand():
    # One observation o, mu = w o + b, label tanh(m): L = (tanh(mu) - tanh(m))^2,
    # dL/dw = 2 (tanh mu - tanh m) (1 - tanh^2 mu) o, and the scale head has no gradient.
    net = networks.make_networks(1, 1, (), (), "tanh")
    params = networks.to_tree(((np.asarray([[0.7, 0.3]], np.float32), np.asarray([0.1, 0.2], np.float32)),))
    loss = functools.partial(bc_losses.bc_loss, make_policy=bc_networks.make_inference_fn(net))
    data = {"observations": jnp.asarray([[1.5]]), "teacher_action_extras": {"loc": jnp.asarray([[-0.4]])}}
    (value, _), gradient = jax.value_and_grad(loss, has_aux=True)(
        params, networks.initial_normalizer(1), data
    )
    y, m = np.tanh(0.7 * 1.5 + 0.1), np.tanh(-0.4)
    slope = 2 * (y - m) * (1 - y**2)
    assert float(value) == pytest.approx((y - m) ** 2, rel=1e-6)
    np.testing.assert_allclose(gradient["params"]["hidden_0"]["kernel"], [[slope * 1.5, 0]], rtol=1e-5)
    np.testing.assert_allclose(gradient["params"]["hidden_0"]["bias"], [slope, 0], rtol=1e-5)


@pytest.mark.parametrize("schedule", [Constant(1.0), Linear(6)], ids=["cloning", "dagger"])
def test_linear_expert_is_recovered(point_env, schedule):
    # Without a disturbance F = 5 x, so only the sum of the columns of x and F (both normalised) is
    # determined.
    config = ImitationConfig(rounds=10, envs=64, epochs=40, learning_rate=1e-3, batch=256)
    _, learner, history = imitate(point_env(), schedule, config, start=BLANK)
    weights, bias = learner.layers[0]
    np.testing.assert_allclose(weights[:2, :2] + weights[2:, :2], -1.34 * np.eye(2), atol=1e-3)
    np.testing.assert_allclose(bias[:2], 0, atol=1e-3)
    np.testing.assert_array_equal(weights[:, 2:], 0)  # the scale head is left alone
    x = jnp.asarray(np.random.default_rng(0).uniform(-1, 1, (50, 2)), jnp.float32)
    obs = jnp.concatenate([x, 5 * x], axis=1)
    np.testing.assert_allclose(learner.apply(obs), EXPERT.apply(obs), atol=1e-3)
    assert history[-1]["imitation_error"] < 1e-5 < history[0]["imitation_error"]


def test_learner_unlearns_the_disturbed_force(point_env):
    # An expert that reads the force: with a disturbance there the learner must turn to x, which is clean.
    config = ImitationConfig(rounds=12, envs=32, epochs=4, learning_rate=3e-3, expert_rounds=8)
    state, _, history = imitate(point_env(disturbance=4.0), Linear(8), config, expert=FORCE_EXPERT)
    errors = [float(h["imitation_error"]) for h in history]
    weights = state.params["params"]["hidden_0"]["kernel"]
    assert np.all(np.abs(np.diag(weights[:2, :2]) + 1.34) < 0.1)
    assert np.all(np.abs(np.diag(weights[2:, :2])) < 0.1)
    assert errors[-1] < 0.02 * errors[0]
    # in the last rounds the learner alone acts, on what it sees; optimal is -0.86, doing nothing -1.85
    assert np.mean([h["episode_return"] for h in history[-4:]]) > -1.1


def test_who_acts_decides_the_states_gathered(point_env):
    # A learner that does nothing leaves x near its start; the expert drives it to 0.
    config = ImitationConfig(rounds=1, envs=64, update="end", epochs=1)
    _, _, expert = imitate(point_env(), Constant(1.0), config, start=BLANK)
    _, _, learner = imitate(point_env(), Constant(0.0), config, start=BLANK)
    _, _, mixed = imitate(point_env(), Constant(0.5), config, start=BLANK)
    assert expert[0]["episode_return"] > -1.0
    assert learner[0]["episode_return"] < -1.6
    assert learner[0]["episode_return"] < mixed[0]["episode_return"] < expert[0]["episode_return"]


def test_printed_algorithm_rolls_out_on_clean_and_trains_once(point_env):
    usual = ImitationConfig(rounds=4, envs=8)
    printed = dataclasses.replace(usual, learner_observation="clean", update="end")
    env = point_env(disturbance=4.0)
    _, _, a = imitate(env, Constant(0.0), usual, expert=FORCE_EXPERT)
    state, learner, b = imitate(env, Constant(0.0), printed, expert=FORCE_EXPERT)
    assert [int(h["updates"]) for h in a] == [2, 4, 6, 8]
    assert [int(h["updates"]) for h in b] == [0, 0, 0, 20]
    assert int(state.owed) == 0
    # on clean observations the learner acts as the expert until it is trained; on corrected ones it is misled
    assert np.mean([h["episode_return"] for h in b]) > -1.3
    assert a[0]["episode_return"] < -3.0
    assert not np.array_equal(learner.layers[0][0], FORCE_GAIN)


def test_data_are_corrected_observations_with_labels_of_the_clean_ones(point_env):
    env = point_env(disturbance=4.0)
    config = ImitationConfig(rounds=2, envs=8)
    state, _, _ = imitate(env, Constant(1.0), config)
    observation = np.asarray(state.buffer.observation)
    clean = observation.copy()
    clean[:, 2:] = 5 * clean[:, :2]
    label, _ = np.split(np.asarray(EXPERT.logits(clean)), 2, axis=-1)
    np.testing.assert_allclose(state.buffer.label, label, atol=1e-5)
    disturbance = (observation - clean)[:, 2:]
    assert np.abs(disturbance).max() > 1
    assert int(state.buffer.size) == 2 * 8 * 16
    # rows of one episode share its disturbance: 16 in all
    assert len(np.unique(np.round(disturbance, 3), axis=0)) <= 2 * 16


def test_same_seed_same_bits(point_env):
    config = ImitationConfig(rounds=3, envs=4)
    one, two = (imitate(point_env(), Linear(2), config, seed=3)[0] for _ in range(2))
    pairs = zip(jax.tree_util.tree_leaves(one), jax.tree_util.tree_leaves(two), strict=True)
    assert all(np.array_equal(a, b) for a, b in pairs)


def test_small_buffer_keeps_the_newest(point_env):
    config = ImitationConfig(rounds=3, envs=4, capacity=70)
    state, _, history = imitate(point_env(), Constant(1.0), config)
    assert [int(h["kept"]) for h in history] == [64, 70, 70]
    assert int(state.buffer.written) == 3 * 4 * 16
