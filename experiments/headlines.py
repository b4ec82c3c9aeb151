"""The paper's headline results, each judged against ours: reproduced, not reproduced, or not comparable.

Here those that the paper has from its simulation, over 50 rollouts; `headlines_robot` has those of its robot.
Reference: Hathaway, Stolkin, Rastegarpanah, IROS 2024.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy import signal

from experiments import headlines_robot, judging
from experiments.judging import MOVING, NOT_COMPARABLE, Headline, Judged, Results, rule

ADAPTED = ("bc", "dagger", "fine_tune")
DIP_STEPS = 12_000_000
"""Policy steps after which the paper's re-training has dipped and gained again."""


def judged(results: Results, curves: Mapping[str, Any] | None = None) -> dict[str, dict[str, Any]]:
    """Return, for every headline, its judgement, the paper's result and our figures.

    Arguments:
        results: summaries by domain (`evaluation.evaluate.summarise`).
        curves: training -> (policy steps [T], episode reward [T, seeds]), NaN where no episode ended.
    """
    return judging.judged(HEADLINES, {**results, "curves": dict(curves or {})})


def _reward(results: Results, domain: str, strategy: str) -> float:
    return float(results[domain]["strategies"][strategy]["by_material"]["all"]["reward"])


def _sensitivity(results: Results, strategy: str, name: str) -> float:
    return float(results["surrogate"]["strategies"][strategy]["sensitivity"][name])


def _final_rewards(results: Results) -> Judged:
    ours = {
        "expert_source": _reward(results, "source", "expert"),
        "re_trained_surrogate": _reward(results, MOVING, "re_train"),
    }
    # The values depend on unpublished weights; their order does not.
    return rule(ours["re_trained_surrogate"] < ours["expert_source"]), ours


