"""Settings of the learners: frozen, checked when made, each with what it stands for.

The paper gives for adaptation 50 episodes, a learning rate of 1e-3 and batches of 64, and for the expert
16 million policy steps; it prints neither the network nor PPO's settings, so those are ours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from mjx_cutting.learning.policy import ACTIVATIONS


@dataclass(frozen=True)
class PPOConfig:
    """Settings of the optimiser. Defaults are for the cutting environment on a CPU.

    Arguments:
        steps: policy steps to train for, over all environments.
        envs: environments side by side.
        unroll_length: policy steps of each environment in an iteration.
        minibatches: parts into which an iteration's data are split; divides envs.
        epochs: passes over an iteration's data.
        learning_rate: Adam's step size at the start.
        learning_rate_final: its value at the last step, reached linearly; None: constant.
        discount: weight of the next step's return.
        gae_lambda: weight of longer returns in the advantage.
        clip: bound on the change of the probability ratio.
        entropy_cost: weight of the entropy bonus.
        value_cost: weight of the value loss.
        reward_scaling: factor on rewards inside the loss.
        max_grad_norm: bound on the norm of the gradient.
        initial_std: standard deviation, before the tanh, of the actions of a fresh policy.
        noise_scale: factor on the policy's standard deviation in the first half of the training.
        noise_scale_final: the same at the end, approached linearly in the second half. The tool follows
            set-points at a limited rate, so a wide spread costs little and does not shrink by itself; a
            policy trained with it may stick in states that only the noise kept it out of. The last part of
            training is therefore nearly deterministic.
        hidden, value_hidden: widths of the hidden layers.
        activation: "tanh", "swish", "relu" or "elu".
    """

    steps: int = 1_000_000
    envs: int = 64
    unroll_length: int = 64
    minibatches: int = 8
    epochs: int = 8
    learning_rate: float = 1e-3
    learning_rate_final: float | None = None
    discount: float = 0.998
    gae_lambda: float = 0.95
    clip: float = 0.2
    entropy_cost: float = 1e-4
    value_cost: float = 0.5
    reward_scaling: float = 10.0
    max_grad_norm: float = 1.0
    initial_std: float = 0.5
    noise_scale: float = 1.0
    noise_scale_final: float = 0.3
    hidden: tuple[int, ...] = (64, 64)
    value_hidden: tuple[int, ...] = (64, 64)
    activation: str = "tanh"

    def __post_init__(self) -> None:
        at_least_one = ("steps", "envs", "unroll_length", "minibatches", "epochs")
        for name in at_least_one:
            require(name, getattr(self, name), getattr(self, name) >= 1, "at least 1")
        for name in (
            "learning_rate",
            "reward_scaling",
            "max_grad_norm",
            "initial_std",
            "noise_scale",
            "noise_scale_final",
        ):
            require(name, getattr(self, name), getattr(self, name) > 0, "above 0")
        for name in ("entropy_cost", "value_cost"):
            require(name, getattr(self, name), getattr(self, name) >= 0, "0 or more")
        for name in ("discount", "gae_lambda"):
            require(name, getattr(self, name), 0 <= getattr(self, name) <= 1, "0 to 1")
        require("clip", self.clip, 0 < self.clip < 1, "between 0 and 1")
        if self.learning_rate_final is not None:
            require(
                "learning_rate_final", self.learning_rate_final, self.learning_rate_final >= 0, "0 or more"
            )
        require(
            "minibatches",
            self.minibatches,
            self.envs % self.minibatches == 0,
            f"a divisor of envs={self.envs}",
        )
        require(
            "activation", self.activation, self.activation in ACTIVATIONS, f"one of {sorted(ACTIVATIONS)}"
        )
        for name in ("hidden", "value_hidden"):
            require(
                name, getattr(self, name), all(w >= 1 for w in getattr(self, name)), "widths of at least 1"
            )

    @property
    def steps_per_iteration(self) -> int:
        """Policy steps that one iteration takes over all environments."""
        return self.envs * self.unroll_length

    @property
    def has_schedule(self) -> bool:
        """Whether the settings in an iteration depend on how many there will be."""
        return self.learning_rate_final is not None or self.noise_scale_final != self.noise_scale

    @property
    def iterations(self) -> int:
        """Iterations that reach `steps`, rounded up."""
        return -(-self.steps // self.steps_per_iteration)


@dataclass(frozen=True)
class ImitationConfig:
    """Settings of behavioural cloning and DAgger; the defaults are the paper's where it gives them.

    Arguments:
        rounds: rounds of rolling out and fitting.
        envs: episodes of a round, side by side; 1 in the paper.
        expert_rounds: rounds over which DAgger's expert probability falls from 1 to 0; not used by cloning.
        learning_rate: Adam's step size.
        batch: rows of an update.
        epochs: passes over the data gathered so far after each round (not published; ours).
        capacity: rows of the data buffer; None: room for every step of every round, up to a million.
        learner_observation: what the acting learner sees, "corrected", or "clean" as in the printed
            algorithm.
        update: fit after each "round", or once at the "end" as in the printed algorithm.
    """

    rounds: int = 50
    envs: int = 1
    expert_rounds: int = 45
    learning_rate: float = 1e-3
    batch: int = 64
    epochs: int = 1
    capacity: int | None = None
    learner_observation: Literal["corrected", "clean"] = "corrected"
    update: Literal["round", "end"] = "round"

    def __post_init__(self) -> None:
        for name in ("rounds", "envs", "expert_rounds", "batch", "epochs"):
            require(name, getattr(self, name), getattr(self, name) >= 1, "at least 1")
        require("learning_rate", self.learning_rate, self.learning_rate > 0, "above 0")
        require(
            "capacity",
            self.capacity,
            self.capacity is None or self.capacity >= self.batch,
            "at least one batch",
        )
        for name, choices in (("learner_observation", ("corrected", "clean")), ("update", ("round", "end"))):
            require(name, getattr(self, name), getattr(self, name) in choices, f"one of {choices}")


def require(name: str, value: Any, fine: bool, expected: str) -> None:
    """Raise ValueError, saying what was got, what was expected and which option mends it, unless `fine`."""
    if not fine:
        raise ValueError(
            f"got {name}={value}; expected {expected}; set --{name.replace('_', '-')} accordingly"
        )
