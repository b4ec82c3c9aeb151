"""What the force model leaves unexplained, as a periodic Gaussian process fitted to trials and drawn in
simulation.

    gp = fit(time_s, residual_n)          # [N], [R, N, 3]: seconds and newtons, exact likelihood, float64
    gp.save("disturbance.npz")
    posterior = load("disturbance.npz").posterior()   # float32, in-graph
    draw = posterior.draw(key)            # one function an episode
    force_n = posterior.value(draw)       # [3], process axes
    draw = posterior.advance(draw, 0.002)

Names are loaded when first asked for, so importing this package costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mjx_cutting.disturbance.artefact import load as load
    from mjx_cutting.disturbance.fitting import fit as fit
    from mjx_cutting.disturbance.gp import DisturbanceGP as DisturbanceGP
    from mjx_cutting.disturbance.kernel import PeriodicKernel as PeriodicKernel
    from mjx_cutting.disturbance.posterior import Draw as Draw
    from mjx_cutting.disturbance.posterior import PeriodicPosterior as PeriodicPosterior
    from mjx_cutting.disturbance.solver import FiniteRankSolver as FiniteRankSolver
    from mjx_cutting.disturbance.statistics import Statistics as Statistics
    from mjx_cutting.disturbance.statistics import reduce as reduce

_WHERE = {
    "fit": "fitting",
    "load": "artefact",
    "DisturbanceGP": "gp",
    "PeriodicKernel": "kernel",
    "PeriodicPosterior": "posterior",
    "Draw": "posterior",
    "FiniteRankSolver": "solver",
    "Statistics": "statistics",
    "reduce": "statistics",
}

__all__ = sorted(_WHERE)


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(importlib.import_module(f"{__name__}.{_WHERE[name]}"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return [*globals(), *__all__]
