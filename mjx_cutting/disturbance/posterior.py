"""Draws of the disturbance inside the simulation: one function an episode, one short sum a step.

The posterior of the weights w ~ N(m_w, C C') was formed in float64; here it is cast to float32. A reset draws
w = m_w + C z (one product, no factorisation) and a phase; a step is the complex Horner sum
d = w_0 + Re sum_j (a_j - i b_j) z^j, z = e^{i theta}. The phase is a uint32 that wraps at one period:
2^32 counts a turn, so it never loses digits however long the episode, while an accumulated float32 time does.
Its increment round(2^32 f dt) is exact too: f and dt are split into 12-bit pieces whose float32 products have
no rounding error. Rounding the increment costs at most 2^-33 turn a step (3e-7 turn after 2,500 steps).

Modes of a draw: "mean" (the posterior mean, no randomness but the phase), "function" (the common process,
which many trials pin down: nearly the mean), "function_noise" (the same; pass a key to `value` for the
independent noise) and "new_trial" (the common process plus a fresh trial effect: what the next cut will
show).

Breaks when dt is a traced float32: its own rounding (6e-8 relative) then enters; pass a Python float.
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

MODES = ("mean", "function", "function_noise", "new_trial")
_PIECES = 4
_TURN = 4294967296.0


class Draw(NamedTuple):
    """One function of the disturbance and where on it the episode stands; a pytree."""

    weights: Array  # [m, 3] float32, N
    phase: Array  # [] uint32, 2^32 counts a period


class PeriodicPosterior(eqx.Module):
    """The fitted disturbance as the simulation uses it; every leaf float32, so it can be stacked and vmapped.

    Process axes (feed, normal, tool axis), newtons, the force ON THE TOOL.
    """

    mean: Array  # [m, 3] N, weights of [1, cos j theta, sin j theta]
    factor: Array  # [3, m, m] N, C C' is the covariance of the common process
    trial_factor: Array  # [3, m, m] N, likewise with a fresh trial effect added
    noise_std_n: Array  # [3] N, of the independent noise
    frequency_pieces: Array  # [4] Hz, whose sum is the frequency, 12 significant bits each

    @classmethod
    def build(
        cls, mean: NDArray, factor: NDArray, trial_factor: NDArray, noise_std_n: NDArray, frequency_hz: float
    ) -> PeriodicPosterior:
        """Returns the posterior from float64: mean [m, 3], factors [3, m, m], noise [3] (N), frequency.

        Raises:
            ValueError: shapes that do not fit, values that are not finite, a frequency that is not above 0.
        """
        mean, factor, trial_factor = (np.asarray(a, np.float64) for a in (mean, factor, trial_factor))
        noise, m = np.asarray(noise_std_n, np.float64), len(mean)
        shapes = (mean.shape, factor.shape, trial_factor.shape, noise.shape)
        expected = ((m, 3), (3, m, m), (3, m, m), (3,))
        if shapes != expected:
            raise ValueError(f"got shapes {shapes}; expected {expected}; rebuild it from the fit")
        if not all(np.isfinite(a).all() for a in (mean, factor, trial_factor, noise)):
            raise ValueError(
                "the posterior has values that are not finite; fit again and look at its diagnostics"
            )
        if not (np.isfinite(frequency_hz) and frequency_hz > 0):
            raise ValueError(f"got a frequency of {frequency_hz} Hz; expected one above 0")
        return cls(
            mean=jnp.asarray(mean, jnp.float32),
            factor=jnp.asarray(factor, jnp.float32),
            trial_factor=jnp.asarray(trial_factor, jnp.float32),
            noise_std_n=jnp.asarray(noise, jnp.float32),
            frequency_pieces=jnp.asarray(split_exact(float(frequency_hz))),
        )

    @property
    def harmonics(self) -> int:
        return (self.mean.shape[-2] - 1) // 2

    @property
    def frequency_hz(self) -> Array:
        """The frequency [Hz], float32."""
        return jnp.sum(self.frequency_pieces, -1)

    @property
    def period_s(self) -> Array:
        """The period [s], float32."""
        return 1.0 / self.frequency_hz

    def draw(self, key: Array, mode: str = "new_trial", *, random_phase: bool = True) -> Draw:
        """Returns a function of the disturbance for one episode.

        Args:
            key: a JAX key.
            mode: one of `MODES`.
            random_phase: start anywhere in the period; False starts at time 0 of the aligned trials.

        Raises:
            ValueError: an unknown mode.
        """
        if mode not in MODES:
            raise ValueError(f"got mode {mode!r}; expected one of {', '.join(MODES)}")
        for_weights, for_phase = jax.random.split(key)
        weights = self.mean
        if mode != "mean":
            factor = self.trial_factor if mode == "new_trial" else self.factor
            z = jax.random.normal(for_weights, factor.shape[:2], factor.dtype)
            weights = weights + jnp.einsum("aij,aj->ia", factor, z, precision="highest")
        phase = jax.random.bits(for_phase, (), jnp.uint32) if random_phase else jnp.zeros((), jnp.uint32)
        return Draw(weights, phase)

    def value(self, draw: Draw, key: Array | None = None) -> Array:
        """Returns the disturbance force on the tool [3], N, process axes, where the draw now stands.

        Args:
            draw: from `draw` or `advance`.
            key: adds the independent noise of one sample ("function_noise"); None leaves it out.
        """
        value = evaluate(draw.weights, draw.phase)
        if key is not None:
            value = value + self.noise_std_n * jax.random.normal(key, value.shape, value.dtype)
        return value

    def advance(self, draw: Draw, dt_s: ArrayLike) -> Draw:
        """Returns the draw `dt_s` later [s] (at least 0); a Python float keeps the phase exact."""
        return draw._replace(phase=draw.phase + self.increment(dt_s))

    def increment(self, dt_s: ArrayLike) -> Array:
        """Returns the phase increment [] uint32 of a time step [s]: round(2^32 frequency dt) modulo 2^32."""
        steps = (
            split_exact(float(dt_s)) if isinstance(dt_s, int | float) else _split_traced(jnp.asarray(dt_s))
        )
        products = self.frequency_pieces[:, None] * steps[None, :]  # 12 by 12 bits: exact in float32
        counts = (products - jnp.floor(products)) * jnp.float32(_TURN)
        whole = jnp.floor(counts)
        rest = jnp.sum(counts - whole)
        return jnp.sum(whole.astype(jnp.uint32), dtype=jnp.uint32) + jnp.round(rest).astype(jnp.uint32)


def evaluate(weights: Array, phase: Array) -> Array:
    """Returns the sum [k] of weights [2 J + 1, k] at a phase [] uint32."""
    signed = jax.lax.bitcast_convert_type(phase, jnp.int32)
    angle = signed.astype(weights.dtype) * (2.0 * np.pi / _TURN)
    cos, sin = jnp.cos(angle), jnp.sin(angle)
    harmonics = (weights.shape[0] - 1) // 2
    re = im = jnp.zeros_like(weights[0])
    for j in range(harmonics, 0, -1):
        re, im = re + weights[j], im - weights[harmonics + j]
        re, im = re * cos - im * sin, re * sin + im * cos
    return weights[0] + re


def split_exact(value: float) -> NDArray[np.float32]:
    """Returns pieces [4] of at most 12 significant bits whose sum is `value` to 48 bits."""
    pieces = []
    for _ in range(_PIECES):
        if value == 0.0:
            pieces.append(0.0)
            continue
        unit = 2.0 ** (np.floor(np.log2(abs(value))) - 11)
        pieces.append(float(np.trunc(value / unit) * unit))
        value -= pieces[-1]
    return np.asarray(pieces, np.float32)


def _split_traced(value: Array) -> Array:
    """Returns pieces [2] of 12 bits whose sum is the float32 `value` exactly."""
    value = value.astype(jnp.float32)
    bits = jax.lax.bitcast_convert_type(value, jnp.uint32)
    high = jax.lax.bitcast_convert_type(bits & jnp.uint32(0xFFFFF000), jnp.float32)
    return jnp.stack([high, value - high])
