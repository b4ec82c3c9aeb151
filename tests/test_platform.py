"""The shims do what they say, and nothing is set globally behind a user's back."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting import _platform


def test_x64_is_only_inside_the_context() -> None:
    with _platform.x64():
        assert jnp.ones(2).dtype == jnp.float64
    assert jnp.ones(2).dtype == jnp.float32


@_platform.jit
def _squares(x: jax.Array) -> jax.Array:
    """Sum of squares."""
    return jnp.sum(x**2)


def test_jit_equals_the_function_at_top_level_and_nested() -> None:
    x = jnp.arange(3.0)
    assert _squares(x) == 5.0
    np.testing.assert_allclose(jax.grad(_squares)(x), 2 * x)
    np.testing.assert_allclose(jax.vmap(_squares)(jnp.stack([x, 2 * x])), [5.0, 20.0])
    assert jax.jit(lambda y: _squares(y) + 1)(x) == 6.0
    assert jax.jit(lambda y: _squares(x) + y)(1.0) == 6.0  # traced by closure alone


def test_jit_keeps_name_and_doc_and_compiles_once() -> None:
    traces = []

    @_platform.jit
    def counted(x: jax.Array) -> jax.Array:
        """Doc."""
        traces.append(x)
        return x + 1

    counted(jnp.zeros(2))
    counted(jnp.ones(2))
    assert len(traces) == 1
    assert counted.__name__ == "counted" and counted.__doc__ == "Doc."
    assert counted.lower(jnp.zeros(2)).compile() is not None


def test_jit_takes_static_arguments_and_methods() -> None:
    class Scaled:
        @_platform.jit
        def twice(x: jax.Array) -> jax.Array:  # an array stands in for self
            return 2 * x

    powered = _platform.jit(lambda x, n: x**n, static_argnames="n")
    assert powered(jnp.float32(3.0), n=2) == 9.0
    assert _platform.jit(static_argnums=1)(lambda x, n: x * n)(jnp.float32(3.0), 2) == 6.0
    assert Scaled.twice(jnp.float32(2.0)) == 4.0


def test_cpu_compiler_options_are_set() -> None:
    if jax.default_backend() != "cpu":
        pytest.skip("the option exists only for the CPU backend")
    assert _platform.CPU_COMPILER_OPTIONS == {"xla_cpu_use_fusion_emitters": False}
    known = _platform.known_options({**_platform.CPU_OPTIONS_FOR_FEW_CALLS, "no_such_option": 1})
    assert known.get("xla_cpu_use_fusion_emitters", False) is False
    assert ("xla_cpu_use_fusion_emitters" in known) == (jax.__version_info__ < (0, 11))
    assert known["xla_backend_optimization_level"] == 0 and "no_such_option" not in known
    with pytest.raises(Exception, match="no_such_option"):
        _platform.jit(lambda x: x, compiler_options={"no_such_option": 1})(1.0)


def test_brax_finds_what_jax_dropped() -> None:
    _platform.patch_brax()
    shim = jax.device_put_replicated
    _platform.patch_brax()
    assert jax.device_put_replicated is shim
    tree = jax.device_put_replicated({"a": jnp.arange(3.0)}, jax.local_devices())
    assert tree["a"].shape == (len(jax.local_devices()), 3)


def test_compile_cache_is_written_and_read_quietly(tmp_path: Path) -> None:
    code = (
        "from mjx_cutting import _platform; _platform.enable_compile_cache(); import jax, jax.numpy as jnp\n"
        "f = jax.jit(lambda x: jnp.linalg.inv(x @ x.T + jnp.eye(20)).sum())\n"
        "print(float(f(jnp.ones((20, 20)))))"
    )
    environment = {**os.environ, "JAX_COMPILATION_CACHE_DIR": str(tmp_path / "xla")}
    environment.pop("TF_CPP_MIN_LOG_LEVEL", None)
    environment.pop("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", None)
    outputs = []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, env=environment
        )
        assert done.returncode == 0, done.stderr
        assert "SIGILL" not in done.stderr
        outputs.append(done.stdout)
    assert outputs[0] == outputs[1]
    assert any((tmp_path / "xla").iterdir())


def test_importing_the_platform_loads_no_jax_and_asks_for_one_blas_thread() -> None:
    code = (
        "import os, sys, mjx_cutting._platform\n"
        "print('jax' in sys.modules, os.environ['OPENBLAS_NUM_THREADS'])"
    )
    environment = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, env=environment
    )
    assert done.stdout.split() == ["False", "1"]


def test_versions_name_what_can_change_a_figure() -> None:
    found = _platform.versions()
    assert found["jax"] == jax.__version__
    assert found["mujoco"] == found["mujoco-mjx"] == "3.17.0"


def test_compiled_programs_are_dropped_only_when_mappings_run_short() -> None:
    doubled = jax.jit(lambda x: 2.0 * x)
    doubled(1.0)
    assert not _platform.spare_mappings(most=10**6)
    assert doubled._cache_size() == 1
    assert _platform.spare_mappings(most=1)
    assert doubled._cache_size() == 0
