"""The aggregated data set: a fixed-size ring on the device.

Row k of everything ever written lies at k mod capacity, so beyond the capacity the oldest rows are
overwritten. Episodes of different lengths run side by side; a mask says which rows of a step are written.
"""

from __future__ import annotations

import flax.struct
import jax
import jax.numpy as jnp


@flax.struct.dataclass
class Buffer:
    """Observations with their labels.

    Arguments:
        observation: [capacity, observation], what the learner sees.
        label: [capacity, action], the expert's mean action before the tanh.
        written: rows ever written.
    """

    observation: jax.Array
    label: jax.Array
    written: jax.Array

    @property
    def capacity(self) -> int:
        return self.observation.shape[0]

    @property
    def size(self) -> jax.Array:
        """Rows that hold data."""
        return jnp.minimum(self.written, self.capacity)


def empty(capacity: int, observation_size: int, action_size: int) -> Buffer:
    """Return a buffer without data."""
    return Buffer(
        observation=jnp.zeros((capacity, observation_size), jnp.float32),
        label=jnp.zeros((capacity, action_size), jnp.float32),
        written=jnp.zeros((), jnp.int32),
    )


def append(buffer: Buffer, observation: jax.Array, label: jax.Array, mask: jax.Array) -> Buffer:
    """Return the buffer with the rows where `mask` is true written after the others.

    Arguments:
        observation: [rows, observation].
        label: [rows, action].
        mask: [rows], bool; no more rows may be true than the capacity.
    """
    order = buffer.written + jnp.cumsum(mask) - 1
    place = jnp.where(mask, order % buffer.capacity, buffer.capacity)  # out of range: dropped
    return Buffer(
        observation=buffer.observation.at[place].set(observation, mode="drop"),
        label=buffer.label.at[place].set(label, mode="drop"),
        written=buffer.written + jnp.sum(mask, dtype=jnp.int32),
    )


def sample(buffer: Buffer, key: jax.Array, rows: int) -> tuple[jax.Array, jax.Array]:
    """Return observations [rows, observation] and labels [rows, action], drawn evenly and with
    replacement.
    """
    index = jax.random.randint(key, (rows,), 0, jnp.maximum(buffer.size, 1))
    return buffer.observation[index], buffer.label[index]
