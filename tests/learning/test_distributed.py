"""Two processes on the loopback device train as one process with the same environments does."""

import json
import os
import socket
import subprocess
import sys
import textwrap
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting import _platform
from mjx_cutting.learning import checkpoint, progress
from mjx_cutting.learning.distributed import AXIS, join
from mjx_cutting.learning.policy import Policy
from mjx_cutting.learning.ppo import PPO
from mjx_cutting.learning.settings import PPOConfig
from mjx_cutting.learning.train import TrainConfig, open_run

CONFIG = PPOConfig(
    steps=256,
    envs=16,
    unroll_length=16,
    minibatches=2,
    epochs=2,
    noise_scale_final=1.0,
    hidden=(8,),
    value_hidden=(8,),
)

WORKER = textwrap.dedent(
    """
    import dataclasses, importlib.util, json, sys
    from pathlib import Path
    from mjx_cutting.learning.distributed import join

    shards = join()
    place = importlib.util.spec_from_file_location("point", sys.argv[1])
    point = importlib.util.module_from_spec(place)
    place.loader.exec_module(point)

    from mjx_cutting.learning.expert import train_policy
    from mjx_cutting.learning.settings import PPOConfig

    run, config = Path(sys.argv[2]), PPOConfig(**json.loads(sys.argv[3]))
    told = dict(settings={}, shards=shards, quiet=True)
    train_policy(point.PointEnv(), config, run, **told)
    if shards.leader:
        (run / "policy.npz").rename(run / "first.npz")
    train_policy(point.PointEnv(), dataclasses.replace(config, steps=512), run, resume=run, **told)
    assert shards.agree(15 * (not shards.leader), shards.leader) == (15, True)
    """
)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """One update by two processes, then resumed for a second one."""
    folder = tmp_path_factory.mktemp("distributed") / "run"
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    conftest = Path(__file__).with_name("conftest.py")
    cluster = {"JAX_COORDINATOR_ADDRESS": f"127.0.0.1:{port}", "JAX_NUM_PROCESSES": "2"}

    words = [sys.executable, "-c", WORKER, str(conftest), str(folder), json.dumps(CONFIG.__dict__)]
    workers = [
        subprocess.Popen(
            words,
            env={**os.environ, **cluster, "JAX_PROCESS_ID": str(i), "JAX_PLATFORMS": "cpu"},
            stderr=subprocess.PIPE,
            text=True,
        )
        for i in range(2)
    ]
    try:
        for worker in workers:
            _, told = worker.communicate(timeout=600)
            assert worker.returncode == 0, told[-3000:]
    finally:
        for worker in workers:
            worker.kill()
    return folder


@pytest.fixture(scope="module")
def alone(point_env, batched):
    """The same two updates with both halves of the environments in this process."""
    ppo = PPO(batched(point_env()), CONFIG, shards=2, axis=AXIS)
    key = jax.random.PRNGKey(0)
    state = jax.jit(jax.vmap(lambda _: ppo.initialise(key), axis_name=AXIS))(jnp.arange(2))
    iterate = _platform.jit(jax.vmap(ppo.iterate, axis_name=AXIS))
    states, metrics = [state], []
    for _ in range(2):
        state, told = iterate(state)
        states.append(state)
        metrics.append(told)
    return ppo, states, metrics


def arrays(ppo, state, shard):
    one = ppo.policy_arrays(jax.tree.map(lambda x: x[shard], state))
    flat = [x for name in ("layers", "value_layers") for layer in one[name] for x in layer]
    return [*flat, *(one[name] for name in ("mean", "std", "value_mean", "value_std"))]


@pytest.mark.slow
def test_shards_keep_one_policy_and_environments_of_their_own(alone):
    ppo, (start, first, _), metrics = alone
    for a, b in zip(arrays(ppo, first, 0), arrays(ppo, first, 1), strict=True):
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(first.env.obs["state"][0], first.env.obs["state"][1])
    assert np.abs(arrays(ppo, first, 0)[0] - arrays(ppo, start, 0)[0]).max() > 1e-3
    assert list(metrics[0]["episodes"]) == [16, 16]  # of both


@pytest.mark.slow
def test_updates_of_two_processes_are_those_of_one(run, alone):
    ppo, states, metrics = alone
    for file, state in zip(("first.npz", "policy.npz"), states[1:], strict=True):
        two = Policy.load(run / file)
        flat = [x for layers in (two.layers, two.value_layers) for layer in layers for x in layer]
        for a, b in zip(
            arrays(ppo, state, 0), [*flat, two.mean, two.std, two.value_mean, two.value_std], strict=True
        ):
            np.testing.assert_allclose(a, b, atol=1e-5)
    told = progress.read_lines(run / progress.METRICS)
    assert [line["steps"] for line in told] == [256, 512]  # the leader alone writes
    for line, one in zip(told, metrics, strict=True):
        for name in ("episodes", "episode_return", "total_loss", "reward"):
            assert line[name] == pytest.approx(float(one[name][1]), rel=1e-5, abs=1e-5)


@pytest.mark.slow
def test_checkpoint_holds_every_shard(run):
    leaves = checkpoint._manifest(checkpoint.find(run))["leaves"]
    shapes = {name.split("_", 1)[1]: leaf["shape"] for name, leaf in leaves.items()}
    assert all(shape[0] == 2 for shape in shapes.values())
    assert shapes["episode_return"] == [2, 8]


def test_environments_that_cannot_be_split_are_refused(point_env, batched):
    with pytest.raises(ValueError, match=r"envs=16 in 3 shards .* multiple of 6"):
        PPO(batched(point_env()), CONFIG, shards=3)


def test_joining_nobody_is_refused(monkeypatch, tmp_path):
    for name in os.environ:
        if name.startswith(("SLURM_", "OMPI_", "JAX_COORD", "JAX_NUM", "JAX_PROCESS")):
            monkeypatch.delenv(name)
    with pytest.raises(ValueError, match="JAX_COORDINATOR_ADDRESS"):
        join()
    with pytest.raises(ValueError, match="give --out"):
        TrainConfig(distributed=True)
    # a process that is not the leader writes nothing
    config = TrainConfig(distributed=True, out=tmp_path / "run")
    assert open_run(config, "train", leader=False) == tmp_path / "run"
    assert not (tmp_path / "run").exists()
