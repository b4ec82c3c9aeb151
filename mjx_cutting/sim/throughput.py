"""How fast the simulation is, beside its peers, in one run on one machine.

Whole physics steps are counted: dynamics, control, cutting force, sheet, sensor, with payload error and
torque limits live. Ours runs as a user runs it, `jax.jit(jax.vmap(env.step))` in a `lax.scan` of random
actions, with no flag. Rates are the best of several repeats: on a shared machine the others measure the
neighbours.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from mjx_cutting import _platform
from mjx_cutting.sim.config import EnvConfig
from mjx_cutting.sim.env import CuttingEnv

BATCHES = (1, 16, 64, 256, 1024, 4096, 16384)
QUICK_BATCHES = (1, 256, 2048)


def measure_rate(
    env: CuttingEnv, batch: int, seconds: float = 2.0, unroll: int = 25, jit: Callable[..., Any] = jax.jit
) -> dict[str, float]:
    """Rate of one batch size.

    Arguments:
        env: the environment.
        batch: environments at once.
        seconds: how long to measure, s.
        unroll: policy steps in one call.
        jit: which jit; the plain one by default.

    Returns:
        physics_steps_per_s, microseconds_per_step (per environment and physics step), first_call_s, and
        bytes_per_environment: what the compiled call holds at once (state in, state out, work space).
    """
    keys = jax.random.split(jax.random.key(1), unroll)
    step = jax.vmap(env.step)

    def unrolled(state: Any, keys: Any) -> Any:
        def one(state: Any, key: Any) -> tuple[Any, None]:
            return step(state, jax.random.uniform(key, (batch, env.action_size), minval=-1.0)), None

        return jax.lax.scan(one, state, keys)[0]

    reset = jit(jax.vmap(env.reset))
    state = jax.block_until_ready(reset(jax.random.split(jax.random.key(0), batch)))
    start = time.perf_counter()
    run = jit(unrolled).lower(state, keys).compile()
    state = jax.block_until_ready(run(state, keys))
    first = time.perf_counter() - start
    memory = run.memory_analysis()
    held = memory.argument_size_in_bytes + memory.output_size_in_bytes + memory.temp_size_in_bytes
    times: list[float] = []
    begin = time.perf_counter()
    while time.perf_counter() - begin < seconds or len(times) < 3:
        start = time.perf_counter()
        state = jax.block_until_ready(run(state, keys))
        times.append(time.perf_counter() - start)
    steps = batch * unroll * env.config.substeps
    best = min(times)
    return {
        "physics_steps_per_s": steps / best,
        "microseconds_per_step": 1e6 * best / steps,
        "first_call_s": first,
        "bytes_per_environment": held / batch,
    }


def state_bytes(env: CuttingEnv) -> int:
    """Memory of one environment's state, bytes."""
    shapes = jax.eval_shape(env.reset, jax.random.key(0))
    return int(sum(np.prod(x.shape) * _width(x.dtype) for x in jax.tree.leaves(shapes)))


_FIRST_CALL = """
import json, sys, time
start = time.perf_counter()
import jax, jax.numpy as jnp
from mjx_cutting import _platform
if sys.argv[1]:
    _platform.enable_compile_cache(sys.argv[1])
from mjx_cutting.sim import CuttingEnv, EnvConfig
env = CuttingEnv(EnvConfig())
state = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), 256))
jax.block_until_ready(state.obs)
ready = time.perf_counter()
jax.block_until_ready(jax.jit(jax.vmap(env.step))(state, jnp.zeros((256, 5))).obs)
end = time.perf_counter()
print(json.dumps({"step_s": end - ready, "all_s": end - start}))
"""


def measure_first_call() -> dict[str, float]:
    """Seconds of the first `step` call in a fresh process: cold, and from the persistent compile cache."""
    with tempfile.TemporaryDirectory() as folder:
        cold = _fresh("")
        _fresh(folder)
        cached = _fresh(folder)
    return {
        "compile_cold_s": cold["step_s"],
        "compile_cached_s": cached["step_s"],
        "process_cold_s": cold["all_s"],
        "process_cached_s": cached["all_s"],
    }


