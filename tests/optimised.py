"""Options of `jax.jit` for a program that runs for long in a test: as users' are compiled by default."""

from mjx_cutting import _platform

OPTIMISED = _platform.known_options(
    {
        "xla_cpu_use_fusion_emitters": True,
        "xla_backend_optimization_level": 3,
        "xla_llvm_disable_expensive_passes": False,
    }
)
