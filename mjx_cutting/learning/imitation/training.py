"""Training a policy by imitation of an expert: the strategies `bc` and `dagger`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jax

from mjx_cutting import _platform
from mjx_cutting.learning.environment import describe
from mjx_cutting.learning.imitation.aggregation import Aggregation
from mjx_cutting.learning.imitation.schedule import AbstractSchedule, Constant, Linear
from mjx_cutting.learning.loop import Training, run_training
from mjx_cutting.learning.policy import FILE, Policy
from mjx_cutting.learning.settings import ImitationConfig, require

STRATEGIES = ("bc", "dagger")


def schedule_of(strategy: str, config: ImitationConfig) -> AbstractSchedule:
    """Return the expert's probability of acting, by round, of a strategy: 1 for "bc", falling for
    "dagger".
    """
    require("strategy", strategy, strategy in STRATEGIES, f"one of {STRATEGIES}")
    return Constant(1.0) if strategy == "bc" else Linear(config.expert_rounds)


def imitate(
    env: Any,
    expert: Policy,
    config: ImitationConfig,
    run: Path,
    *,
    strategy: str = "dagger",
    seed: int = 0,
    settings: Any = None,
    resume: Path | None = None,
    checkpoint_every_s: float = 60.0,
    quiet: bool = False,
    tensorboard: bool = False,
) -> Policy:
    """Train a learner that starts as the expert, and return it; it is also the run's policy file.

    Arguments:
        env: a cutting environment (single, not wrapped) whose observations carry the disturbance.
        expert: policy trained without the disturbance.
        config: settings of imitation.
        run: run folder.
        strategy: "bc" or "dagger".
        seed: of everything random.
        settings: what a resumed run must share (a dataclass or mapping); default: `config`.
        resume, checkpoint_every_s, quiet, tensorboard: as in `loop.run_training`.

    Raises: as `loop.run_training`.
    """
    description = describe(env)
    steps = env.config.max_episode_steps
    algorithm = Aggregation(env, expert, schedule_of(strategy, config), config, steps)

    def policies(state: Any) -> dict[str, Policy]:
        provenance = {
            "strategy": strategy,
            "seed": seed,
            "rounds": int(state.iteration),
            "samples": int(state.buffer.written),
            "expert": json.loads(expert.provenance),
        }
        policy = Policy(
            **algorithm.policy_arrays(state),
            activation=expert.activation,
            description=description,
            provenance=json.dumps(provenance),
        )
        return {FILE: policy}

    training = Training(
        title=strategy,
        initialise=lambda: _platform.jit_for_few_calls(algorithm.initialise)(jax.random.PRNGKey(seed)),
        iterate=algorithm.iterate,
        iterations=config.rounds,
        steps_per_iteration=0,
        policies=policies,
        config=config if settings is None else settings,
        names={"finite_observation": description.observation_names},
    )
    state = run_training(training, run, resume, checkpoint_every_s, quiet, tensorboard)
    return policies(state)[FILE]
