import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.learning import networks
from mjx_cutting.learning.policy import FORMAT, Policy, PolicyDescription


def make_policy(activation="tanh", hidden=(8, 6), seed=0):
    net = networks.make_networks(4, 2, hidden, (5,), activation)
    keys = jax.random.split(jax.random.PRNGKey(seed), 4)
    return Policy(
        mean=np.asarray(jax.random.normal(keys[0], (4,))),
        std=np.asarray(jax.random.uniform(keys[1], (4,), minval=0.1, maxval=3.0)),
        layers=networks.to_layers(net.policy_network.init(keys[2])),
        value_layers=networks.to_layers(net.value_network.init(keys[3])),
        activation=activation,
        description=PolicyDescription.plain(4, 2, 0.02),
        provenance=json.dumps({"strategy": "expert", "seed": seed}),
        value_mean=np.zeros(4, np.float32),
        value_std=np.ones(4, np.float32),
    )


@pytest.mark.parametrize("activation", ["tanh", "swish", "relu", "elu"])
@pytest.mark.parametrize("hidden", [(), (7,), (8, 6)])
def test_apply_is_the_mode_of_the_brax_network(activation, hidden):
    policy = make_policy(activation, hidden)
    net = networks.networks_of(policy)
    obs = 30 * jax.random.normal(jax.random.PRNGKey(9), (50, 4))
    tree = networks.to_tree(policy.layers)
    logits = net.policy_network.apply(networks.normalizer_of(policy), tree, obs)
    np.testing.assert_allclose(policy.logits(obs), logits, atol=2e-6)
    np.testing.assert_allclose(policy.apply(obs), net.parametric_action_distribution.mode(logits), atol=2e-6)


def test_sample_has_the_distribution_of_the_network():
    policy = make_policy()
    obs = jnp.tile(jnp.asarray([0.3, -1.0, 2.0, 0.1]), (20_000, 1))
    raw = np.arctanh(np.clip(policy.sample(obs, jax.random.PRNGKey(1)), -1 + 1e-7, 1 - 1e-7))
    loc, scale = np.split(np.asarray(policy.logits(obs[0])), 2)
    np.testing.assert_allclose(raw.mean(0), loc, atol=0.03)
    np.testing.assert_allclose(raw.std(0), np.log1p(np.exp(scale)) + 1e-3, rtol=0.03)


def test_layers_and_tree_are_inverse():
    policy = make_policy()
    again = networks.to_layers(networks.to_tree(policy.layers))
    assert all(
        np.array_equal(a, b)
        for one, two in zip(policy.layers, again, strict=True)
        for a, b in zip(one, two, strict=True)
    )


def test_saved_policy_comes_back_bit_for_bit(tmp_path):
    policy = make_policy("swish")
    policy.save(tmp_path / "policy.npz")
    again = Policy.load(tmp_path / "policy.npz")
    before, after = jax.tree_util.tree_leaves(policy), jax.tree_util.tree_leaves(again)
    assert len(before) == len(after) == 2 + 2 * 3 + 2 * 2 + 2
    assert all(np.array_equal(a, b) and a.dtype == b.dtype for a, b in zip(before, after, strict=True))
    assert again.description == policy.description
    assert again.activation == "swish"
    assert json.loads(again.provenance) == {"strategy": "expert", "seed": 0}


def test_policy_passes_through_jit_and_vmap():
    policy = make_policy()
    stacked = jax.tree_util.tree_map(lambda a, b: jnp.stack([a, b]), policy, make_policy(seed=0))
    obs = jnp.ones((4,))
    out = jax.jit(jax.vmap(lambda p: p.apply(obs)))(stacked)
    np.testing.assert_allclose(out[0], policy.apply(obs), atol=1e-6)


def test_missing_cut_off_and_foreign_files_are_refused(tmp_path):
    with pytest.raises(ValueError, match="no policy file"):
        Policy.load(tmp_path / "none.npz")
    path = tmp_path / "policy.npz"
    make_policy().save(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match="cannot be read"):
        Policy.load(path)
    np.savez(path, header=np.asarray(json.dumps({"format": "mjx-cutting-policy/9"})))
    with pytest.raises(ValueError, match=f"expected '{FORMAT}'"):
        Policy.load(path)


def test_policy_that_does_not_fit_together_is_refused():
    import dataclasses

    policy = make_policy()
    with pytest.raises(ValueError, match="layer shapes"):
        dataclasses.replace(policy, layers=policy.layers[1:]).check()
    with pytest.raises(ValueError, match="not finite"):
        dataclasses.replace(policy, mean=policy.mean * np.nan).check()
    with pytest.raises(ValueError, match="observation_std"):
        dataclasses.replace(policy, std=policy.std * 0).check()
    with pytest.raises(ValueError, match="different lengths"):
        dataclasses.replace(policy.description, action_names=("a",))
