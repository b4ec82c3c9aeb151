"""The probability that the expert acts, by round.

The paper's text calls beta the probability of the learner acting while its formula makes it the expert's;
here it is the expert's. Behavioural cloning is beta = 1 throughout. DAgger lowers it linearly,

    beta_i = max(0, 1 - i / n),   i = 0, 1, ...

so with n = 45 the expert alone acts in the first round and the learner alone in round 45 and the four
after it. Reference: Ross, Gordon, Bagnell 2011, arXiv:1011.0686.
"""

from __future__ import annotations

import abc
from dataclasses import dataclass

import jax
import jax.numpy as jnp

from mjx_cutting.learning.settings import require


class AbstractSchedule(abc.ABC):
    """A map from the round (0, 1, ...) to the expert's probability of acting in it."""

    @abc.abstractmethod
    def __call__(self, round_index: jax.Array | int) -> jax.Array:
        """Return beta in [0, 1] for a round; may be traced."""


@dataclass(frozen=True)
class Constant(AbstractSchedule):
    """The same probability in every round: 1 is behavioural cloning, 0 the learner alone."""

    beta: float = 1.0

    def __post_init__(self) -> None:
        require("beta", self.beta, 0 <= self.beta <= 1, "a probability, 0 to 1")

    def __call__(self, round_index: jax.Array | int) -> jax.Array:
        return jnp.full(jnp.shape(round_index), self.beta, jnp.float32)


@dataclass(frozen=True)
class Linear(AbstractSchedule):
    """From 1 in round 0 to 0 in round `rounds`, and 0 ever after."""

    rounds: int = 45

    def __post_init__(self) -> None:
        require("expert_rounds", self.rounds, self.rounds >= 1, "at least 1")

    def __call__(self, round_index: jax.Array | int) -> jax.Array:
        return jnp.maximum(0.0, 1.0 - jnp.asarray(round_index, jnp.float32) / self.rounds)
