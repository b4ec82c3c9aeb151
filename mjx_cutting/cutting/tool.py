"""The cutter: what kind it is and the geometry of its teeth.

A mill or a slitting saw has N evenly spaced teeth on a circle of diameter D; tooth j lags tooth 0 by 2 pi j /
N. With a helix angle beta the edge at height z lags by 2 z tan(beta) / D, so the edge is cut into axial
slices. The nominal geometry lives here; deviations from it (runout, unequal pitch, a broken tooth) are
effects.
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

KINDS = ("end_mill", "slitting_saw", "drill", "turning")
HELIX_SLICES = 8


class Tool(eqx.Module):
    """A rotating cutter.

    Fields:
        kind: one of `KINDS`.
        teeth: number of teeth N >= 1.
        diameter_m: [] cutting diameter D, m, > 0.
        helix_rad: [] helix angle beta, rad, |beta| < 1.5; negative for a left-hand helix.
        slices: axial slices per edge; 1 where the edge is straight.

    Raises:
        ValueError: unknown kind, fewer than one tooth, or a diameter or helix out of range.
    """

    kind: str = eqx.field(static=True)
    teeth: int = eqx.field(static=True)
    diameter_m: ArrayLike
    helix_rad: ArrayLike
    slices: int = eqx.field(static=True, default=1)

    def __init__(
        self,
        kind: str,
        teeth: int,
        diameter_m: ArrayLike,
        helix_rad: ArrayLike = 0.0,
        slices: int | None = None,
    ):
        if kind not in KINDS:
            raise ValueError(f"tool kind is {kind!r}; expected one of {', '.join(KINDS)}")
        if int(teeth) != teeth or teeth < 1:
            raise ValueError(f"a tool has a whole number of teeth, at least 1; got {teeth!r}")
        if isinstance(diameter_m, int | float) and not 0.0 < diameter_m < 2.0:
            raise ValueError(
                f"tool diameter is {diameter_m} m; expected metres between 0 and 2 (50 mm is 0.05)"
            )
        if isinstance(helix_rad, int | float) and not abs(helix_rad) < 1.5:
            raise ValueError(f"helix is {helix_rad} rad; expected less than 1.5 rad (45 deg is 0.785)")
        if slices is None:
            straight = isinstance(helix_rad, int | float) and helix_rad == 0.0
            slices = 1 if straight else HELIX_SLICES
        self.kind = kind
        self.teeth = int(teeth)
        self.diameter_m = diameter_m
        self.helix_rad = helix_rad
        self.slices = int(slices)

    @property
    def pitch_rad(self) -> Array:
        """[N] nominal lag of each tooth behind tooth 0, rad."""
        return 2.0 * jnp.pi / self.teeth * jnp.arange(self.teeth)
