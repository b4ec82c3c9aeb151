"""Simulator of blind trials for the tracing study: NumPy and SciPy, in time, apart from the force path.

    from benchmarks.study import make
    case = make("saw", {"radial_runout": "medium"}, seed=3)   # case.dataset, case.truth

Nothing here imports `mjx_cutting.cutting` or JAX; only the records of
`mjx_cutting.trials.dataset` are shared.
"""

from .designs import DESIGNS
from .generator import Case, make
from .strengths import DRAWS, LEVELS, OUTSIDE

__all__ = ["DESIGNS", "DRAWS", "LEVELS", "OUTSIDE", "Case", "make"]
