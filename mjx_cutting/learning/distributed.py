"""Training over several processes and devices, by JAX's own engine (`jax.distributed`).

Every device holds a shard of the environments and a copy of the networks. A shard rolls out and
differentiates on its own data; the gradients are averaged over the shards before each optimiser step, and
the normaliser's statistics are summed, so the copies stay equal. Advantages are normalised within a shard, as
brax does over devices. The state of a sharded training has a first axis of shards on every array, so a
checkpoint is whole in one place, and can be resumed by as many shards as wrote it.

All processes run the same program and must agree on when to stop and to save: `Shards.agree`. The leader
alone writes. Who the processes are is found by JAX (SLURM, Open MPI, Kubernetes, Cloud TPU), else read from
JAX_COORDINATOR_ADDRESS, JAX_NUM_PROCESSES and JAX_PROCESS_ID.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

AXIS = "shard"
VARIABLES = ("JAX_COORDINATOR_ADDRESS", "JAX_NUM_PROCESSES", "JAX_PROCESS_ID")


class Alone:
    """One process, one shard, no first axis: what a training has that is not distributed."""

    count = 1
    axis: str | None = None
    leader = True

    def first(self, state: Any) -> Any:
        """One of the equal copies."""
        return state

    def collect(self, state: Any) -> Any:
        """The whole state, readable by this process."""
        return state

    def spread(self, state: Any) -> Any:
        """The inverse of `collect`."""
        return state

    def agree(self, stop: int, due: bool) -> tuple[int, bool]:
        """The largest `stop` of all processes, and the leader's `due`."""
        return stop, due

    def wait(self, name: str) -> None:
        """Wait until all processes have come here."""

    def on_each(self, initialise: Callable[[Any], Any]) -> Callable[[Any], Any]:
        """From (same argument for all) -> one shard's state, to that of all shards."""
        return initialise

    def on_all(self, iterate: Callable[[Any], Any]) -> Callable[[Any], Any]:
        """From one shard's state -> (state, metrics), to that of all shards; metrics are the same on each."""
        return iterate


class Shards(Alone):
    """All devices of all processes that have joined, a shard each."""

    axis = AXIS

    def __init__(self) -> None:
        self.mesh = Mesh(np.asarray(jax.devices()), (AXIS,))
        self.count = self.mesh.size
        self.leader = jax.process_index() == 0
        self._split = NamedSharding(self.mesh, PartitionSpec(AXIS))

    def first(self, state: Any) -> Any:
        """The copy of the first shard, from a collected state."""
        return jax.tree.map(lambda x: x[0], state)

    def collect(self, state: Any) -> Any:
        """The state of all shards in NumPy; every process must call it."""
        from jax.experimental import multihost_utils

        return multihost_utils.process_allgather(state, tiled=True)

    def spread(self, state: Any) -> Any:
        """[shards, ...] arrays that every process has, laid onto the devices."""

        def lay(x: Any) -> jax.Array:
            whole = np.asarray(x)
            return jax.make_array_from_callback(whole.shape, self._split, lambda index: whole[index])

        return jax.tree.map(lay, state)

    def agree(self, stop: int, due: bool) -> tuple[int, bool]:
        """The largest `stop` of all processes, and the leader's `due`; every process must call it."""
        from jax.experimental import multihost_utils

        told = np.asarray(multihost_utils.process_allgather(np.asarray([stop, int(due)]))).reshape(-1, 2)
        return int(told[:, 0].max()), bool(told[0, 1])

    def wait(self, name: str) -> None:
        """Wait until all processes have come here."""
        from jax.experimental import multihost_utils

        multihost_utils.sync_global_devices(name)

    def on_each(self, initialise: Callable[[Any], Any]) -> Callable[[Any], Any]:
        """From (same argument for all) -> one shard's state, to that of all shards, [shards, ...]."""

        def local(argument: Any) -> Any:
            return jax.tree.map(lambda x: jnp.asarray(x)[None], initialise(argument))

        return self._mapped(local, PartitionSpec(), PartitionSpec(AXIS))

    def on_all(self, iterate: Callable[[Any], Any]) -> Callable[[Any], Any]:
        """From one shard's state -> (state, metrics), to that of all shards; metrics are the same on each."""

        def local(state: Any) -> Any:
            state, metrics = iterate(jax.tree.map(lambda x: x[0], state))
            return jax.tree.map(lambda x: x[None], state), metrics

        return self._mapped(local, PartitionSpec(AXIS), (PartitionSpec(AXIS), PartitionSpec()))

    def _mapped(self, function: Callable[[Any], Any], ins: Any, outs: Any) -> Callable[[Any], Any]:
        # The metrics are equal by construction; JAX's check of that cannot see through while loops.
        return jax.shard_map(function, mesh=self.mesh, in_specs=(ins,), out_specs=outs, check_vma=False)


def join() -> Shards:
    """Join the other processes, before anything is computed, and return the shards.

    Raises: ValueError when JAX finds no cluster and the environment names none.
    """
    # Collectives between CPU processes need an engine of their own; other backends ignore it.
    jax.config.update("jax_cpu_collectives_implementation", "gloo")
    address, processes, index = (os.environ.get(name) for name in VARIABLES)
    try:
        jax.distributed.initialize(
            address,
            None if processes is None else int(processes),
            None if index is None else int(index),
        )
    except (ValueError, RuntimeError) as error:
        raise ValueError(
            f"got distributed=True where JAX cannot join other processes ({error}); expected a cluster that "
            f"it knows (SLURM, Open MPI, Kubernetes), or {', '.join(VARIABLES)} in the environment; start "
            "every process so, or leave --distributed out"
        ) from error
    return Shards()
