"""Where along its path each drill or turning tool meets the work: depths count from there.

A depth is a depth below the surface. Without a measured place the path begins with the record, which begins
in the air at any distance. A measured one is that of the machine, and two holes need not begin at the same
height: a drill was clamped anew, a plate is not of the same thickness. Which of the two the work goes by, the
trials say: where it goes by the depth below the surface, they are alike there, and not at the same height.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.records.course import along_path
from mjx_cutting.tracing.records.steady import IN_CUT, sizes, steady
from mjx_cutting.trials.dataset import Trial

PLACES_APART_M = 1e-4
_CLEARLY_MORE_ALIKE = 0.5
_PLACES = 100
_FEWEST_PLACES = 10
Array = NDArray[np.floating]


def surfaces_m(trials: Sequence[Trial], fewest_in_air: int) -> dict[str, float]:
    """By file, how far along its path each cut has come when it touches the work, m; empty where one of them
    shows fewer samples in the air, all touch at the same place, or the work goes by the measured place."""
    cuts = [trial for trial in trials if trial.kind == "cut"]
    found = {}
    for trial in cuts:
        size, usual = sizes(trial.force_n)
        first = int(np.argmax(size > IN_CUT * usual))
        if first < fewest_in_air:
            return {}
        found[trial.file] = float(along_path(trial)[first])
    if np.ptp(list(found.values()) or [0.0]) <= PLACES_APART_M:
        return {}
    if all(trial.position_m is None for trial in cuts):
        return found
    as_measured = _unlike(cuts, dict.fromkeys(found, 0.0))
    return found if _unlike(cuts, found) < _CLEARLY_MORE_ALIKE * as_measured else {}


def _unlike(cuts: Sequence[Trial], begins_m: Mapping[str, float]) -> float:
    """Variance over the trials of the force in full engagement, as a share of each one's mean, at places that
    count from `begins_m`; infinite where trials hardly share a place."""
    found = []
    for trial in cuts:
        level = steady(trial.force_n)
        place, (size, _) = along_path(trial)[level] - begins_m[trial.file], sizes(trial.force_n[level])
        order = np.argsort(place)
        found.append((place[order], size[order] / size.mean()))
    places = np.linspace(min(place[0] for place, _ in found), max(place[-1] for place, _ in found), _PLACES)
    table = np.stack([np.interp(places, *each, left=np.nan, right=np.nan) for each in found])
    shared = table[:, np.sum(np.isfinite(table), axis=0) >= 2]
    return float(np.mean(np.nanvar(shared, axis=0))) if shared.shape[1] >= _FEWEST_PLACES else np.inf
