"""What cuts in air say of the sensor: its bias and drift, where it was zeroed once a session.

In air nothing is cut, so a level is the sensor's alone. It ties the bias, which in cuts of one kind is not
told from the force of the edge, and drift, which is not told from wear. What spins without cutting has no
mean and stays out of it.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array

from mjx_cutting.cutting import Cut, ForceModel
from mjx_cutting.trials.dataset import Dataset


class Air(eqx.Module):
    """Levels in air. Fields: `cut` conditions, every field [A]; `level_n` [A, 3], N; `samples` [A]."""

    cut: Cut
    level_n: Array
    samples: Array


def air_levels(dataset: Dataset) -> Air | None:
    """Levels of the cuts in air; None without any, or where the sensor was zeroed before each trial."""
    trials = [trial for trial in dataset.trials if trial.kind == "air"]
    if dataset.sensor.zeroed != "session" or not trials:
        return None
    cuts = [
        Cut.milling(
            "slot",
            dataset.tool.diameter_m,
            angle_rad=0.0,
            spindle_speed_rev_s=trial.spindle_speed_rev_s,
            feed_speed_m_s=trial.feed_speed_m_s,
            radial_depth_m=0.0,
            axial_width_m=0.0,
            cut_length_m=trial.cut_length_before_m,
            clock_s=trial.clock_start_s + 0.5 * float(trial.time_s[-1] - trial.time_s[0]),
        )
        for trial in trials
    ]
    return Air(
        cut=jax.tree.map(lambda *leaves: jnp.asarray(leaves, dtype=float), *cuts),
        level_n=jnp.asarray([trial.force_n.mean(axis=0) for trial in trials]),
        samples=jnp.asarray([float(len(trial.time_s)) for trial in trials]),
    )


def left_in_air(air: Air, model: ForceModel, bias_n: Array, weight: Array) -> Array:
    """[A * 3] weighted level that `model` and a bias [3] leave; `weight` [3] is that of one sample, 1/N."""
    sensed = jax.vmap(lambda cut: model.sense(jnp.zeros(3), cut))(air.cut)
    return ((air.level_n - sensed - bias_n) * weight * jnp.sqrt(air.samples)[:, None]).ravel()
