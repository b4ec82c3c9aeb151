"""The paper's measures of an episode, tables by material, and how a policy answers to the disturbance.

* time: length of the episode, s.
* path deviation: mean distance from the path while in contact, mm.
* load: mean magnitude of the force on the tool while in contact, N.
* MRV: volume removed, mm^3. A low load may only mean that less was cut, so load per MRV is always beside it.
* reward, its terms, and whether the path was completed: an episode that stops early collects fewer costs.

Sensitivity is measured on the states that the policy itself visits: its action on what it saw, against the
expert's on the clean observation of the same instant.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import jax
import numpy as np

from mjx_cutting.evaluation.rollouts import Rollouts
from mjx_cutting.learning.policy import Policy, PolicyDescription

TERMS = ("reward_mrv", "reward_time", "reward_path", "reward_force", "reward_failure")


def episodes(rollouts: Rollouts) -> dict[str, np.ndarray]:
    """Return each measure as an array [rollout].

    Keys: reward, time_s, path_deviation_mm, load_n, mrv_mm3, load_per_mrv_n_mm3, completed, failed,
    contact_s, material (index), and the terms of the reward. Means over contact are NaN where there was none.
    """
    contact = rollouts.total("contact_s")
    with np.errstate(divide="ignore", invalid="ignore"):
        load = np.where(contact > 0, rollouts.total("contact_load_n_s") / contact, np.nan)
        deviation = np.where(contact > 0, rollouts.total("contact_error_mm_s") / contact, np.nan)
        volume = rollouts.total("mrv_mm3")
        per_volume = np.where(volume > 0, load / volume, np.nan)
    return {
        "reward": rollouts.total("reward"),
        "time_s": rollouts.time_s,
        "path_deviation_mm": deviation,
        "load_n": load,
        "mrv_mm3": volume,
        "load_per_mrv_n_mm3": per_volume,
        "completed": rollouts.total("completed"),
        "failed": rollouts.total("failed"),
        "contact_s": contact,
        "material": rollouts.material,
        **{name: rollouts.total(name) for name in TERMS if name in rollouts.metrics},
    }


def by_material(measures: Mapping[str, np.ndarray], materials: Sequence[str]) -> dict[str, dict[str, float]]:
    """Return the mean of each measure by name of the sheet, and under "all"; `episodes` counts them.

    Sheets that no rollout had are left out. NaN (no contact) does not count.
    """
    table = {}
    groups = {"all": np.ones(len(measures["material"]), bool)}
    groups |= {name: measures["material"] == i for i, name in enumerate(materials)}
    for name, rows in groups.items():
        if rows.any():
            table[name] = {
                "episodes": int(rows.sum()),
                **{k: _mean(v[rows]) for k, v in measures.items() if k != "material"},
            }
    return table


def sensitivity(rollouts: Rollouts, expert: Policy, window_s: float = 1.0) -> dict[str, float]:
    """Return how a policy's actions answer to what it saw, as means over episodes.

    Arguments:
        rollouts: of the policy, in any domain.
        expert: the reference, applied to the clean observations of these rollouts.
        window_s: length of the moving mean that jitter is measured against, s.

    Keys: jitter (standard deviation of the action about its moving mean, mean over the action's entries), and
    where the clean observation is known: distance (RMS difference of the action from the expert's on the
    clean observation), expert_jitter (jitter of the expert's clean actions), lag_s (shift that maximises the
    cross-correlation of the two; positive: the policy comes later).
    """
    width = max(round(window_s / rollouts.period_s), 1)
    episodes = range(rollouts.active.shape[1])
    acted = [rollouts.action[rollouts.active[:, i], i].astype(float) for i in episodes]
    swings = [a - _moving_mean(a, width) for a in acted]
    found = {"jitter": float(np.mean([swing.std(axis=0).mean() for swing in swings]))}
    if rollouts.clean is None:
        return found
    reference = np.asarray(jax.jit(lambda p, o: p.apply(o))(expert, rollouts.clean))
    wished = [reference[rollouts.active[:, i], i].astype(float) for i in episodes]
    pairs = list(zip(acted, wished, strict=True))
    ideal = [r - _moving_mean(r, width) for r in wished]
    lags = [lag(r, a) * rollouts.period_s for r, a in zip(ideal, swings, strict=True)]
    return {
        "distance": float(np.mean([np.sqrt(np.mean(np.sum((a - r) ** 2, axis=-1))) for a, r in pairs])),
        **found,
        "expert_jitter": float(np.mean([r.std(axis=0).mean() for r in ideal])),
        "lag_s": float(np.mean(lags)),
    }


def set_points(rollouts: Rollouts, description: PolicyDescription) -> dict[str, float]:
    """Return what a policy asks for before and after it meets the sheet, means over time and episodes.

    Keys: {approach, cutting}_{feed_adjustment, depth_mm, stiffness_feed_s2, stiffness_normal_s2} (geometric
    means of the stiffnesses), and depth_spread_mm, the standard deviation of the depth within a cut. Empty
    where the policy does not observe its set-points; without the approach where the path has none.
    """
    names = {
        "feed_adjustment": ("feed_adjustment", 1.0),
        "depth_mm": ("depth", 1e3),
        "stiffness_feed_s2": ("log_stiffness_y", 1.0),
        "stiffness_normal_s2": ("log_stiffness_z", 1.0),
    }
    if not {name for name, _ in names.values()} <= set(description.observation_names):
        return {}
    touched = np.maximum.accumulate(rollouts.metrics["contact_s"] > 0, axis=0)
    found = {}
    for phase, during in (("approach", ~touched & rollouts.active), ("cutting", touched & rollouts.active)):
        for key, (name, factor) in names.items():
            i = description.observation_names.index(name)
            values = rollouts.observation[..., i] * (factor * description.observation_scales[i])
            if during.any():
                mean = float(np.mean(values[during]))
                found[f"{phase}_{key}"] = float(np.exp(mean)) if name.startswith("log_") else mean
            if phase == "cutting" and name == "depth":
                spreads = [v[on].std() for v, on in zip(values.T, during.T, strict=True) if on.any()]
                found["depth_spread_mm"] = float(np.mean(spreads)) if spreads else float("nan")
    return found


def lag(reference: np.ndarray, signal: np.ndarray, most: int = 50) -> int:
    """Return by how many steps a signal [time, entries] comes after a reference of the same shape.

    It is the shift, at most `most` either way, at which the product summed over entries and time is largest.
    """
    n = len(reference)
    most = min(most, n - 1)
    best = {
        k: float(np.sum(reference[max(0, -k) : n - max(0, k)] * signal[max(0, k) : n - max(0, -k)]))
        for k in range(-most, most + 1)
    }
    return max(best, key=lambda k: (best[k], -abs(k)))


def _moving_mean(x: np.ndarray, width: int) -> np.ndarray:
    """Centred mean over `width` steps along axis 0, narrower at the ends."""
    total = np.concatenate([np.zeros((1, x.shape[1])), np.cumsum(x, axis=0)])
    low = np.maximum(np.arange(len(x)) - width // 2, 0)
    high = np.minimum(np.arange(len(x)) + (width + 1) // 2, len(x))
    return (total[high] - total[low]) / (high - low)[:, None]


def _mean(values: np.ndarray) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else float("nan")
