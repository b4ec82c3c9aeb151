"""The runtime: refuses what it cannot act on, keeps to limits and rates, starts light."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from mjx_cutting.deploy.export import build
from mjx_cutting.deploy.runtime import PolicyRuntime
from mjx_cutting.learning.policy import Policy


@pytest.fixture
def runtime(policy: Policy) -> PolicyRuntime:
    return PolicyRuntime(build(policy, pairs=4))


def edges(runtime: PolicyRuntime) -> tuple[np.ndarray, np.ndarray]:
    """Observations beyond which the runtime clips, in physical units."""
    a = runtime.artefact
    scale = np.asarray(a.observation_scales)
    return (a.mean - a.clip * a.std) * scale, (a.mean + a.clip * a.std) * scale


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_value_that_is_not_finite_is_named(runtime: PolicyRuntime, value: float) -> None:
    observation = np.zeros(15)
    observation[3] = value
    with pytest.raises(ValueError, match=r"not finite in o3; expected finite"):
        runtime(observation)


@pytest.mark.parametrize("shape", [(14,), (16,), (1, 15), ()])
def test_wrong_shape(runtime: PolicyRuntime, shape: tuple[int, ...]) -> None:
    with pytest.raises(
        ValueError, match=r"got an observation of shape .* expected real numbers of shape \(15,\): o0"
    ):
        runtime(np.zeros(shape))


@pytest.mark.parametrize("observation", [["a"] * 15, [None] * 15, [1j] * 15, [True] * 15])
def test_wrong_kind(runtime: PolicyRuntime, observation: list[object]) -> None:
    with pytest.raises(ValueError, match="expected real numbers"):
        runtime(np.asarray(observation))


def test_calls_do_not_share_results(runtime: PolicyRuntime) -> None:
    low, high = edges(runtime)
    first = runtime(low)
    kept = first.copy()
    second = runtime(high)
    np.testing.assert_array_equal(first, kept)
    assert not np.array_equal(first, second)
    np.testing.assert_array_equal(runtime(low), kept)


def test_dtype_of_the_observation_does_not_matter(runtime: PolicyRuntime) -> None:
    observation = runtime.artefact.mean
    np.testing.assert_array_equal(runtime(observation.astype(np.float64)), runtime(observation))
    assert runtime(observation.tolist()).dtype == np.float32


def test_beyond_the_clip_is_as_at_its_edge(runtime: PolicyRuntime) -> None:
    low, high = edges(runtime)
    np.testing.assert_allclose(runtime(high + 100 * (high - low)), runtime(high), atol=1e-6)
    np.testing.assert_allclose(runtime(np.full(15, -1e300)), runtime(low), atol=1e-6)


def test_set_points_at_the_ends_and_the_middle(runtime: PolicyRuntime) -> None:
    a = runtime.artefact
    np.testing.assert_allclose(runtime.set_point(-np.ones(5)), a.action_low, rtol=1e-12)
    np.testing.assert_allclose(runtime.set_point(np.ones(5)), a.action_high, rtol=1e-12)
    middle = runtime.set_point(np.zeros(5))
    np.testing.assert_allclose(middle, [np.sqrt(50 * 3000)] * 3 + [0.1, 0.001], rtol=1e-12)
    np.testing.assert_allclose(runtime.set_point(np.full(5, 7.0)), a.action_high)


def test_set_point_moves_no_faster_than_its_rate(runtime: PolicyRuntime) -> None:
    now = np.asarray(runtime.artefact.action_initial)
    up = runtime.advance(now, np.ones(5))
    np.testing.assert_allclose(up[:3], np.minimum(now[:3] * np.exp(5.0 * 0.02), 3000.0))
    assert up[3] == pytest.approx(2.0 * 0.02)
    assert up[4] == pytest.approx(0.002)  # no limit of its rate
    for _ in range(200):
        up = runtime.advance(up, np.ones(5))
    np.testing.assert_allclose(up, runtime.artefact.action_high)


def test_import_is_light() -> None:
    code = (
        "import time; t = time.process_time()\n"
        "import mjx_cutting.deploy.runtime\n"
        "import sys, json, pathlib\n"
        "lines = pathlib.Path('/proc/self/status').read_text().splitlines()\n"
        "status = dict(line.split(':', 1) for line in lines)\n"
        "print(json.dumps([time.process_time() - t, sorted(m for m in sys.modules if '.' not in m),"
        " int(status['VmHWM'].split()[0]) / 1024]))"
    )
    runs = []
    for _ in range(3):
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stderr
        runs.append(json.loads(done.stdout))
    assert not {"jax", "jaxlib", "scipy", "mujoco", "flax", "matplotlib", "equinox"} & set(runs[0][1])
    assert min(seconds for seconds, _, _ in runs) < 0.5
    assert runs[0][2] < 100.0  # MB


def test_one_action_takes_far_less_than_the_policy_period(runtime: PolicyRuntime) -> None:
    observation = np.asarray(runtime.artefact.mean)
    best = np.inf
    for _ in range(200):
        start = time.perf_counter()
        runtime(observation)
        best = min(best, time.perf_counter() - start)
    assert best < 0.1 * runtime.artefact.policy_period_s


def test_no_memory_grows(runtime: PolicyRuntime) -> None:
    import tracemalloc

    observation = np.asarray(runtime.artefact.mean)
    runtime(observation)
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    for _ in range(2000):
        runtime(observation)
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 4096


def test_one_blas_thread_is_asked_for(tmp_path: Path) -> None:
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    code = "import mjx_cutting.deploy.runtime, os; print(os.environ['OPENBLAS_NUM_THREADS'])"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment, timeout=60
    )
    assert done.stdout.strip() == "1"
