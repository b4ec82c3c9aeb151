"""The environment of a run, from settings and files, and its description for the policies trained in it."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mjx_cutting.learning.policy import PolicyDescription

if TYPE_CHECKING:
    from mjx_cutting.sim import CuttingEnv, EnvConfig


def make_env(
    config: EnvConfig, model: Path | None = None, gp: Path | None = None, disturbance_mode: str = "dynamics"
) -> CuttingEnv:
    """Return the cutting environment.

    Arguments:
        config: settings of the simulation.
        model: model.json of `mjx-cutting trace`, whose effects act in the simulation; None: the base model.
        gp: disturbance of `mjx-cutting fit-gp` (npz); None: as `config` says, which must then be "none".
        disturbance_mode: how a given disturbance acts where `config` says "none": "observation" or
            "dynamics".

    Raises: ValueError when a file is missing or is not what it should be.
    """
    from mjx_cutting.sim import CuttingEnv

    disturbance = None
    if gp is not None:
        disturbance = load_disturbance(gp)
        if config.disturbance_mode == "none":
            config = dataclasses.replace(config, disturbance_mode=disturbance_mode)
    return CuttingEnv(config, None if model is None else load_model(model), disturbance)


def load_model(path: Path) -> Any:
    """Return the force model in a model.json.

    Raises: ValueError when the file is missing or holds no model.
    """
    from mjx_cutting.cutting import ForceModel

    path = Path(path)
    if not path.is_file():
        raise ValueError(
            f"got no file at {path}; expected a model.json; `mjx-cutting trace DATASET --out DIR` writes one"
        )
    try:
        return ForceModel.from_dict(json.loads(path.read_text()))
    except (json.JSONDecodeError, KeyError, TypeError) as error:
        raise ValueError(
            f"got {path}, which holds no force model ({error}); expected format mjx-cutting-model/1; "
            "write it again with `mjx-cutting trace`"
        ) from error


def load_disturbance(path: Path) -> Any:
    """Return the posterior, ready for the simulation, of a fitted disturbance.

    Raises: ValueError when the file is missing or holds no disturbance.
    """
    from mjx_cutting.disturbance import DisturbanceGP

    path = Path(path)
    if not path.is_file():
        raise ValueError(f"got no file at {path}; expected a gp.npz; `mjx-cutting fit-gp` writes one")
    return DisturbanceGP.load(path).posterior()


def describe(env: Any) -> PolicyDescription:
    """Return what the numbers of an environment's observations and actions mean.

    An environment that names nothing (as small test environments do) gets plain names, scales and limits.
    """
    period = float(env.config.policy_step_s)
    if not hasattr(env, "action_limits"):
        return PolicyDescription.plain(env.observation_size, env.action_size, period)
    from mjx_cutting.sim.action import log_start

    limits = env.action_limits
    start = log_start(env.config)
    return PolicyDescription(
        observation_names=tuple(env.observation_names),
        observation_units=tuple(env.observation_units),
        observation_scales=tuple(float(x) for x in env.observation_scales),
        action_names=tuple(limits.names),
        action_units=tuple(limits.units),
        action_low=tuple(float(x) for x in limits.low),
        action_high=tuple(float(x) for x in limits.high),
        action_rate_per_s=tuple(float(x) for x in limits.rate),
        action_log=tuple(bool(x) for x in limits.log),
        action_initial=_physical(start, limits.log),
        policy_period_s=period,
    )


def _physical(start: tuple[float, ...], log: tuple[bool, ...]) -> tuple[float, ...]:
    return tuple(math.exp(x) if is_log else x for x, is_log in zip(start, log, strict=True))
