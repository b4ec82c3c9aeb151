"""A trained policy as plain arrays: normaliser, network, and what its numbers mean.

    a = tanh(mu),   (mu, s) = W_L phi(... phi(W_1 x + b_1) ...) + b_L,   x = clip((o - m) / d, -10, 10)

is the mode of the tanh-normal distribution of brax's PPO networks: the last layer gives the mean and a scale
parameter for each action, and acting deterministically uses the mean alone. The action lies in [-1, 1] and is
a set-point between the limits in the description, on a log scale where `action_log` says so; the receiver
applies the rate limits.

The same arrays are kept in one small npz file (format "mjx-cutting-trained-policy/1"), so that the
exporter does not depend on how the training state is checkpointed. It breaks when the environment is
rebuilt with other limits: a policy must be served with the description it was trained with.
"""

from __future__ import annotations

import dataclasses
import functools
import io
import itertools
import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from mjx_cutting import _files

FORMAT = "mjx-cutting-trained-policy/1"
FILE = "policy.npz"
CLIP_STD = 10.0
ACTIVATIONS = {"tanh": jnp.tanh, "swish": jax.nn.swish, "relu": jax.nn.relu, "elu": jax.nn.elu}
Layers = tuple[tuple[Any, Any], ...]


@dataclass(frozen=True)
class PolicyDescription:
    """What the entries of an observation and of an action are.

    Every tuple has one entry for each observation or action.

    Arguments:
        observation_names, observation_units: as the environment names them; units of the physical values.
        observation_scales: observation = physical value / scale.
        action_names, action_units: the commanded set-points and their units.
        action_low, action_high: physical value at action -1 and at +1.
        action_rate_per_s: largest change of the set-point in a second, in the action's unit
            (natural logarithm of the value for a log action); infinite where unlimited.
        action_log: true where the set-point is interpolated in the logarithm.
        action_initial: set-point at the start of an episode.
        policy_period_s: time between two actions, s.
    """

    observation_names: tuple[str, ...]
    observation_units: tuple[str, ...]
    observation_scales: tuple[float, ...]
    action_names: tuple[str, ...]
    action_units: tuple[str, ...]
    action_low: tuple[float, ...]
    action_high: tuple[float, ...]
    action_rate_per_s: tuple[float, ...]
    action_log: tuple[bool, ...]
    action_initial: tuple[float, ...]
    policy_period_s: float

    def __post_init__(self) -> None:
        for prefix in ("observation", "action"):
            lengths = {
                f.name: len(getattr(self, f.name))
                for f in dataclasses.fields(self)
                if f.name.startswith(prefix + "_")
            }
            if len(set(lengths.values())) != 1:
                raise ValueError(
                    f"got {prefix} descriptions of different lengths {lengths}; expected one entry for each "
                    f"{prefix}; give every tuple the same length"
                )

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as JSON-ready lists and numbers."""
        return dataclasses.asdict(self)

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> PolicyDescription:
        """Return the description from `to_dict`'s form."""
        values: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in fields.items()}
        return cls(**values)

    @classmethod
    def plain(cls, observation_size: int, action_size: int, policy_period_s: float) -> PolicyDescription:
        """Return the description of an environment that names nothing: unit scales, limits -1 and 1."""
        o, a = observation_size, action_size
        return cls(
            observation_names=tuple(f"observation_{i}" for i in range(o)),
            observation_units=("1",) * o,
            observation_scales=(1.0,) * o,
            action_names=tuple(f"action_{i}" for i in range(a)),
            action_units=("1",) * a,
            action_low=(-1.0,) * a,
            action_high=(1.0,) * a,
            action_rate_per_s=(float("inf"),) * a,
            action_log=(False,) * a,
            action_initial=(0.0,) * a,
            policy_period_s=policy_period_s,
        )


