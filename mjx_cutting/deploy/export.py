"""Exports a trained policy to one self-describing file that needs neither JAX nor this package to be run.

The golden pairs are computed here, by JAX, on observations that a hardware bug would show on: around the
mean, at every clip edge and beyond it. After writing, the file is read back and the pairs are replayed by the
runtime that will serve it; a file that does not reproduce them is removed.

It breaks where training clips or normalises observations in another way than `Policy.logits` does.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from mjx_cutting import runs
from mjx_cutting.deploy.artefact import CONVENTIONS, Artefact
from mjx_cutting.deploy.export_check import checked
from mjx_cutting.deploy.runtime import save_verified
from mjx_cutting.learning.checkpoint import load_policy
from mjx_cutting.learning.policy import CLIP_STD, Policy
from mjx_cutting.learning.train import stored_config


def export_policy(
    policy: Policy,
    path: str | os.PathLike[str],
    *,
    provenance: Mapping[str, Any] | None = None,
    conventions: Mapping[str, str] | None = None,
    pairs: int = 64,
    seed: int = 0,
    allow_failed_check: bool = False,
) -> Artefact:
    """Returns the artefact that now stands in `path`, checked in C MuJoCo, written atomically and verified.

    Args:
        policy: what `mjx_cutting.learning` trained.
        path: the .npz file to write.
        provenance: what to record besides the policy's own provenance (run folder, verb, ...).
        conventions: what the numbers mean, added to those of artefact.py.
        pairs: golden pairs drawn at random, besides those at the edges, at least 1.
        seed: of the random pairs.
        allow_failed_check: write a policy too that fails the check of export_check.py.

    Raises:
        ValueError: an argument is out of range, the policy fails the check, or the runtime does not reproduce
            it.
        OSError: the file cannot be written.
    """
    artefact = build(policy, provenance=provenance, conventions=conventions, pairs=pairs, seed=seed)
    artefact = checked(artefact, allow_failed=allow_failed_check)
    save_verified(artefact, path)
    return artefact


def build_run(
    run: str | os.PathLike[str],
    *,
    pairs: int = 64,
    seed: int = 0,
    check: bool = True,
    allow_failed_check: bool = False,
) -> Artefact:
    """Returns the artefact of the policy in a run folder of train or adapt, without writing it.

    What its observations mean (frames, how the force was averaged) comes from the run's settings. It is
    checked in the virtual cell, unless `check` is False: for a policy that is flown there anyway.

    Raises:
        ValueError: there is no policy or it is not whole, the settings are not readable, an argument is out
            of range, or the policy fails the check of export_check.py and `allow_failed_check` is not given.
    """
    policy = load_policy(Path(run))
    env = stored_config(Path(run))["env"]
    provenance = {"run": Path(run).resolve().name, "env": dict(env)}  # the server reads tool and feed there
    conventions = _conventions(env)
    artefact = build(policy, provenance=provenance, conventions=conventions, pairs=pairs, seed=seed)
    return checked(artefact, allow_failed=allow_failed_check) if check else artefact


def _conventions(env: Mapping[str, Any]) -> dict[str, str]:
    count, rate = env["force_average_samples"], env["physics_rate_hz"]
    return {
        "frames": "Path error, velocity and force are in the robot's base axes: x transverse, y against the "
        "feed, z up. The path error is the reference position minus the actual one.",
        "force": f"The observed force is the mean of the last {count} samples of the sensor at {rate:g} Hz "
        "before the action, as in training.",
        "feed": f"feed_adjustment is v / v_n - 1; nominal feed v_n = {env['nominal_feed_m_s']:g} m/s.",
    }


def build(
    policy: Policy,
    *,
    provenance: Mapping[str, Any] | None = None,
    conventions: Mapping[str, str] | None = None,
    pairs: int = 64,
    seed: int = 0,
) -> Artefact:
    """Returns the artefact of a policy without writing it; arguments as of `export_policy`."""
    if pairs < 1:
        raise ValueError(f"got pairs={pairs}; expected at least 1")
    policy.check()
    mean, std = np.asarray(policy.mean, np.float32), np.asarray(policy.std, np.float32)
    d, n = policy.description, policy.action_size
    scale = np.asarray(d.observation_scales, np.float32)
    observations = golden_observations(mean, std, CLIP_STD, pairs, seed) * scale
    actions = policy.apply(jnp.asarray(observations) / scale)
    layers = [(np.asarray(w), np.asarray(b)) for w, b in policy.layers]
    last_weights, last_bias = layers[-1]
    layers[-1] = (last_weights[:, :n], last_bias[:n])  # the mean; the spread is for training alone
    return Artefact(
        mean=mean,
        std=std,
        clip=CLIP_STD,
        layers=tuple(layers),
        activation=policy.activation,
        observation_names=d.observation_names,
        observation_units=d.observation_units,
        observation_scales=d.observation_scales,
        action_names=d.action_names,
        action_units=d.action_units,
        action_low=d.action_low,
        action_high=d.action_high,
        action_rate_per_s=d.action_rate_per_s,
        action_log=d.action_log,
        action_initial=d.action_initial,
        policy_period_s=float(d.policy_period_s),
        golden_observation=observations,
        golden_action=np.asarray(actions),
        conventions={**CONVENTIONS, **(conventions or {})},
        provenance={
            **json.loads(policy.provenance),
            **(provenance or {}),
            "exported": runs.plain(runs.provenance()),
        },
    )


def golden_observations(mean: np.ndarray, std: np.ndarray, clip: float, pairs: int, seed: int) -> np.ndarray:
    """Returns scaled observations [pair, observation], float32: random, the mean, clip edges and beyond.

    Args:
        mean, std: the normaliser, [observation].
        clip: largest magnitude of a normalised observation.
        pairs: random ones, half of them far out.
        seed: of the random ones.
    """
    draw = np.random.default_rng(seed)
    spread = np.where(np.arange(pairs)[:, None] % 2 == 0, 1.0, 6.0)
    around = mean + spread * std * draw.standard_normal((pairs, mean.size))
    each = np.tile(mean, (2 * mean.size, 1))
    edges = np.stack([mean - clip * std, mean + clip * std])
    each[np.arange(2 * mean.size), np.arange(2 * mean.size) // 2] = edges.T.reshape(-1)
    corners = np.where(draw.random((8, mean.size)) < 0.5, *edges)
    beyond = mean + 3 * (corners - mean)
    return np.concatenate([mean[None], around, each, edges, corners, beyond]).astype(np.float32)
