"""What depends on the machine or a library's version: precision, compile cache, compiler options, shims.

Why each is here:

* XLA's CPU fusion emitters recompute a kinematic chain's ancestors exponentially (a thousandfold slower
  `mjx.step`), so `jit` turns them off where the backend is a CPU and its compiler knows the option: jaxlib
  0.11 has neither the option nor the trap. The option is per function: as a process-wide flag it would abort
  a process whose jaxlib does not know it.
* Several OpenBLAS threads under `vmap` are some thirty times slower than one, so this module asks for one,
  unless the user has said otherwise. It works only where this module is imported before NumPy's or SciPy's
  BLAS is loaded.
* brax 0.14.2 calls `jax.device_put_replicated`, which jax 0.10 has removed.
* Compiled programs of XLA's CPU backend take some seventy memory mappings each, of which Linux allows a
  process 65,530; `spare_mappings` drops them before that ends the process.
* Identification wants float64, simulation float32: `x64()` is a context, and nothing sets the flag globally.

JAX is imported inside the functions, so importing this module stays cheap.
"""

from __future__ import annotations

import contextlib
import functools
import importlib.metadata
import io
import os
import platform
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

CPU_COMPILER_OPTIONS = {"xla_cpu_use_fusion_emitters": False}
CPU_OPTIONS_FOR_FEW_CALLS = {
    **CPU_COMPILER_OPTIONS,
    "xla_backend_optimization_level": 0,
    "xla_llvm_disable_expensive_passes": True,
}

_REPORTED = (
    "mjx-cutting", "jax", "jaxlib", "mujoco", "mujoco-mjx", "brax", "flax", "optax", "equinox", "optimistix",
    "tinygp", "orbax-checkpoint", "numpy", "scipy",
)  # fmt: skip


def x64() -> AbstractContextManager[None]:
    """Returns a context in which JAX computes in float64; arrays made outside it keep their dtype."""
    import jax

    return jax.enable_x64(True)


class PlatformJit:
    """A jitted function that takes the CPU compiler options when it is the outermost one on a CPU backend.

    The backend is looked up at the first call, never at import. JAX accepts compiler options only for an
    outermost `jax.jit`; inside another transformation the plain jitted function is used, and the options of
    the outermost one apply. So wrap the outermost function: `jit(vmap(f))`, not `vmap(jit(f))`.
    """

    def __init__(
        self,
        function: Callable[..., Any],
        cpu_options: dict[str, Any] = CPU_COMPILER_OPTIONS,
        **jit_kwargs: Any,
    ):
        functools.update_wrapper(self, function)
        self._function = function
        self._cpu_options = cpu_options
        self._jit_kwargs = jit_kwargs

    @functools.cached_property
    def _nested(self) -> Any:
        import jax

        return jax.jit(self._function, **self._jit_kwargs)

    @functools.cached_property
    def _outermost(self) -> Any:
        import jax

        if jax.default_backend() != "cpu":
            return self._nested
        options = {**known_options(self._cpu_options), **self._jit_kwargs.get("compiler_options", {})}
        return jax.jit(self._function, **{**self._jit_kwargs, "compiler_options": options})

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        return (self._nested if _is_traced((args, kwargs)) else self._outermost)(*args, **kwargs)

    def __get__(self, instance: Any, owner: type | None = None) -> Any:
        return self if instance is None else functools.partial(self, instance)

    def __getattr__(self, name: str) -> Any:
        # lower, trace, eval_shape, clear_cache, ... of the jitted function
        if name.startswith("__") or name in ("_function", "_cpu_options", "_jit_kwargs"):
            raise AttributeError(name)
        return getattr(self._outermost, name)


def jit(function: Callable[..., Any] | None = None, **jit_kwargs: Any) -> Any:
    """Returns `function` jitted, with the CPU's fusion emitters off on a CPU backend; also a decorator.

    Args:
        function: what to compile; left out, a decorator is returned.
        jit_kwargs: keywords of `jax.jit` (static_argnames, donate_argnums, compiler_options, ...).
    """
    if function is None:
        return functools.partial(PlatformJit, **jit_kwargs)
    return PlatformJit(function, **jit_kwargs)


