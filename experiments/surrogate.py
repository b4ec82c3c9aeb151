"""The disturbance that stands in for measured residuals where there are none.

The paper's trials are not public, so what its force model leaves unexplained is not known. Declared
instead, as
ours: 14 trials of 5 s at 500 Hz (the paper's size), each a function common to all trials plus one of its
    own, both
drawn from the periodic process, plus the sensor's noise:

    d_r(t) = g(t) + h_r(t) + e,   g ~ GP(0, s^2 k), h_r ~ GP(0, s_r^2 k),   e ~ N(0, noise^2)

with k(tau) = exp(-2 sin^2(pi tau / p) / l^2). The period is that of a slow structural motion, which a
policy at 50 Hz can see, with harmonics up to about 10 Hz; the magnitude is a third to a half of the
baseline's load.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class Disturbance:
    """A declared disturbance.

    Arguments:
        period_s: p.
        length: l, of the kernel.
        std_n: s of the axes x, y, z of the process frame, N.
        trial_std_n: s_r likewise.
        noise_std_n: of the sensor, N (at most 0.25, 0.25, 0.45 for the Axia80).
        trials, duration_s, rate_hz: of the trials that are fitted.
        seed: which functions.
    """

    period_s: float = 0.47
    length: float = 0.6
    std_n: tuple[float, float, float] = (4.0, 4.0, 1.5)
    trial_std_n: tuple[float, float, float] = (1.5, 1.5, 0.5)
    noise_std_n: tuple[float, float, float] = (0.25, 0.25, 0.45)
    trials: int = 14
    duration_s: float = 5.0
    rate_hz: float = 500.0
    seed: int = 0


def declared_trials(disturbance: Disturbance) -> tuple[np.ndarray, np.ndarray]:
    """Return the stamps [N], s, and the residual forces [trials, N, 3], N, of a declared disturbance."""
    from scipy.special import ive

    d = disturbance
    rng = np.random.default_rng(d.seed)
    time_s = np.arange(round(d.duration_s * d.rate_hz)) / d.rate_hz
    orders = np.arange(21)
    # The kernel's Fourier series: e^-k I_0(k), 2 e^-k I_j(k), k = 1 / l^2.
    share = np.where(orders == 0, 1.0, 2.0) * ive(orders, 1.0 / d.length**2)
    angle = 2 * np.pi * time_s[:, None] * orders / d.period_s
    features = np.concatenate([np.cos(angle), np.sin(angle)], axis=1) * np.sqrt(np.tile(share, 2))
    common = features @ rng.standard_normal((features.shape[1], 3)) * d.std_n
    own = (
        np.einsum("nf,rfa->rna", features, rng.standard_normal((d.trials, features.shape[1], 3)))
        * d.trial_std_n
    )
    noise = rng.standard_normal((d.trials, len(time_s), 3)) * d.noise_std_n
    return time_s, common + own + noise


def fit_declared(disturbance: Disturbance, path: Path) -> Path:
    """Fit the disturbance model to a declared disturbance, write it to `path` (npz), and return the path."""
    from mjx_cutting.disturbance import fit

    time_s, residual_n = declared_trials(disturbance)
    gp = fit(time_s, residual_n, diagnose=False, provenance={"declared": str(disturbance)})
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    gp.save(path)
    return Path(path)
