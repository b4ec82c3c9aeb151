"""Does a helix smear what the teeth do at entry and exit, or does whatever reads the force?

An amplifier that settles, a converter that averages while it reads, a simulation that steps: each smears a
sharp entry over a small part of the time between two samples, and says so nowhere. A record whose high orders
fold back shows it, as a helix would. So a correction of the helix counts only where the edge takes longer to
arrive than that.
"""

from __future__ import annotations

import numpy as np

from mjx_cutting.cutting.effects.helix_lag import HelixLag
from mjx_cutting.tracing.guards.gain import Gain

_OF_A_SAMPLE = 0.1


def rather_the_reading(gain: Gain) -> str | None:
    """Why a correction of the helix is refused that moves no part of an edge by a tenth of the time between
    two samples in any trial; None where it does, or is no such correction."""
    problem = gain.problem
    correction = gain.found.model.effects[len(gain.others)]
    if not isinstance(correction, HelixLag):
        return None
    stated, corrected = (
        np.tan(np.asarray(problem.tool.helix_rad) + more) for more in (0.0, np.asarray(correction.helix_rad))
    )
    width_m, speed_rev_s = (
        np.asarray(each) for each in (problem.cut.axial_width_m, problem.cut.spindle_speed_rev_s)
    )
    turn = np.abs(corrected - stated) * width_m / (np.pi * np.asarray(problem.tool.diameter_m))
    lag_s = float(np.max(turn / speed_rev_s))
    samples = lag_s * gain.lines.dataset.sensor.sample_rate_hz
    if samples >= _OF_A_SAMPLE:
        return None
    return (
        f"moves an edge by {lag_s * 1e6:.3g} us at most, {samples:.1%} of the time between two samples: "
        "whatever reads the force may smear it as much"
    )
