"""Brax's PPO networks (flax) and the way between their parameter trees and the plain arrays of a `Policy`.

brax names the layers of a multilayer perceptron hidden_0 ... hidden_L, each {"kernel": [in, out], "bias":
[out]}; the last layer of the policy has one mean and one scale parameter for each action. It breaks when
brax renames its layers; the test that compares `Policy.apply` with the brax network would show it.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from mjx_cutting import _platform
from mjx_cutting.learning.critic import CRITIC, POLICY
from mjx_cutting.learning.policy import ACTIVATIONS, CLIP_STD, Layers, Policy

_platform.patch_brax()
_platform.configure()

from brax.training.acme import running_statistics, specs  # noqa: E402
from brax.training.agents.ppo import networks as ppo_networks  # noqa: E402

_normalize = functools.partial(running_statistics.normalize, max_abs_value=CLIP_STD)


def make_networks(
    observation_size: int | Mapping[str, tuple[int, ...]],
    action_size: int,
    hidden: Sequence[int],
    value_hidden: Sequence[int],
    activation: str,
) -> Any:
    """Return brax's `PPONetworks` with observations normalised by running statistics and clipped.

    Arguments:
        observation_size: entries of the one observation that both networks see, or the sizes of the two of
            `critic.CriticWrapper`.
        action_size: entries of an action.
        hidden, value_hidden: widths of the policy's and the value network's hidden layers.
        activation: a key of `policy.ACTIVATIONS`.
    """
    return ppo_networks.make_ppo_networks(
        observation_size,
        action_size,
        preprocess_observations_fn=_normalize,
        policy_hidden_layer_sizes=tuple(hidden),
        value_hidden_layer_sizes=tuple(value_hidden),
        activation=ACTIVATIONS[activation],
        policy_obs_key=POLICY,
        value_obs_key=CRITIC,
    )


def modest(tree: Any, action_size: int, std: float) -> Any:
    """Return a fresh policy tree whose actions hardly depend on the observation yet and spread by `std`.

    The last layer's weights are scaled by 0.01 and the bias of its scale parameters set so that softplus
    gives `std`: a start near the middle of the range, which Andrychowicz et al. 2021 (arXiv:2006.05990)
    found to matter most among the choices of initialisation.
    """
    name = f"hidden_{len(tree['params']) - 1}"
    last = tree["params"][name]
    bias = last["bias"].at[action_size:].set(jnp.log(jnp.expm1(std)))
    return {"params": {**tree["params"], name: {"kernel": 0.01 * last["kernel"], "bias": bias}}}


def networks_of(policy: Policy) -> Any:
    """Return brax's networks with the policy network of a policy; of the value network only the size is
    made up.
    """
    return make_networks(policy.observation_size, policy.action_size, policy.hidden, (), policy.activation)


def initial_normalizer(observation_size: int | Mapping[str, tuple[int, ...]]) -> Any:
    """Return running statistics that have seen nothing yet: mean 0, standard deviation 1."""
    float32 = jnp.dtype("float32")
    if isinstance(observation_size, int):
        return running_statistics.init_state(specs.Array((observation_size,), float32))
    return running_statistics.init_state({k: specs.Array(v, float32) for k, v in observation_size.items()})


def update_normalizer(state: Any, observation: Any, axis: str | None = None) -> Any:
    """Return the statistics after observations [..., observation], of all shards where `axis` names them.

    The standard deviation is kept above 0.01, observations being of order one: an entry that has hardly moved
    yet would otherwise reach the network hugely amplified the first time it does.
    """
    return running_statistics.update(state, observation, std_min_value=0.01, pmap_axis_name=axis)


def normalizer_of(policy: Policy) -> Any:
    """Return the statistics of a policy, for use with brax's networks (frozen: they hold no counts)."""
    return running_statistics.NestedMeanStd(mean=jnp.asarray(policy.mean), std=jnp.asarray(policy.std))


def to_layers(tree: Any) -> Layers:
    """Return a brax parameter tree as (weights, bias) of each layer, in order, in NumPy."""
    named = tree["params"]
    return tuple(
        (np.asarray(named[f"hidden_{i}"]["kernel"]), np.asarray(named[f"hidden_{i}"]["bias"]))
        for i in range(len(named))
    )


def to_tree(layers: Layers) -> Any:
    """Return (weights, bias) of each layer as a brax parameter tree."""
    return {
        "params": {
            f"hidden_{i}": {"kernel": jnp.asarray(weights), "bias": jnp.asarray(bias)}
            for i, (weights, bias) in enumerate(layers)
        }
    }
