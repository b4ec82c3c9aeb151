"""Sheets of several materials in one session: constants of its own for each, beside one tool and one machine.

The six constants of a fit are those of the material of most trials. What those of each other material are of
them, one by one, is fitted beside them as part of every model, and no effect that is looked for: what is read
as a share of the chip's or the edge's force, or of one direction of it, is so of every sheet.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import lru_cache
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from numpy.typing import NDArray

from mjx_cutting.cutting import AbstractEffect, Cut, ForceModel, Material, Tool
from mjx_cutting.trials.dataset import Dataset

_FIELDS = ("K_tc_n_m2", "K_rc_n_m2", "K_ac_n_m2", "K_te_n_m", "K_re_n_m", "K_ae_n_m")
_AXIAL = np.array([False, False, True, False, False, True])


class Sheets(AbstractEffect):
    """Constants of other materials: `share` [M - 1, 6] of the first one's, tangential, radial and axial, of
    the chip, then of the edge."""

    stage = "edge"
    physical = False
    about: ClassVar[tuple[float, ...]] = ()

    share: ArrayLike

    @classmethod
    def size(cls, tool: Tool) -> int:
        return len(_FIELDS) * len(cls.about)

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> Sheets:
        """Coordinates: what each constant is of what all of a material are about, of those in the plane the
        logarithm, since none is negative."""
        own = coordinates.reshape(len(cls.about), len(_FIELDS))
        return cls(jnp.where(_AXIAL, own, jnp.exp(own)) * jnp.asarray(cls.about)[:, None])

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        return np.tile(_AXIAL.astype(float), len(cls.about))[None]

    def constants(self, material: Material, cut: Cut, model: ForceModel) -> Material:
        share = jnp.asarray(self.share)
        every = jnp.concatenate([jnp.ones((1, len(_FIELDS))), share])
        own = every[jnp.asarray(cut.sheet, dtype=int)]
        return Material(
            **{name: getattr(material, name) * own[..., index] for index, name in enumerate(_FIELDS)}
        )


def materials_of(dataset: Dataset) -> tuple[str, ...]:
    """Materials of the cut trials, that of most of them first; trials that name none are of that."""
    often = Counter(
        trial.material for trial in dataset.trials if trial.kind == "cut" and trial.material is not None
    )
    return tuple(name for name, _ in often.most_common())


def sheet_of_each(dataset: Dataset) -> NDArray[np.int64]:
    """[R] which of the materials (`materials_of`) each cut trial is of."""
    names = materials_of(dataset)
    cuts = [trial for trial in dataset.trials if trial.kind == "cut"]
    return np.array([0 if each.material is None else names.index(each.material) for each in cuts], dtype=int)


def sheets_of(dataset: Dataset, rms_n: NDArray[np.floating]) -> tuple[type[Sheets], ...]:
    """What every model of the trials is given; nothing where they are of one material. `rms_n` [R] is the
    size of the force of each over its width of cut."""
    sheet = sheet_of_each(dataset)
    count = int(sheet.max(initial=0)) + 1
    usual = [float(np.median(rms_n[sheet == each])) for each in range(count)]
    about = [2.0 ** round(float(np.log2(max(each, 1e-9) / max(usual[0], 1e-9)))) for each in usual[1:]]
    return (_about(tuple(about)),) if about else ()


@lru_cache
def _about(about: Sequence[float]) -> type[Sheets]:
    """One class for the same numbers, since what is compiled for it serves all."""
    return type("Sheets", (Sheets,), {"about": about})


def of_the_first(model: ForceModel) -> ForceModel:
    """The model of the first material alone."""
    rest = tuple(each for each in model.effects if not isinstance(each, Sheets))
    return ForceModel(model.tool, model.material, rest)
