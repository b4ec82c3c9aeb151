"""No number that is not finite, whatever is done, over the whole range of constants and gains."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.sim import CuttingEnv, EnvConfig, TrainingWrapper
from tests.optimised import OPTIMISED


def play(batch, steps, hold, seed=0):
    """Sums over a batch of random actions, each held for `hold` steps; half at the range's corners."""
    wrapper = TrainingWrapper(CuttingEnv(EnvConfig()))

    @partial(jax.jit, compiler_options=OPTIMISED)
    def run(key):
        state = wrapper.reset(jax.random.split(key, batch))

        def one(carry, k):
            state, action, sums = carry
            new_key, corner_key = jax.random.split(jax.random.fold_in(key, k))
            new = jax.random.uniform(new_key, (batch, 5), minval=-1.0, maxval=1.0)
            corner = jax.random.bernoulli(corner_key, 0.5, (batch, 1))
            new = jnp.where(corner, jnp.sign(new), new)
            action = jnp.where(k % hold == 0, new, action)
            state = wrapper.step(state, action)
            speed = jnp.abs(state.pipeline_state.qd).max()
            finite = jnp.isfinite(state.obs).all() & jnp.isfinite(state.reward).all()
            sums = {
                "nan": sums["nan"] + state.metrics["nan"].sum(),
                "failed": sums["failed"] + state.metrics["failed"].sum(),
                "ended": sums["ended"] + state.done.sum(),
                "contact_s": sums["contact_s"] + state.metrics["contact_s"].sum(),
                "not_finite": sums["not_finite"] + 1.0 - finite,
                "speed": jnp.maximum(sums["speed"], speed),
            }
            return (state, action, sums), None

        zero = dict.fromkeys(("nan", "failed", "ended", "contact_s", "not_finite", "speed"), 0.0)
        zero = {name: jnp.asarray(value) for name, value in zero.items()}
        start = (state, jnp.zeros((batch, 5)), zero)
        return jax.lax.scan(one, start, jnp.arange(steps))[0][2]

    return {name: float(value) for name, value in run(jax.random.key(seed)).items()}


def check(sums):
    assert sums["nan"] == 0.0 and sums["not_finite"] == 0.0
    assert sums["contact_s"] > 0.0
    assert np.isfinite(sums["speed"]) and sums["speed"] < 20.0


def test_random_actions_stay_finite():
    check(play(batch=64, steps=700, hold=20))


@pytest.mark.slow
def test_ten_thousand_random_actions_in_256_environments_stay_finite():
    sums = play(batch=256, steps=10_000, hold=1)
    check(sums)
    assert sums["ended"] > 256


@pytest.mark.slow
def test_ten_thousand_held_actions_in_256_environments_stay_finite():
    sums = play(batch=256, steps=10_000, hold=40, seed=1)
    check(sums)
    assert sums["failed"] < 0.5 * sums["ended"]
