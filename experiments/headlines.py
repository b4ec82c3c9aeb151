"""The paper's headline results, each judged against ours: reproduced, not reproduced, or not comparable.

A judgement is a rule written down before the results are looked at; it uses the summaries of
`evaluation.evaluate` and nothing else. "Not comparable" is for figures that depend on what the paper does not
publish (its reward's weights, its disturbance) or that were measured on the real robot.

Reference: Hathaway, Stolkin, Rastegarpanah, IROS 2024.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

REPRODUCED, NOT, NOT_COMPARABLE = "reproduced", "not reproduced", "not comparable"
MOVING = "surrogate_dynamics"
Results = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True)
class Headline:
    """One result of the paper.

    Arguments:
        name: key in the results file.
        paper: what the paper reports.
        judge: results by domain -> (judgement, our figures).
    """

    name: str
    paper: str
    judge: Callable[[Results], tuple[str, dict[str, float]]]


def judged(results: Results) -> dict[str, dict[str, Any]]:
    """Return, for every headline, its judgement, the paper's result and our figures."""
    told = {}
    for headline in HEADLINES:
        judgement, ours = headline.judge(results)
        told[headline.name] = {"judgement": judgement, "paper": headline.paper, "ours": ours}
    return told


def _reward(results: Results, domain: str, strategy: str) -> float:
    return float(results[domain]["strategies"][strategy]["by_material"]["all"]["reward"])


def _sensitivity(results: Results, strategy: str, name: str) -> float:
    return float(results["surrogate"]["strategies"][strategy]["sensitivity"][name])


def _mean(results: Results, domain: str, strategy: str, name: str) -> float:
    return float(results[domain]["strategies"][strategy]["by_material"]["all"][name])


def _rule(fine: bool) -> str:
    return REPRODUCED if fine else NOT


def _final_rewards(results: Results) -> tuple[str, dict[str, float]]:
    ours = {
        "expert_source": _reward(results, "source", "expert"),
        "re_trained_surrogate": _reward(results, MOVING, "re_train"),
    }
    # The values depend on unpublished weights; their order does not.
    return _rule(ours["re_trained_surrogate"] < ours["expert_source"]), ours


def _tracking(results: Results) -> tuple[str, dict[str, float]]:
    ours = {s: _sensitivity(results, s, "distance") for s in ("expert", "bc", "dagger", "fine_tune")}
    return _rule(ours["dagger"] < ours["bc"] < ours["expert"]), ours


def _erratic(results: Results) -> tuple[str, dict[str, float]]:
    ours = {
        "expert_jitter": _sensitivity(results, "expert", "jitter"),
        "clean_jitter": _sensitivity(results, "expert", "expert_jitter"),
        "dagger_jitter": _sensitivity(results, "dagger", "jitter"),
    }
    return _rule(
        ours["expert_jitter"] > 1.5 * ours["clean_jitter"] and ours["dagger_jitter"] < ours["expert_jitter"]
    ), ours


def _fine_tuned_lag(results: Results) -> tuple[str, dict[str, float]]:
    ours = {s: _sensitivity(results, s, "lag_s") for s in ("expert", "bc", "dagger", "fine_tune")}
    return _rule(0.02 <= ours["fine_tune"] <= 0.3), ours


def _minima(results: Results) -> tuple[str, dict[str, float]]:
    strategies = ("expert", "bc", "dagger", "fine_tune")
    ours = {s: float(results["surrogate"]["strategies"][s]["reward_min"]) for s in strategies}
    return _rule(all(ours[s] > ours["expert"] for s in strategies[1:])), ours


def _low_pass(results: Results) -> tuple[str, dict[str, float]]:
    ours = {
        "low_pass_lag_s": _sensitivity(results, "low_pass", "lag_s"),
        "low_pass_distance": _sensitivity(results, "low_pass", "distance"),
        "dagger_distance": _sensitivity(results, "dagger", "distance"),
    }
    return _rule(ours["low_pass_distance"] > ours["dagger_distance"]), ours


def _less_load(results: Results) -> tuple[str, dict[str, float]]:
    names = ("load_n", "path_deviation_mm", "mrv_mm3", "load_per_mrv_n_mm3")
    ours = {
        f"{s}_{name}": _mean(results, "surrogate", s, name)
        for s in ("expert", "bc", "dagger")
        for name in names
    }
    less = all(
        ours[f"{s}_{name}"] < ours[f"expert_{name}"]
        for s in ("bc", "dagger")
        for name in ("load_n", "path_deviation_mm")
    )
    return _rule(less), ours


def _re_trained_slow(results: Results) -> tuple[str, dict[str, float]]:
    ours = {s: _mean(results, MOVING, s, "time_s") for s in ("expert", "re_train")}
    return _rule(ours["re_train"] > 2 * ours["expert"]), ours


def _real_robot(results: Results) -> tuple[str, dict[str, float]]:
    names = ("time_s", "path_deviation_mm", "load_n", "mrv_mm3")
    return NOT_COMPARABLE, {f"baseline_{n}": _mean(results, "source", "baseline", n) for n in names}


HEADLINES = (
    Headline(
        "final_rewards", "expert -0.766 on its source, re-trained -2.24 on the surrogate", _final_rewards
    ),
    Headline(
        "expert_is_erratic", "the expert acts erratically on the surrogate; adapted policies do not", _erratic
    ),
    Headline(
        "imitation_tracks", "BC and DAgger track the clean expert's actions, DAgger closer than BC", _tracking
    ),
    Headline("fine_tuned_lags", "the fine-tuned policy lags by about 0.1 s", _fine_tuned_lag),
    Headline("higher_minima", "adapted policies have higher minima of the reward than the expert", _minima),
    Headline("low_pass_is_no_cure", "a 10th-order 5 Hz Butterworth delays by about 0.5 s", _low_pass),
    Headline("less_load", "BC and DAgger: less load and deviation than the expert (real robot)", _less_load),
    Headline(
        "re_trained_is_slow", "the re-trained policy is four times slower (real robot)", _re_trained_slow
    ),
    Headline(
        "robot_table",
        "baseline 19.9 s, 2.8 mm, 10.9 N, 128 mm^3 (real robot, mean of five sheets)",
        _real_robot,
    ),
)
