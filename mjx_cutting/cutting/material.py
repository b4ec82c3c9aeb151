"""Mechanistic constants of the sheet: force = width x (edge constant + chip constant x chip thickness).

K_tc, K_rc, K_ac are the tangential, radial and axial chip ("shearing") constants, K_te, K_re, K_ae the edge
("rubbing") constants, as in Altintas, Manufacturing Automation, 2nd ed. (2012), section 2.8. The constants
are taken not to depend on thickness, speed or wear; where they do, that is an effect.
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

N_PER_MM2 = 1e6
N_PER_MM = 1e3


class Material(eqx.Module):
    """Six mechanistic constants.

    Fields: `K_tc_n_m2`, `K_rc_n_m2`, `K_ac_n_m2` in N/m^2 (1 N/mm^2 = 1e6 N/m^2); `K_te_n_m`, `K_re_n_m`,
    `K_ae_n_m` in N/m (1 N/mm = 1e3 N/m); each scalar or batched.
    """

    K_tc_n_m2: ArrayLike
    K_te_n_m: ArrayLike
    K_rc_n_m2: ArrayLike
    K_re_n_m: ArrayLike
    K_ac_n_m2: ArrayLike = 0.0
    K_ae_n_m: ArrayLike = 0.0

    @classmethod
    def from_n_mm(
        cls,
        K_tc: ArrayLike,
        K_te: ArrayLike,
        K_rc: ArrayLike,
        K_re: ArrayLike,
        K_ac: ArrayLike = 0.0,
        K_ae: ArrayLike = 0.0,
    ) -> Material:
        """A material from constants in the units of the literature: chip N/mm^2, edge N/mm."""
        chip, edge = N_PER_MM2, N_PER_MM
        return cls(
            jnp.asarray(K_tc) * chip,
            jnp.asarray(K_te) * edge,
            jnp.asarray(K_rc) * chip,
            jnp.asarray(K_re) * edge,
            jnp.asarray(K_ac) * chip,
            jnp.asarray(K_ae) * edge,
        )

    @property
    def chip_n_m2(self) -> Array:
        """[..., 3] tangential, radial and axial chip constants, N/m^2."""
        return _stack(self.K_tc_n_m2, self.K_rc_n_m2, self.K_ac_n_m2)

    @property
    def edge_n_m(self) -> Array:
        """[..., 3] tangential, radial and axial edge constants, N/m."""
        return _stack(self.K_te_n_m, self.K_re_n_m, self.K_ae_n_m)


def _stack(*columns: ArrayLike) -> Array:
    return jnp.stack(jnp.broadcast_arrays(*map(jnp.asarray, columns)), axis=-1)
