import os
import signal
import subprocess
import sys
import textwrap
import threading
import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.learning import checkpoint, progress
from mjx_cutting.learning.loop import Training, TrainingDiverged, TrainingInterrupted, run_training
from mjx_cutting.learning.policy import Policy, PolicyDescription
from mjx_cutting.learning.ppo import PPO
from mjx_cutting.learning.settings import PPOConfig

CONFIG = PPOConfig(
    steps=6 * 64, envs=8, unroll_length=8, minibatches=2, epochs=2, hidden=(4,), value_hidden=(4,)
)
DESCRIPTION = PolicyDescription.plain(4, 2, 0.02)


def training(env, iterations=6, config=CONFIG, **extra):
    ppo = PPO(env, config)
    return Training(
        title="expert",
        initialise=lambda: jax.jit(ppo.initialise)(jax.random.PRNGKey(0)),
        iterate=ppo.iterate,
        iterations=iterations,
        steps_per_iteration=config.steps_per_iteration,
        policies=lambda s: {
            "policy.npz": Policy(**ppo.policy_arrays(s), activation="tanh", description=DESCRIPTION)
        },
        config=config,
        **extra,
    )


def same(a, b):
    pairs = zip(jax.tree_util.tree_leaves(a), jax.tree_util.tree_leaves(b), strict=True)
    return all(np.asarray(x).tobytes() == np.asarray(y).tobytes() for x, y in pairs)


def test_stopped_and_resumed_equals_never_stopped(tmp_path, point_env, batched):
    env = batched(point_env())
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    straight = run_training(training(env), whole, quiet=True)
    run_training(training(env, iterations=2), parts, quiet=True)
    # what a kill after the checkpoint leaves behind: lines beyond it, the last one cut off
    with (parts / progress.METRICS).open("a") as file:
        file.write('{"iteration": 3, "steps": 192}\n{"iteration": 4, "st')
    resumed = run_training(training(env), parts, resume=parts, quiet=True)
    assert same(straight, resumed)
    assert (whole / "policy.npz").read_bytes() == (parts / "policy.npz").read_bytes()

    def told(run):
        timed = ("wall_s", "steps_per_s")
        return [
            {k: v for k, v in line.items() if k not in timed}
            for line in progress.read_lines(run / progress.METRICS)
        ]

    assert told(whole) == told(parts)
    # episodes of 16 steps end in every second iteration of 8
    assert [line["episodes"] for line in told(whole)] == [0, 8, 0, 8, 0, 8]
    assert told(whole)[0]["episode_return"] is None
    assert told(whole)[1]["episode_return"] < 0
    assert [line["steps"] for line in told(whole)] == [64, 128, 192, 256, 320, 384]


