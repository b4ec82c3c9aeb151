"""The fitted disturbance: hyperparameters with their uncertainty, posterior weights, what was found wrong.

A host object in float64 newtons and seconds. `posterior()` hands the simulation its float32 form; `predict`
gives mean and standard deviation anywhere, past the trials too (a periodic process extrapolates for ever,
which is its claim and its risk: read `warnings` and `diagnostics`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.disturbance.kernel import fourier
from mjx_cutting.disturbance.posterior import PeriodicPosterior

if TYPE_CHECKING:
    from mjx_cutting.disturbance.quasiposterior import QuasiPeriodicPosterior

AXES = ("x", "y", "z")
PRUNE = 1e-10

Real = NDArray[np.float64]


@dataclass(frozen=True)
class DisturbanceGP:
    """A periodic Gaussian process fitted to the residual force on the tool, on up to three process axes."""

    axes: tuple[str, ...]  # which of x, y, z, in the order of [A]
    frequency_hz: float  # shared by the axes
    length: Real  # [A] l, dimensionless
    amplitude_n: Real  # [A] s, N
    trial_length: Real  # [A] l of a trial's own process
    trial_amplitude_n: Real  # [A] s of a trial's own process, N; 0 without trial effects
    noise_std_n: Real  # [A] N
    common_std_n: (
        Real  # [A] N, of the common process before any trial: s less what the constant's bound takes
    )
    trial_std_n: Real  # [A] N, likewise of a trial's own process
    harmonics: int  # J
    weights_mean_n: Real  # [A, m] N
    weights_factor_n: Real  # [A, m, m] N
    weights_trial_factor_n: Real  # [A, m, m] N
    trial_means_n: Real  # [R, A, m] N, each fitted trial's own posterior mean
    standard_errors: dict[str, Any]  # Laplace: frequency_hz, period_s, and [A] lists by name
    log_likelihood: float  # nats, of all samples in newtons
    trial_effects: bool
    trials: int
    samples: int  # of each axis
    start_s: float  # first stamp
    span_s: float
    sample_rate_hz: float
    scan_hz: Real  # [F]
    scan_log_likelihood: Real  # [F] best over the lengths, pooled trials, scaled unit
    slow_nodes_s: Real = field(default_factory=lambda: np.zeros(0))  # [q] of a shape that drifts; empty: none
    slow_length_s: float | None = None  # over which the shape drifts; None: it does not
    warnings: tuple[str, ...] = ()
    diagnostics: dict[str, Any] = field(default_factory=dict)
    provenance: dict[str, Any] = field(default_factory=dict)

    @property
    def period_s(self) -> float:
        """The period, s."""
        return 1.0 / self.frequency_hz

    def features(self, time_s: NDArray) -> Real:
        """Returns [N, m] features ([N, m q] if it drifts) at times [N], s, in the clock of the trials."""
        if self.slow_length_s is not None:
            from mjx_cutting.disturbance.quasiperiodic import features

            nodes = self.slow_nodes_s
            return features(time_s, self.frequency_hz, self.harmonics, nodes, self.slow_length_s)
        return fourier(time_s, self.frequency_hz, self.harmonics)

    def predict(self, time_s: NDArray, mode: str = "new_trial") -> tuple[Real, Real]:
        """Returns mean and standard deviation [N, A], N, of the disturbance without its independent noise.

        Args:
            time_s: [N], s, in the clock of the aligned trials.
            mode: "function" (the common process) or "new_trial" (a cut not yet seen).

        Raises:
            ValueError: an unknown mode.
        """
        if mode not in ("function", "new_trial"):
            raise ValueError(f"got mode {mode!r}; expected 'function' or 'new_trial'")
        phi = self.features(time_s)
        factor = self.weights_factor_n if mode == "function" else self.weights_trial_factor_n
        mean = phi @ self.weights_mean_n.T
        deviation = [np.sqrt(np.sum((phi @ each) ** 2, 1)) for each in factor]
        return mean, np.stack(deviation, 1)

    def trial_mean(self, time_s: NDArray) -> Real:
        """Returns [R, N, A], N: what the process says of each fitted trial (common plus its own part)."""
        return np.einsum("nm,ram->rna", self.features(time_s), self.trial_means_n)

    def posterior(self) -> PeriodicPosterior | QuasiPeriodicPosterior:
        """Returns the float32 form for the simulation, on three process axes (an axis not fitted is 0).

        Harmonics that carry less than 1e-10 of the energy are dropped, so a smooth disturbance is cheap.
        """
        if self.slow_length_s is None:
            kept = self.kept_harmonics()
            rows = np.r_[0 : kept + 1, self.harmonics + 1 : self.harmonics + 1 + kept]
        else:
            rows = np.arange(self.weights_mean_n.shape[1])
        m = len(rows)
        mean, noise = np.zeros((m, 3)), np.zeros(3)
        factor, fresh = np.zeros((3, m, m)), np.zeros((3, m, m))
        for a, name in enumerate(self.axes):
            i = AXES.index(name)
            mean[:, i], noise[i] = self.weights_mean_n[a, rows], self.noise_std_n[a]
            factor[i] = _refactor(self.weights_factor_n[a, rows])
            fresh[i] = _refactor(self.weights_trial_factor_n[a, rows])
        periodic = PeriodicPosterior.build(mean, factor, fresh, noise, self.frequency_hz)
        if self.slow_length_s is None:
            return periodic
        from mjx_cutting.disturbance.quasiposterior import QuasiPeriodicPosterior

        step = 1.0 / self.sample_rate_hz
        window = (self.start_s, self.start_s + self.span_s - step)
        return QuasiPeriodicPosterior.build(
            periodic, self.harmonics, self.slow_nodes_s, self.slow_length_s, window
        )

    def kept_harmonics(self) -> int:
        """Returns how many harmonics carry all but 1e-10 of the posterior's energy."""
        J = self.harmonics
        energy = np.sum(self.weights_mean_n**2 + np.sum(self.weights_trial_factor_n**2, -1), 0)
        by_order = energy[1 : J + 1] + energy[J + 1 :]
        beyond = np.cumsum(by_order[::-1])[::-1]
        return max(1, int(np.sum(beyond > PRUNE * energy.sum())))

    def save(self, path: str | Path) -> Path:
        """Returns `path` (.npz), now holding everything: hyperparameters, weights, units, provenance."""
        from mjx_cutting.disturbance.artefact import save

        return save(self, path)

    @staticmethod
    def load(path: str | Path) -> DisturbanceGP:
        """Returns the process saved at `path`; see `artefact.load` for the errors."""
        from mjx_cutting.disturbance.artefact import load

        return load(path)


def _refactor(rows: Real) -> Real:
    """Returns a lower triangular [m, m] with the same C C' as the rows [m, M] of a larger factor."""
    return np.asarray(np.linalg.qr(rows.T, mode="r")).T
