"""The same likelihood in GPyTorch and celerite2, timed for `disturbance_gp.py`."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tinygp

from mjx_cutting import _platform
from mjx_cutting.disturbance.kernel import prior


def best_seconds(call: Callable[[], Any], repeats: int) -> float:
    """Returns the least time of `repeats` calls after one that is not counted, s."""
    jax.block_until_ready(call())
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        jax.block_until_ready(call())
        times.append(time.perf_counter() - start)
    return min(times)


def gpytorch_seconds(gpytorch: Any, torch: Any, x: Any, y: Any, frequency_hz: float) -> float:
    """Seconds of one exact log likelihood with its gradient in GPyTorch."""

    class Model(gpytorch.models.ExactGP):
        def __init__(self, x, y, likelihood):
            super().__init__(x, y, likelihood)
            self.mean_module = gpytorch.means.ZeroMean()
            self.covar_module = gpytorch.kernels.ScaleKernel(gpytorch.kernels.PeriodicKernel())

        def forward(self, x):
            return gpytorch.distributions.MultivariateNormal(self.mean_module(x), self.covar_module(x))

    tx, ty = torch.tensor(x, dtype=torch.float64), torch.tensor(y, dtype=torch.float64)
    likelihood = gpytorch.likelihoods.GaussianLikelihood().double()
    model = Model(tx, ty, likelihood).double()
    model.covar_module.base_kernel.period_length = 1 / frequency_hz
    model.train()
    marginal = gpytorch.mlls.ExactMarginalLogLikelihood(likelihood, model)

    def once():
        with gpytorch.settings.fast_computations(False, False, False):
            model.zero_grad()
            marginal(model(tx), ty).backward()
        return 0.0

    return best_seconds(once, 2)


def celerite_seconds(celerite2: Any, x: Any, y: Any, frequency_hz: float) -> float:
    """The same finite-rank kernel as 33 undamped terms; repeated times are moved apart by nanoseconds."""
    order = np.argsort(x, kind="stable")
    times = x[order] + 1e-9 * np.arange(len(x))
    c = prior(0.5)[:33] * 0.64
    terms = [celerite2.terms.RealTerm(a=c[0], c=1e-10)]
    for j in range(1, 33):
        terms.append(celerite2.terms.ComplexTerm(a=c[j], b=0.0, c=1e-10, d=2 * np.pi * j * frequency_hz))
    gp = celerite2.GaussianProcess(celerite2.terms.TermSum(*terms))

    def once():
        gp.compute(times, diag=0.25 * np.ones_like(times))
        return gp.log_likelihood(y[order])

    return best_seconds(once, 2)


def peers_seconds(x: Any, y: Any, frequency_hz: float, quick: bool) -> dict[str, Any]:
    """Seconds of one log likelihood (with gradient where the library gives one) in other libraries."""
    found: dict[str, Any] = {}
    n = 500 if quick else 2000
    pick = np.linspace(0, len(x) - 1, n).astype(int)
    xs, ys = x[pick], y[pick]

    def dense(p):
        kernel = p[2] ** 2 * tinygp.kernels.ExpSineSquared(scale=p[0], gamma=2 / p[1] ** 2)
        return tinygp.GaussianProcess(kernel, jnp.asarray(xs), diag=p[3] ** 2).log_probability(
            jnp.asarray(ys)
        )

    with _platform.x64():
        call = jax.jit(jax.value_and_grad(dense))
        at = jnp.asarray([1 / frequency_hz, 0.5, 0.8, 0.5])
        found["tinygp dense"] = {"samples": n, "seconds": best_seconds(lambda: call(at), 2)}
    try:
        from sklearn.gaussian_process import GaussianProcessRegressor
        from sklearn.gaussian_process.kernels import ConstantKernel, ExpSineSquared, WhiteKernel
    except ImportError:
        found["scikit-learn"] = "absent"
    else:
        kernel = ConstantKernel(0.64) * ExpSineSquared(0.5, 1 / frequency_hz) + WhiteKernel(0.25)
        model = GaussianProcessRegressor(kernel, optimizer=None).fit(xs[:, None], ys)
        theta = model.kernel_.theta
        found["scikit-learn"] = {
            "samples": n,
            "seconds": best_seconds(lambda: model.log_marginal_likelihood(theta, eval_gradient=True)[0], 2),
        }
    try:
        import gpytorch
        import torch
    except ImportError:
        found["gpytorch"] = "absent"
    else:
        found["gpytorch"] = {"samples": n, "seconds": gpytorch_seconds(gpytorch, torch, xs, ys, frequency_hz)}
    try:
        import celerite2
    except ImportError:
        found["celerite2"] = "absent"
    else:
        found["celerite2"] = {
            "samples": len(x),
            "seconds": celerite_seconds(celerite2, x, y, frequency_hz),
            "gradient": False,
        }
    return found
