"""No two chips are alike: a force that scatters from tooth to tooth is noise, though the air shows none.

Grain, fibres, a built-up edge that goes with the chip: the force of one tooth is larger by a hundredth than
that of the next, and no model foretells by how much. What repeats with the spindle, and any wave, stands in
lines; this stands between them, and below them as much as beside. Up to a hundredth of the force, what is
left between the lines is counted as noise, in the air or not; more than that asks for a cause.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mjx_cutting.tracing.fitting.prediction import Prediction, energy
from mjx_cutting.tracing.records.noise import power_between_lines

SCATTER = 0.01
"""What the force of one chip may differ by from that of the next, as a share of all force: a limit we set."""


def unlike_chips(
    left: Sequence[Prediction], floor_nrmse: float, rate_hz: float, band_hz: tuple[float, float]
) -> float | None:
    """What is left of the force between the lines, as a share, where that is more than the sensor's noise,
    `floor_nrmse` of the force, by no more than chips scatter; else None.

    Arguments: `left` the cut trials beside the model's predictions.
    """
    between = sum(
        len(each.residual_n) * float(power_between_lines(each.residual_n, rate_hz, band_hz).sum())
        for each in left
    )
    share = float(np.sqrt(between / max(energy([each.measured_n for each in left]), 1e-300)))
    return share if floor_nrmse < share <= float(np.hypot(floor_nrmse, SCATTER)) else None