def test_first_interrupt_finishes_the_iteration_and_saves(tmp_path, point_env, batched):
    env = batched(point_env())
    run = tmp_path / "stopped"
    lines = run / progress.METRICS

    def interrupt():
        while not (lines.is_file() and lines.read_text().count("\n") >= 2):
            time.sleep(0.002)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt, daemon=True).start()
    slow = training(env, iterations=2000)
    with pytest.raises(TrainingInterrupted) as stop:
        run_training(slow, run, checkpoint_every_s=1e9, quiet=True)
    assert stop.value.exit_code == 130
    assert f"--resume {run}" in str(stop.value)
    done = checkpoint.iteration_of(checkpoint.find(run))
    assert 2 <= done < 2000
    # the handler of the caller is back
    with pytest.raises(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(1)
    task = training(env, iterations=done)
    straight = run_training(task, tmp_path / "whole", quiet=True)
    assert same(straight, checkpoint.restore(checkpoint.find(run), task.initialise(), CONFIG))


def test_number_that_is_not_finite_stops_with_dump_and_reason(tmp_path, point_env, batched):
    env = batched(point_env(break_at=10))  # the second iteration of unrolls of 8
    names = {"finite_observation": ("x", "y", "fx", "fy")}
    with pytest.raises(TrainingDiverged, match=r"iteration 2: first in the reward") as error:
        run_training(training(env, names=names), tmp_path, quiet=True)
    assert "simulation" in str(error.value)
    dump = checkpoint.find(tmp_path / "diverged")
    assert checkpoint.iteration_of(dump) == 1
    # the dump replays: one iteration from it gives the same fault
    good = training(env)
    state = checkpoint.restore(dump, good.initialise(), CONFIG)
    assert not good.iterate(state)[1]["finite_reward"]


def test_message_names_the_observation(tmp_path):
    def iterate(state):
        return state + 1, {"finite_observation": jnp.asarray([True, False]), "loss": jnp.zeros(())}

    broken = Training(
        title="t",
        initialise=lambda: jnp.zeros(()),
        iterate=iterate,
        iterations=3,
        steps_per_iteration=1,
        policies=lambda s: {},
        config={},
        names={"finite_observation": ("speed", "force_x")},
    )
    with pytest.raises(TrainingDiverged, match=r"observation \(force_x\)"):
        run_training(broken, tmp_path, quiet=True)


def test_going_on_from_the_one_before_a_broken_checkpoint(tmp_path, point_env, batched):
    env = batched(point_env())
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    straight = run_training(training(env, iterations=4), whole, quiet=True)
    run_training(training(env, iterations=3), broken, quiet=True, checkpoint_every_s=0.0)
    before, last = checkpoint.checkpoints(broken)
    victim = max((p for p in (last / "state").rglob("*") if p.is_file()), key=lambda p: p.stat().st_size)
    victim.write_bytes(victim.read_bytes()[:-10])
    with pytest.raises(ValueError, match=f"resume from the one before it: {before}"):
        run_training(training(env, iterations=4), broken, resume=broken, quiet=True)
    resumed = run_training(training(env, iterations=4), broken, resume=before, quiet=True)
    assert same(straight, resumed)
    assert checkpoint.iteration_of(checkpoint.find(broken)) == 4
    # in another folder the run goes on as well, and is whole there even if nothing is left to do
    other = tmp_path / "other"
    run_training(training(env, iterations=4), other, resume=broken, quiet=True)
    assert (other / "policy.npz").read_bytes() == (whole / "policy.npz").read_bytes()


def test_resume_with_other_settings_is_refused(tmp_path, point_env, batched):
    import dataclasses

    env = batched(point_env())
    run_training(training(env, iterations=1), tmp_path, quiet=True)
    other = dataclasses.replace(CONFIG, learning_rate=0.5)
    with pytest.raises(ValueError, match=r"learning_rate: 0.001 in the checkpoint, 0.5 now"):
        run_training(training(env, config=other), tmp_path, resume=tmp_path, quiet=True)


COUNTER = textwrap.dedent(
    """
    import sys, time
    from pathlib import Path
    import jax, jax.numpy as jnp
    from mjx_cutting.learning.loop import Training, TrainingInterrupted, run_training

    def iterate(state):
        def body(i, x):
            return jnp.sin(x @ x) + 0.1
        return jax.lax.fori_loop(0, int(sys.argv[2]), body, state), {"loss": jnp.sum(state)}

    task = Training("t", lambda: jnp.eye(200) * 0.1, iterate, 1000, 1, lambda s: {}, {})
    try:
        run_training(task, Path(sys.argv[1]), checkpoint_every_s=0.0)
    except TrainingInterrupted as stop:
        print(stop, file=sys.stderr)
        sys.exit(stop.exit_code)
    """
)


def start(run, work):
    run.mkdir(exist_ok=True)
    process = subprocess.Popen(
        [sys.executable, "-c", COUNTER, str(run), str(work)], stderr=subprocess.PIPE, text=True
    )
    deadline = time.monotonic() + 120
    while not checkpoint.checkpoints(run) and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)
    return process


def test_process_leaves_with_130_after_ctrl_c_and_with_a_whole_checkpoint(tmp_path):
    process = start(tmp_path / "run", 20)
    process.send_signal(signal.SIGINT)
    _, text = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "go on with --resume" in text
    assert "Traceback" not in text
    found = checkpoint.find(tmp_path / "run")
    checkpoint.restore(found, jnp.zeros((200, 200)), {})


def test_second_ctrl_c_leaves_within_the_iteration(tmp_path):
    process = start(tmp_path / "run", 100)
    before = checkpoint.checkpoints(tmp_path / "run")
    for _ in range(2):
        process.send_signal(signal.SIGINT)
        time.sleep(0.05)
    process.communicate(timeout=60)
    assert process.returncode != 0
    assert before
    checkpoint.restore(checkpoint.find(tmp_path / "run"), jnp.zeros((200, 200)), {})


def test_killed_process_leaves_a_whole_checkpoint(tmp_path):
    process = start(tmp_path / "run", 1)
    time.sleep(0.3)
    process.kill()
    process.communicate(timeout=60)
    checkpoint.restore(checkpoint.find(tmp_path / "run"), jnp.zeros((200, 200)), {})
