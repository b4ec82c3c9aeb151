"""What the constants of further materials are, in words."""

from __future__ import annotations

import numpy as np

from mjx_cutting.cutting import ForceModel
from mjx_cutting.cutting.material import N_PER_MM, N_PER_MM2
from mjx_cutting.tracing.fitting.sheets import Sheets, materials_of, sheet_of_each
from mjx_cutting.trials.dataset import Dataset


def own_constants(dataset: Dataset, model: ForceModel) -> str | None:
    """The constants that a `model` of the trials has for each material but the first; None where all trials
    are of one."""
    sheets = next((each for each in model.effects if isinstance(each, Sheets)), None)
    if sheets is None:
        return None
    names, trials = materials_of(dataset), np.bincount(sheet_of_each(dataset))
    first = np.concatenate([model.material.chip_n_m2 / N_PER_MM2, model.material.edge_n_m / N_PER_MM])
    parts = []
    for name, count, own in zip(names[1:], trials[1:], np.asarray(sheets.share) * first, strict=True):
        chip, edge = (", ".join(f"{each:.4g}" for each in side) for side in (own[:3], own[3:]))
        parts.append(
            f"sheets of {name!r} ({count} trials) have constants of their own: tangential, radial and axial "
            f"{chip} N/mm^2 of the chip, {edge} N/mm of the edge"
        )
    return "; ".join(parts) + f"; the model saved has those of {names[0]!r}"
