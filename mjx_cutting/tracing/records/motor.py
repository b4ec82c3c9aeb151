"""The speeds of a session's trials: each within a hundredth of the stated one, or as one motor gives way.

A motor that gives way under load runs several per cent slow. No trial is searched that far by itself: many
combs share lines (with N teeth, one N / (N + 1) as fast holds tooth passing too, at order N + 1; a sampled
one may mirror another). The session is searched for ONE motor instead: f = f_0 - c A / f - e B, with A and B
what geometry says of the torque of chip and edge, and every trial within `SPREAD` of it. The nominal speeds
are left only where that law collects clearly more energy over the session.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d
from scipy.optimize import nnls

from mjx_cutting.cutting import arc
from mjx_cutting.tracing.records.comb import (
    SPREAD,
    candidate_speeds,
    coarse_power,
    most_power,
    orders_told,
    weights_of,
    windowed,
)
from mjx_cutting.tracing.records.spindle import spindle_speed, stated_speed
from mjx_cutting.trials.dataset import AntiAlias, ToolInfo, Trial

Array = NDArray[np.floating]
SLOWEST = 0.35
_LAW_OFF = 1.3
_OF_A_TOOTH = 0.5
_LOSS_STEP = 0.004
_EDGE_SHARES = np.linspace(0.0, 0.9, 10)
_OVER_NOISE = 10.0
_CLEARLY_TRIALS = 1.0


def spindle_speeds(trials: Sequence[Trial], tool: ToolInfo, alias: AntiAlias | None) -> Array:
    """[R] speeds of the cut trials of a session behind a filter that is known, if any, rev/s, the motor's
    giving way looked for."""
    stated = np.array([stated_speed(trial) for trial in trials])
    about = loaded_speeds(trials, tool, alias)
    found = _about(trials, tool.teeth, alias, about)
    if np.array_equal(about, stated):
        return found
    # the law's grid is coarse: once more, about the motor that fits what was found
    chip, edge = _all_loads(trials, tool)
    columns = np.stack([chip / found, edge, stated, -stated], axis=1)
    weights, _ = nnls(columns, stated - found)
    # what the law says is off too; but many teeth leave no room before the comb of one tooth more
    spread = max(SPREAD, min(_LAW_OFF * SPREAD, _OF_A_TOOTH / tool.teeth))
    return _about(trials, tool.teeth, alias, stated - columns @ weights, spread)


def _about(
    trials: Sequence[Trial],
    teeth: int,
    alias: AntiAlias | None,
    middle_rev_s: Array,
    spread: float = SPREAD,
) -> Array:
    pairs = zip(trials, middle_rev_s, strict=True)
    return np.array([spindle_speed(trial, teeth, alias, float(f), spread) for trial, f in pairs])


def loaded_speeds(trials: Sequence[Trial], tool: ToolInfo, alias: AntiAlias | None) -> Array:
    """[R] stated speeds, or those of the motor that gives way whose combs collect clearly more energy.

    Energy is counted in trials: one whose comb holds all it can counts 1.
    """
    stated = np.array([stated_speed(trial) for trial in trials])
    if any(trial.spindle_angle_rad is not None for trial in trials) or len(trials) < 3:
        return stated
    chip, edge = _all_loads(trials, tool)
    found = [_within_reach(trial, tool.teeth, alias) for trial in trials]
    if not np.all(chip > 0.0) or any(one is None for one in found):
        return stated

    def collected(speeds: Array) -> float:
        return sum(float(np.interp(f, *one)) for f, one in zip(speeds, found, strict=True) if one)

    heaviest = int(
        np.argmax(chip / stated**2 / np.median(chip / stated**2) + edge / stated / np.median(edge))
    )
    best, most = stated, collected(stated)
    at_rest = most
    for loss in np.arange(_LOSS_STEP, SLOWEST - SPREAD, _LOSS_STEP):
        slowed = stated[heaviest] * (1.0 - loss)
        for share in _EDGE_SHARES:
            lost = loss * stated[heaviest]
            c, e = (1.0 - share) * lost * slowed / chip[heaviest], share * lost / edge[heaviest]
            left = stated - e * edge
            inner = left**2 - 4.0 * c * chip
            if np.any(inner <= 0.0) or np.any(left <= 0.0):
                continue
            speeds = 0.5 * (left + np.sqrt(inner))
            energy = collected(speeds)
            if energy > most:
                best, most = speeds, energy
    return best if most > at_rest + _CLEARLY_TRIALS else stated


def _all_loads(trials: Sequence[Trial], tool: ToolInfo) -> tuple[Array, Array]:
    chip, edge = zip(*(_loads(trial, tool) for trial in trials), strict=True)
    return np.array(chip), np.array(edge)


def _loads(trial: Trial, tool: ToolInfo) -> tuple[float, float]:
    """Geometry's part of the mean torque: of the chip, times the speed, and of the edge."""
    depth = tool.diameter_m if trial.milling == "slot" else trial.radial_depth_m
    entry, exit_ = arc(trial.milling or "slot", trial.radial_depth_m, tool.diameter_m)
    chip = depth * trial.axial_width_m * trial.feed_speed_m_s
    return chip, trial.axial_width_m * float(exit_ - entry)


def _within_reach(trial: Trial, teeth: int, alias: AntiAlias | None) -> tuple[Array, Array] | None:
    """Speeds down to `SLOWEST` below the stated one, and the energy of the best comb within `SPREAD` of each.

    Energy is counted from the usual one of all speeds and in units of the best. A line between tooth passing
    counts less, because a comb that holds the tooth lines at other orders is a wrong one.
    """
    signal, time = windowed(trial)
    if not signal.any():
        return None
    orders = orders_told(trial, teeth)
    stated = stated_speed(trial)
    candidates, step = candidate_speeds(stated, SLOWEST, 2.0 * SPREAD, time, orders)
    most = most_power(trial, orders * stated, alias)
    power = np.minimum(coarse_power(signal, time, orders, candidates, teeth), most)
    # by the logarithm, so that many lines in their places say more than one strong line
    # and a line between two harmonics less than these would, since all of them stand there for a wrong comb
    weights = weights_of(orders, teeth) * np.where(orders % teeth == 0, 1.0, np.minimum(teeth / orders, 1.0))
    heard = np.log1p(power / (_OVER_NOISE * np.median(power))) @ weights
    energy = np.maximum(heard - np.median(heard), 0.0)
    reach = max(int(SPREAD * stated / step), 1)
    best = maximum_filter1d(energy, 2 * reach + 1, mode="constant")
    return candidates, best / max(float(best.max()), 1e-300)