@functools.partial(
    jax.tree_util.register_dataclass,
    data_fields=["mean", "std", "layers", "value_layers", "value_mean", "value_std"],
    meta_fields=["activation", "description", "provenance"],
)
@dataclass(frozen=True)
class Policy:
    """A policy that can be applied, saved and exported. It is a pytree, so it passes through jit and vmap.

    Arguments:
        mean, std: observation normaliser, each [observation], in scaled observations.
        layers: (weights [in, out], bias [out]) of each layer; the last has 2 x actions outputs
            (means, then scale parameters of the training distribution).
        value_layers: the value network likewise, or None; kept, with its normaliser, so that training can go
            on from here. Its observation is that of `critic.CriticWrapper`.
        activation: "tanh", "swish", "relu" or "elu", after every layer but the last.
        description: names, units and limits.
        provenance: JSON text, where the policy came from (strategy, steps, seed).
        value_mean, value_std: normaliser of the value network's observation, or None.
    """

    mean: Any
    std: Any
    layers: Layers
    value_layers: Layers | None
    activation: str
    description: PolicyDescription
    provenance: str = "{}"
    value_mean: Any = None
    value_std: Any = None

    @property
    def observation_size(self) -> int:
        return len(self.description.observation_names)

    @property
    def action_size(self) -> int:
        return len(self.description.action_names)

    @property
    def hidden(self) -> tuple[int, ...]:
        """Widths of the hidden layers."""
        return tuple(int(w.shape[-1]) for w, _ in self.layers[:-1])

    def logits(self, observation: jax.Array) -> jax.Array:
        """Return [..., 2 x action]: mean before the tanh, then scale parameter (std = softplus(s) + 1e-3)."""
        x = jnp.clip((observation - self.mean) / self.std, -CLIP_STD, CLIP_STD)
        for weights, bias in self.layers[:-1]:
            x = ACTIVATIONS[self.activation](_affine(x, weights, bias))
        return _affine(x, *self.layers[-1])

    def apply(self, observation: jax.Array) -> jax.Array:
        """Return the deterministic action [..., action] in [-1, 1] for observations [..., observation]."""
        return jnp.tanh(jnp.split(self.logits(observation), 2, axis=-1)[0])

    def sample(self, observation: jax.Array, key: jax.Array) -> jax.Array:
        """Return an action [..., action] in [-1, 1] drawn from the training distribution."""
        loc, scale = jnp.split(self.logits(observation), 2, axis=-1)
        std = jax.nn.softplus(scale) + 1e-3
        return jnp.tanh(loc + std * jax.random.normal(key, loc.shape, loc.dtype))

    def save(self, path: Path) -> None:
        """Write the policy to one npz file, atomically.

        Raises: OSError when the file cannot be written.
        """
        header = {
            "format": FORMAT,
            "activation": self.activation,
            "layers": len(self.layers),
            "value_layers": None if self.value_layers is None else len(self.value_layers),
            "description": self.description.to_dict(),
            "provenance": json.loads(self.provenance),
        }
        arrays: dict[str, Any] = {
            "header": np.asarray(json.dumps(header)),
            "observation_mean": np.asarray(self.mean),
            "observation_std": np.asarray(self.std),
        }
        if self.value_layers is not None:
            arrays["value_mean"], arrays["value_std"] = (
                np.asarray(self.value_mean),
                np.asarray(self.value_std),
            )
        for prefix, layers in (("policy", self.layers), ("value", self.value_layers or ())):
            for i, (weights, bias) in enumerate(layers):
                arrays[f"{prefix}_weights_{i}"] = np.asarray(weights)
                arrays[f"{prefix}_bias_{i}"] = np.asarray(bias)
        buffer = io.BytesIO()
        np.savez(buffer, **arrays)
        _files.write_atomic(Path(path), buffer.getvalue())

    @classmethod
    def load(cls, path: Path) -> Policy:
        """Return the policy in an npz file.

        Raises: ValueError when the file is missing, cut off, of another format, or does not fit together.
        """
        path = Path(path)
        if not path.is_file():
            raise ValueError(
                f"got no policy file at {path}; expected a {FILE} written by training; "
                "give the run folder of `mjx-cutting train` or `mjx-cutting adapt`"
            )
        try:
            with np.load(path, allow_pickle=False) as file:
                arrays = {name: file[name] for name in file.files}
            header = json.loads(str(arrays.pop("header")))
        except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile) as error:
            raise ValueError(
                f"got a policy file {path} that cannot be read ({error}); expected a whole npz file of "
                f"format {FORMAT}; write it again: `mjx-cutting train --resume RUN`"
            ) from error
        if header.get("format") != FORMAT:
            raise ValueError(
                f"got format {header.get('format')!r} in {path}; expected {FORMAT!r}; "
                "read it with the version of mjx-cutting that wrote it, or train again"
            )
        policy = cls(
            mean=arrays["observation_mean"],
            std=arrays["observation_std"],
            layers=_take(arrays, "policy", header["layers"]),
            value_layers=None
            if header["value_layers"] is None
            else _take(arrays, "value", header["value_layers"]),
            activation=header["activation"],
            description=PolicyDescription.from_dict(header["description"]),
            provenance=json.dumps(header["provenance"]),
            value_mean=arrays.get("value_mean"),
            value_std=arrays.get("value_std"),
        )
        policy.check()
        return policy

    def check(self) -> None:
        """Raise ValueError when sizes do not fit together or a number is not finite."""
        if self.activation not in ACTIVATIONS:
            raise ValueError(
                f"got activation {self.activation!r}; expected one of {sorted(ACTIVATIONS)}; choose one"
            )
        widths = [self.observation_size, *self.hidden, 2 * self.action_size]
        shapes = [tuple(np.shape(w)) for w, _ in self.layers]
        expected = list(itertools.pairwise(widths))
        if shapes != expected:
            raise ValueError(
                f"got layer shapes {shapes}; expected {expected} for {self.observation_size} observations "
                f"and {self.action_size} actions; the file does not belong to this description"
            )
        for leaf in jax.tree_util.tree_leaves(self):
            if not np.all(np.isfinite(leaf)):
                raise ValueError(
                    "got a policy with values that are not finite; expected finite weights and normaliser; "
                    "go back to an earlier checkpoint of the run"
                )
        if np.any(np.asarray(self.std) <= 0):
            raise ValueError("got an observation_std that is not positive; expected positive; train again")


def _affine(x: jax.Array, weights: jax.Array, bias: jax.Array) -> jax.Array:
    return jnp.matmul(x, weights, precision=jax.lax.Precision.HIGHEST) + bias


def _take(arrays: Mapping[str, np.ndarray], prefix: str, count: int) -> Layers:
    return tuple((arrays[f"{prefix}_weights_{i}"], arrays[f"{prefix}_bias_{i}"]) for i in range(count))
