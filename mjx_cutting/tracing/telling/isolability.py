"""What the trials at hand can show, and what they can tell apart, before anything is attributed.

From the first screening: each effect's survival (the part of its mark on the lines that refitting the base
model cannot imitate) and the cosine between what survives of two effects. Near 0 an effect cannot be shown by
these trials; a pair with a cosine near 1 cannot be told apart by them, whatever is found.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.naming.search import Search


@dataclass(frozen=True, eq=False)
class Isolability:
    """Effects by name with `survival` [E] and the absolute `cosine` [E, E] between what survives."""

    names: tuple[str, ...]
    survival: NDArray[np.floating]
    cosine: NDArray[np.floating]

    def to_dict(self) -> dict[str, Any]:
        """A plain dictionary, ready for a JSON file."""
        return {
            "effects": list(self.names),
            "survival": np.round(self.survival, 4).tolist(),
            "cosine": np.round(self.cosine, 4).tolist(),
        }


def isolability(search: Search) -> Isolability | None:
    """Isolability of the effects screened beside the base model, by name; None where none was."""
    if not search.rounds or not search.rounds[0].screened:
        return None
    screened = sorted(search.rounds[0].screened, key=lambda each: each.kind.name)
    directions = np.stack([each.direction for each in screened])
    return Isolability(
        tuple(each.kind.name for each in screened),
        np.array([each.survival for each in screened]),
        np.abs(directions @ directions.T),
    )
