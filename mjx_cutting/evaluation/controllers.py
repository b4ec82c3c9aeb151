"""Who acts in an evaluation: a policy, what it is shown, and a filter in between.

Every controller has the same structure, so all of them run through one compiled rollout:

* a policy; the fixed baseline is a policy whose weights are zero and whose last bias is its action,
* whether it sees the clean observation or the one with the disturbance,
* a cascade of second-order sections on each observation, the identity where nothing is filtered:

    y = b0 x + z1,   z1' = b1 x - a1 y + z2,   z2' = b2 x - a2 y.

The paper's other remedy for a disturbed force, a Butterworth filter of order 10 at 5 Hz, is such a cascade.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy import signal

from mjx_cutting.learning.policy import Policy

SECTIONS = 5
_IDENTITY = np.tile(np.asarray([1.0, 0, 0, 1.0, 0, 0], np.float32), (SECTIONS, 1))


@functools.partial(
    jax.tree_util.register_dataclass,
    data_fields=["policy", "clean", "sections", "settled", "filtered"],
    meta_fields=[],
)
@dataclass(frozen=True)
class Controller:
    """A policy with what it sees.

    Arguments:
        policy: acts deterministically.
        clean: whether it sees info["clean_obs"]; a bool.
        sections: [SECTIONS, 6], rows b0 b1 b2 a0 a1 a2 of the filter.
        settled: [SECTIONS, 2], the filter's state after an endless input of one.
        filtered: [observation], which entries pass through the filter, 1 or 0.
    """

    policy: Policy
    clean: Any
    sections: Any
    settled: Any
    filtered: Any

    def begin(self, observation: jax.Array) -> jax.Array:
        """Return the filter's memory [SECTIONS, 2, ..., observation] as if the first input had lasted for
        ever.
        """
        shape = (SECTIONS, 2) + (1,) * observation.ndim
        return jnp.asarray(self.settled, jnp.float32).reshape(shape) * observation

    def act(self, memory: jax.Array, observation: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Return the memory after, and the action [..., action], for an observation [..., observation]."""
        x, after = observation, []
        for i in range(SECTIONS):
            b0, b1, b2, _, a1, a2 = (jnp.asarray(self.sections, jnp.float32)[i, k] for k in range(6))
            y = b0 * x + memory[i, 0]
            after.append(jnp.stack([b1 * x - a1 * y + memory[i, 1], b2 * x - a2 * y]))
            x = y
        seen = jnp.where(jnp.asarray(self.filtered) > 0, x, observation)
        return jnp.stack(after), self.policy.apply(seen)


def direct(policy: Policy, clean: bool = False) -> Controller:
    """Return the controller that shows a policy the observation as it is."""
    nothing = np.zeros((SECTIONS, 2), np.float32)
    return Controller(
        policy, np.asarray(clean), _IDENTITY, nothing, np.zeros(policy.observation_size, np.float32)
    )


def low_passed(
    policy: Policy, entries: Sequence[int], order: int = 10, corner_hz: float = 5.0, clean: bool = False
) -> Controller:
    """Return the controller that shows a policy some entries through a causal Butterworth low-pass.

    Arguments:
        policy: acts on what comes out of the filter.
        entries: of the observation that are filtered (the force: 7, 8, 9).
        order: even, 2 to 10.
        corner_hz: above 0 and below half the policy's rate.

    Raises: ValueError for an order or a corner that cannot be.
    """
    rate_hz = 1.0 / policy.description.policy_period_s
    if order % 2 or not 2 <= order <= 2 * SECTIONS or not 0 < corner_hz < rate_hz / 2:
        raise ValueError(
            f"got order={order} and corner_hz={corner_hz}; expected an even order of 2 to {2 * SECTIONS} "
            f"and a "
            f"corner between 0 and {rate_hz / 2:g} Hz, half the policy's rate; choose such"
        )
    sections = signal.butter(order, corner_hz, fs=rate_hz, output="sos")
    plain = direct(policy, clean)
    full, settled = _IDENTITY.copy(), np.zeros((SECTIONS, 2), np.float32)
    full[: len(sections)], settled[: len(sections)] = sections, signal.sosfilt_zi(sections)
    filtered = np.zeros(policy.observation_size, np.float32)
    filtered[list(entries)] = 1.0
    return dataclasses.replace(plain, sections=full, settled=settled, filtered=filtered)


def constant(action: np.ndarray, like: Policy) -> Controller:
    """Return the controller that takes the same action [action] whatever it sees, with the sizes of a
    policy.
    """
    layers = tuple((np.zeros_like(w), np.zeros_like(b)) for w, b in like.layers)
    bias = layers[-1][1].copy()
    bias[: len(action)] = np.arctanh(np.clip(np.asarray(action, np.float64), -1 + 1e-7, 1 - 1e-7))
    layers = (*layers[:-1], (layers[-1][0], bias))
    return direct(dataclasses.replace(like, layers=layers, provenance='{"strategy": "baseline"}'))


def comparable(controllers: Sequence[Controller]) -> None:
    """Raise ValueError when policies differ in what decides a compiled rollout besides sizes (their
    description).
    """
    first = controllers[0].policy.description
    for other in controllers[1:]:
        if other.policy.description != first:
            raise ValueError(
                "got policies with different observations, limits or rates; expected policies trained in one "
                "environment; evaluate them in runs of their own"
            )
