"""One draw of everything that differs between episodes, as a pure function of a key: see `draw`."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from mjx_cutting.cutting import Material
from mjx_cutting.sim.config import MODEL_MATERIAL, EnvConfig
from mjx_cutting.sim.materials import MATERIALS

N_MM2, N_MM = 1e6, 1e3


class Episode(NamedTuple):
    """What was drawn; scalars unless said.

    Fields: `material_index` into `config.materials`; `material` constants; `thickness_m` of the sheet;
    `sheet_height_m`, `sheet_slope` errors of the sheet's pose; `bias_n` [3] of the sensor, base axes;
    `gain_factor` [3]; `payload_kg` error of the saw's mass; `spindle_angle_rad` at the start.
    """

    material_index: Array
    material: Material
    thickness_m: Array
    sheet_height_m: Array
    sheet_slope: Array
    bias_n: Array
    gain_factor: Array
    payload_kg: Array
    spindle_angle_rad: Array


def draw(key: Array, config: EnvConfig, model_material: Material | None = None) -> Episode:
    """One episode's conditions, a pure function of its arguments.

    Distributions (each independent unless said):

    * material: uniform over `config.materials`;
    * K_tc, K_te: log-uniform in the ranges of `materials.MATERIALS`; K_re = K_te times a log-uniform ratio;
      K_rc = K_tc times a uniform ratio; K_ac = K_ae = 0 (straight teeth). For "model": the constants given;
    * spindle angle at the start: uniform over a turn;

    and, with `config.randomize` (else all zero):

    * height error of the sheet: normal, `sheet_height_std_m`;
    * slope of the sheet along the feed: normal, `sheet_slope_std`;
    * force bias per axis: normal, `sensor_bias_std_n`;
    * stiffness realised / commanded: 1 + uniform +-`gain_error`, one factor for each axis;
    * error of the saw's mass: uniform +-`payload_error_kg`, at its centre of mass.

    Arguments:
        key: PRNG key.
        config: which materials, and the widths of the distributions.
        model_material: constants for the material "model".

    Raises:
        ValueError: "model" is among the materials but no constants are given.
    """
    if MODEL_MATERIAL in config.materials and model_material is None:
        raise ValueError('materials holds "model" but no force model is given; expected a ForceModel')
    uniform_key, normal_key, index_key = jax.random.split(key, 3)
    uniform = jax.random.uniform(uniform_key, (9,))
    normal = jax.random.normal(normal_key, (5,))
    index = jax.random.randint(index_key, (), 0, len(config.materials))
    on = 1.0 if config.randomize else 0.0
    material, thickness = _material(index, uniform[:4], config, model_material)
    return Episode(
        material_index=index,
        material=material,
        thickness_m=thickness,
        sheet_height_m=on * config.sheet_height_std_m * normal[0],
        sheet_slope=on * config.sheet_slope_std * normal[1],
        bias_n=on * config.sensor_bias_std_n * normal[2:5],
        gain_factor=1.0 + on * config.gain_error * (2.0 * uniform[4:7] - 1.0),
        payload_kg=on * config.payload_error_kg * (2.0 * uniform[7] - 1.0),
        spindle_angle_rad=2.0 * jnp.pi * uniform[8],
    )


def _material(
    index: Array, uniform: Array, config: EnvConfig, model_material: Material | None
) -> tuple[Material, Array]:
    table = np.asarray([_bounds(name) for name in config.materials])
    low, high = jnp.asarray(table[:, 0], float)[index], jnp.asarray(table[:, 1], float)[index]
    value = low[:4] + uniform * (high - low)[:4]
    tangential, edge = jnp.exp(value[0]), jnp.exp(value[1])
    thickness = jnp.asarray(table[:, 0, 4], float)[index]
    drawn = Material(tangential, edge, tangential * value[3], edge * jnp.exp(value[2]), 0.0, 0.0)
    drawn = jax.tree.map(partial(jnp.asarray, dtype=float), drawn)
    if model_material is None or MODEL_MATERIAL not in config.materials:
        return drawn, thickness
    own = index == config.materials.index(MODEL_MATERIAL)
    given = jax.tree.map(partial(jnp.asarray, dtype=float), model_material)
    return jax.tree.map(lambda a, b: jnp.where(own, a, b), given, drawn), thickness


def _bounds(name: str) -> tuple[list[float], list[float]]:
    """Bounds of ln K_tc, ln K_te, ln(K_re/K_te), K_rc/K_tc, and the thickness."""
    limits = MATERIALS["aluminium" if name == MODEL_MATERIAL else name]
    low, high = (
        [
            float(np.log(limits.K_tc_n_mm2[k] * N_MM2)),
            float(np.log(limits.K_te_n_mm[k] * N_MM)),
            float(np.log(limits.edge_ratio[k])),
            limits.chip_ratio[k],
            limits.thickness_m,
        ]
        for k in range(2)
    )
    return low, high
