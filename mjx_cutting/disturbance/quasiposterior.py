"""Draws of the drifting disturbance inside the simulation; the interface of `posterior`.

Only the window of the trials was seen. The slow time therefore runs forth and back over it (a triangle
wave, itself a wrapping uint32), so an episode longer than the trials never leaves what was learned. The
slow features are Chebyshev polynomials there, because their Nystroem form loses its digits in float32. A
step sums m times K terms where the plain periodic process sums m.
"""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from numpy.typing import NDArray

from mjx_cutting.disturbance.posterior import PeriodicPosterior, evaluate, split_exact
from mjx_cutting.disturbance.quasiperiodic import slow_features_host


class QuasiDraw(NamedTuple):
    """One drifting function and where on it the episode stands; a pytree."""

    weights: Array  # [m, K, 3] float32, N
    phase: Array  # [] uint32, 2^32 counts a period
    slow: Array  # [] uint32, 2^32 counts twice the window: forth and back


class QuasiPeriodicPosterior(eqx.Module):
    """The drifting disturbance as the simulation uses it; the interface of `PeriodicPosterior`."""

    periodic: PeriodicPosterior  # weights of the Kronecker features, [m q, 3]; its phase arithmetic
    polynomial: Array  # [q, K] Chebyshev coefficients of the slow features on the window
    slow_pieces: Array  # [4] Hz, one over twice the window
    harmonics: int = eqx.field(static=True)

    @classmethod
    def build(
        cls,
        periodic: PeriodicPosterior,
        harmonics: int,
        nodes_s: NDArray,
        slow_length_s: float,
        window_s: tuple[float, float],
    ) -> QuasiPeriodicPosterior:
        """Returns the posterior; `periodic` holds the Kronecker weights, `window_s` what was seen."""
        low, high = window_s
        degree = 2 * len(nodes_s)
        x = -np.cos(np.pi * (np.arange(degree) + 0.5) / degree)
        psi = slow_features_host(
            0.5 * (low + high) + 0.5 * (high - low) * x, np.asarray(nodes_s), slow_length_s
        )
        polynomial = np.polynomial.chebyshev.chebfit(x, psi, degree - 1).T
        slow = jnp.asarray(split_exact(0.5 / (high - low)))
        return cls(periodic, jnp.asarray(polynomial, jnp.float32), slow, harmonics)

    @property
    def frequency_hz(self) -> Array:
        """The frequency [Hz], float32."""
        return self.periodic.frequency_hz

    @property
    def period_s(self) -> Array:
        """The period [s], float32."""
        return self.periodic.period_s

    @property
    def noise_std_n(self) -> Array:
        """The independent noise [3], N."""
        return self.periodic.noise_std_n

    def draw(self, key: Array, mode: str = "new_trial", *, random_phase: bool = True) -> QuasiDraw:
        """Returns a function that starts where the trials started; see `PeriodicPosterior.draw`."""
        flat = self.periodic.draw(key, mode, random_phase=random_phase)
        q = self.polynomial.shape[0]
        weights = flat.weights.reshape(2 * self.harmonics + 1, q, 3)
        folded = jnp.einsum("mqa,qk->mka", weights, self.polynomial, precision="highest")
        return QuasiDraw(folded, flat.phase, jnp.zeros((), jnp.uint32))

    def value(self, draw: QuasiDraw, key: Array | None = None) -> Array:
        """Returns the force on the tool [3], N, process axes; a key adds the independent noise."""
        signed = jax.lax.bitcast_convert_type(draw.slow, jnp.int32).astype(draw.weights.dtype) / 2.0**31
        x = 2.0 * jnp.abs(signed) - 1.0
        polynomials = [jnp.ones_like(x), x]
        while len(polynomials) < draw.weights.shape[1]:
            polynomials.append(2.0 * x * polynomials[-1] - polynomials[-2])
        now = jnp.einsum("mka,k->ma", draw.weights, jnp.stack(polynomials), precision="highest")
        value = evaluate(now, draw.phase)
        if key is not None:
            value = value + self.noise_std_n * jax.random.normal(key, value.shape, value.dtype)
        return value

    def advance(self, draw: QuasiDraw, dt_s: ArrayLike) -> QuasiDraw:
        """Returns the draw `dt_s` later [s]; past the window the slow time runs back."""
        fast = self.periodic.increment(dt_s)
        slow = eqx.tree_at(lambda p: p.frequency_pieces, self.periodic, self.slow_pieces).increment(dt_s)
        return draw._replace(phase=draw.phase + fast, slow=draw.slow + slow)