def _dip(results: Results) -> Judged:
    steps, rewards = results["curves"]["re_train"]
    with np.errstate(invalid="ignore"):
        mean = np.asarray(
            [np.mean(row[np.isfinite(row)]) if np.isfinite(row).any() else np.nan for row in rewards]
        )
    mean = mean[np.isfinite(mean)]
    if len(mean) < 2 or np.ptp(mean) == 0.0:  # no two iterations in which episodes ended
        return NOT_COMPARABLE, {"steps": float(steps[-1])}
    width = max(1, len(mean) // 30)
    smooth = np.convolve(mean, np.ones(width) / width, "valid")
    span = float(np.ptp(smooth))
    fallen = np.maximum.accumulate(smooth) - smooth
    dip = int(np.argmax(fallen))
    ours = {
        "steps": float(steps[-1]),
        "dip": float(fallen[dip] / span),
        "gain_after": float((smooth[dip:].max() - smooth[dip]) / span),
    }
    if steps[-1] < DIP_STEPS:
        return NOT_COMPARABLE, ours
    return rule(ours["dip"] > 0.1 and ours["gain_after"] > 0.1), ours


def _erratic(results: Results) -> Judged:
    ours = {
        "expert_jitter": _sensitivity(results, "expert", "jitter"),
        "clean_jitter": _sensitivity(results, "expert", "expert_jitter"),
        "dagger_jitter": _sensitivity(results, "dagger", "jitter"),
    }
    return rule(
        ours["expert_jitter"] > 1.5 * ours["clean_jitter"] and ours["dagger_jitter"] < ours["expert_jitter"]
    ), ours


def _tracking(results: Results) -> Judged:
    ours = {s: _sensitivity(results, s, "distance") for s in ("expert", *ADAPTED)}
    return rule(ours["dagger"] < ours["bc"] < ours["expert"]), ours


def _fine_tuned_sensitive(results: Results) -> Judged:
    ours = {s: _sensitivity(results, s, "jitter") for s in ADAPTED}
    return rule(ours["fine_tune"] > max(ours["bc"], ours["dagger"])), ours


def _fine_tuned_lag(results: Results) -> Judged:
    ours = {s: _sensitivity(results, s, "lag_s") for s in ("expert", *ADAPTED)}
    return rule(0.02 <= ours["fine_tune"] <= 0.3), ours


def _little_difference(results: Results) -> Judged:
    ours = {s: _reward(results, "surrogate", s) for s in ("expert", *ADAPTED)}
    spread = float(results["surrogate"]["strategies"]["expert"]["reward_std"])
    little = all(abs(ours[s] - ours["expert"]) < spread for s in ADAPTED)
    return rule(little), {**ours, "expert_std": spread}


def _minima(results: Results) -> Judged:
    strategies = ("expert", *ADAPTED)
    ours = {s: float(results["surrogate"]["strategies"][s]["reward_min"]) for s in strategies}
    return rule(all(ours[s] > ours["expert"] for s in ADAPTED)), ours


def _dagger_deviates(results: Results) -> Judged:
    expert = _reward(results, "surrogate", "expert")
    ours = {s: abs(_reward(results, "surrogate", s) - expert) for s in ADAPTED}
    return rule(ours["dagger"] == max(ours.values())), ours


def _expert_set_points(results: Results) -> dict[str, float]:
    return dict(results["source"]["strategies"]["expert"]["set_points"])


def _approach(results: Results) -> Judged:
    ours = _expert_set_points(results)
    stiff = ours["approach_stiffness_normal_s2"] > ours["cutting_stiffness_normal_s2"]
    return rule(stiff and abs(ours["approach_feed_adjustment"]) <= 0.25), ours


def _impact(results: Results) -> Judged:
    ours = _expert_set_points(results)
    fast = ours["cutting_feed_adjustment"] > max(0.25, ours["approach_feed_adjustment"])
    soft = ours["cutting_stiffness_normal_s2"] < 0.5 * ours["approach_stiffness_normal_s2"]
    return rule(fast and soft), ours


def _depth(results: Results) -> Judged:
    ours = {"depth_spread_mm": _expert_set_points(results)["depth_spread_mm"]}
    return rule(ours["depth_spread_mm"] < 0.1), ours  # a twentieth of its range


def _low_pass(results: Results) -> Judged:
    sections = signal.butter(10, 5.0, fs=50.0, output="sos")
    _, delay = signal.group_delay(signal.sos2tf(sections), w=np.linspace(0.01, 0.9 * np.pi * 0.2, 400))
    ours = {
        "filter_peak_delay_s": float(delay.max() / 50.0),
        "low_pass_lag_s": _sensitivity(results, "low_pass", "lag_s"),
        "low_pass_distance": _sensitivity(results, "low_pass", "distance"),
        "dagger_distance": _sensitivity(results, "dagger", "distance"),
    }
    return rule(
        ours["filter_peak_delay_s"] > 0.3 and ours["low_pass_distance"] > ours["dagger_distance"]
    ), ours


HEADLINES = (
    Headline(
        "final_rewards", "expert -0.766 on its source, re-trained -2.24 on the surrogate", _final_rewards
    ),
    Headline("re_training_dips", "re-training dips, then gains from 5.5 M to 12 M steps", _dip),
    Headline(
        "expert_is_erratic", "the expert acts erratically on the surrogate; adapted policies do not", _erratic
    ),
    Headline(
        "imitation_tracks", "BC and DAgger track the clean expert's actions, DAgger closer than BC", _tracking
    ),
    Headline("fine_tuned_is_sensitive", "the fine-tuned policy stays sensitive", _fine_tuned_sensitive),
    Headline("fine_tuned_lags", "the fine-tuned policy lags by about 0.1 s", _fine_tuned_lag),
    Headline("rewards_differ_little", "reward distributions differ little", _little_difference),
    Headline("higher_minima", "adapted policies have higher minima of the reward than the expert", _minima),
    Headline("dagger_deviates_most", "DAgger's reward deviates most from the expert's", _dagger_deviates),
    Headline("approach", "approach: high gain, about nominal feed", _approach),
    Headline("after_impact", "after impact: high feed, low normal gain", _impact),
    Headline("depth_is_constant", "the depth is constant", _depth),
    Headline("low_pass_is_no_cure", "a 10th-order 5 Hz Butterworth delays by about 0.5 s", _low_pass),
    *headlines_robot.HEADLINES,
)