def compare(
    batches: Sequence[int] = BATCHES,
    *,
    seconds: float = 3.0,
    engines: Sequence[str] = ("fused",),
    peers: bool = True,
    first_call: bool = True,
    say: Callable[[str], None] = lambda line: None,
) -> dict[str, Any]:
    """The whole comparison.

    Arguments:
        batches: batch sizes for our engine; the largest rate is compared with the peers.
        seconds: how long to measure each figure, s.
        engines: which of our engines.
        peers: measure the peers too.
        first_call: measure compile times in fresh processes too.
        say: called with a line after each figure.

    Returns:
        a dictionary ready for JSON: rates by engine and batch, peers, ratios, compile times, machine.
    """
    result: dict[str, Any] = {
        "command": [os.path.basename(sys.argv[0]), *sys.argv[1:]],
        "timing": "best of several repeats: other work on the machine can only slow them",
        "versions": _platform.versions(),
        "machine": machine(),
        "rates": {},
        "peers": {},
    }
    for engine in engines:
        env = CuttingEnv(EnvConfig(engine=engine))
        result["rates"][engine] = {}
        jit = _platform.jit if engine == "mjx" else jax.jit
        for batch in batches:
            figure = measure_rate(env, batch, seconds, jit=jit)
            result["rates"][engine][str(batch)] = figure
            say(f"{engine}, {batch} environments: {figure['physics_steps_per_s']:,.0f} physics steps/s")
        result["state_bytes_per_environment"] = state_bytes(env)
    rates = {int(b): f["physics_steps_per_s"] for b, f in result["rates"][engines[0]].items()}
    result["physics_steps_per_s"] = max(rates.values())
    wide = [rate for batch, rate in rates.items() if batch >= 256]
    result["flatness_256_up"] = max(wide) / min(wide) if wide else None
    if peers:
        from mjx_cutting.sim import peers as others

        result["batch_compared"] = max(rates, key=lambda batch: rates[batch])
        for name, rate in (
            ("gym_one_process", lambda: others.gym_rate(1, seconds)),
            ("gym_two_processes", lambda: others.gym_rate(2, seconds)),
            ("rollout_one_thread", lambda: others.rollout_rate(1, seconds)),
            ("rollout_two_threads", lambda: others.rollout_rate(2, seconds)),
        ):
            result["peers"][name] = rate()
            result[f"ratio_vs_{name}"] = result["physics_steps_per_s"] / result["peers"][name]
            say(f"{name}: {result['peers'][name]:,.0f} physics steps/s")
    if first_call:
        result.update(measure_first_call())
        say(
            f"first step call: {result['compile_cold_s']:.1f} s cold, "
            f"{result['compile_cached_s']:.1f} s cached"
        )
    return result


def table(result: dict[str, Any]) -> str:
    """The comparison as a markdown table."""
    lines = ["| what | environments | physics steps/s | us per step | first call s |", "|-|-|-|-|-|"]
    for engine, rates in result["rates"].items():
        for batch, figure in rates.items():
            lines.append(
                f"| mjx-cutting, {engine} | {batch} | {figure['physics_steps_per_s']:,.0f} | "
                f"{figure['microseconds_per_step']:.3f} | {figure['first_call_s']:.1f} |"
            )
    for name, rate in result["peers"].items():
        lines.append(f"| {name.replace('_', ' ')} | | {rate:,.0f} | {1e6 / rate:.3f} | |")
    told = [
        f"{key.replace('_', ' ')}: {value:.1f}" for key, value in result.items() if key.startswith("ratio_")
    ]
    if result["flatness_256_up"] is not None:
        told.append(f"fastest over slowest from 256 environments up: {result['flatness_256_up']:.2f}")
    told.append(f"state of one environment: {result['state_bytes_per_environment']} bytes")
    if "compile_cold_s" in result:
        cold, cached = result["compile_cold_s"], result["compile_cached_s"]
        told.append(f"first step call in a fresh process: {cold:.1f} s cold, {cached:.1f} s cached")
    return "\n".join([*lines, "", *told])


def machine() -> dict[str, Any]:
    """What the figures were measured on."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    return {
        "processor": platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "load_average_1_min": load,
        "backend": jax.default_backend(),
        "device": str(jax.devices()[0]),
        "device_kind": jax.devices()[0].device_kind,
        "jax": jax.__version__,
    }


def _fresh(cache: str) -> dict[str, float]:
    environment = {k: v for k, v in os.environ.items() if not k.startswith("JAX_COMPILATION_CACHE")}
    environment["TF_CPP_MIN_LOG_LEVEL"] = "3"
    done = subprocess.run(
        [sys.executable, "-c", _FIRST_CALL, cache],
        capture_output=True,
        text=True,
        env=environment,
        check=True,
    )
    return json.loads(done.stdout.strip().splitlines()[-1])


def _width(dtype: Any) -> int:
    return 4 if jnp.issubdtype(dtype, jax.dtypes.prng_key) else np.dtype(dtype).itemsize