def jit_for_few_calls(function: Callable[..., Any], **jit_kwargs: Any) -> Any:
    """Returns `function` jitted, on a CPU backend without LLVM's optimisation: what runs once, as the making
    of a first state, or seldom against what it takes to compile, is compiled several times as fast and runs
    slower. `jit_kwargs` as of `jit`."""
    return PlatformJit(function, CPU_OPTIONS_FOR_FEW_CALLS, **jit_kwargs)


def known_options(options: dict[str, Any]) -> dict[str, Any]:
    """Returns those compiler options of XLA that this machine's compiler knows: it refuses any other."""
    return {name: value for name, value in options.items() if _is_known(name, value)}


@functools.cache
def _is_known(name: str, value: Any) -> bool:
    import jax

    try:
        jax.jit(lambda: 0, compiler_options={name: value}).lower().compile()
    except jax.errors.JaxRuntimeError as error:
        if "No such compile option" in str(error):
            return False
        raise
    return True


def _is_traced(arguments: Any) -> bool:
    import jax

    if any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(arguments)):
        return True
    # No traced argument, yet possibly inside an outer jit whose tracers come in by closure.
    return isinstance(jax.numpy.zeros(()), jax.core.Tracer)


def patch_brax() -> None:
    """Gives JAX back `device_put_replicated` where missing; to be called before `import brax`.

    It also loads MuJoCo MJX, which brax would, and keeps back what that prints about Warp, an engine not
    used here.
    """
    import jax

    with contextlib.redirect_stdout(io.StringIO()):
        importlib.import_module("mujoco.mjx")
    if hasattr(jax, "device_put_replicated"):
        return
    import numpy as np

    def device_put_replicated(tree: Any, devices: Any) -> Any:
        """Returns `tree` with a new first axis on each leaf: one copy on each device."""
        mesh = jax.sharding.Mesh(np.asarray(list(devices)), ("device",))
        sharding = jax.sharding.NamedSharding(mesh, jax.sharding.PartitionSpec("device"))
        return jax.tree.map(
            lambda leaf: jax.device_put(jax.numpy.stack([jax.numpy.asarray(leaf)] * mesh.size), sharding),
            tree,
        )

    setattr(jax, "device_put_replicated", device_put_replicated)  # noqa: B010 (gone from JAX's own types)


def configure() -> None:
    """Asks for full float32 matrix products: accelerators that default to TF32 ruin training by it."""
    import jax

    jax.config.update("jax_default_matmul_precision", "highest")


def cache_folder() -> Path:
    """Returns this package's cache folder ($MJX_CUTTING_CACHE, else $XDG_CACHE_HOME/mjx-cutting)."""
    own = os.environ.get("MJX_CUTTING_CACHE")
    if own:
        return Path(own).expanduser()
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache").expanduser() / "mjx-cutting"


def enable_compile_cache(path: str | os.PathLike[str] | None = None) -> Path:
    """Returns the folder in which compiled programs are now kept between processes.

    The smallest are kept too: tracing compiles hundreds of them.
    Loading a cached CPU program logs alarming lines about machine features and SIGILL, although the machine
    is the same; they are silenced, which works only before JAX is imported. Called by the command line and
    the experiments, never by the library.

    Args:
        path: the folder; default $JAX_COMPILATION_CACHE_DIR, else `xla` in `cache_folder()`.
    """
    folder = Path(path or os.environ.get("JAX_COMPILATION_CACHE_DIR") or cache_folder() / "xla")
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(folder)
    if "jax" in sys.modules:
        import jax

        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    else:
        os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    return folder


def spare_mappings(most: int = 40_000) -> bool:
    """Drops all compiled programs where the process holds more than `most` memory mappings.

    Returns whether it did. To be called between long computations of ever new shapes; with the compile cache
    on, what is needed again is read back from there.
    """
    try:
        with Path("/proc/self/maps").open(encoding="utf-8", errors="replace") as maps:
            held = sum(1 for _ in maps)
    except OSError:
        return False
    if held <= most:
        return False
    import jax

    jax.clear_caches()
    return True


def versions() -> dict[str, str]:
    """Returns the versions of Python and of the packages whose release can change a figure."""
    found = {"python": platform.python_version()}
    for name in _REPORTED:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found
