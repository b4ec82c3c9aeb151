"""What the paper measured on its robot, judged on the virtual cell: orderings by sheet, not values.

The cell is the target that no training has seen, as the robot was; where it was not evaluated, the surrogate
with the disturbance in dynamics and reward stands in. An ordering that the paper prints for every sheet is
reproduced where the means of ours have it on every sheet; `ours` counts the sheets that have it. Tests of
significance go over all cuts, since ours are few on a sheet.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

from experiments.judging import MOVING, NOT_COMPARABLE, Headline, Judged, Results, rule
from experiments.published import MEASURES, TABLE

DOMAIN = "cell"


def target(results: Results) -> Mapping[str, Any]:
    """The summary of the target domain."""
    return results[DOMAIN if DOMAIN in results else MOVING]


def _rows(results: Results, strategy: str) -> dict[str, Mapping[str, float]]:
    rows = target(results)["strategies"][strategy]["by_material"]
    rows = {sheet: row for sheet, row in rows.items() if sheet != "all"}
    if not rows:
        raise KeyError("sheet")
    return rows


def _all(results: Results, strategy: str, measure: str) -> float:
    return float(target(results)["strategies"][strategy]["by_material"]["all"][measure])


def _sheets(results: Results, strategy: str, other: str, holds: Callable[[Any, Any], bool]) -> list[bool]:
    """Whether a relation of two strategies holds, sheet by sheet."""
    rows, others = _rows(results, strategy), _rows(results, other)
    return [bool(holds(rows[sheet], others[sheet])) for sheet in rows]


def _less_load(results: Results) -> Judged:
    ours = {"sheets": float(len(_rows(results, "expert")))}
    for strategy in ("bc", "dagger"):
        for name in ("load_n", "path_deviation_mm"):
            less = _sheets(results, strategy, "expert", lambda a, b, name=name: a[name] < b[name])
            ours[f"{strategy}_less_{name}"] = float(sum(less))
    fine = all(count == ours["sheets"] for count in ours.values())
    for strategy in ("expert", "bc", "dagger"):
        for name in ("load_n", "path_deviation_mm", "mrv_mm3", "load_per_mrv_n_mm3"):
            ours[f"{strategy}_{name}"] = _all(results, strategy, name)
    return rule(fine), ours


def _fine_tuned(results: Results) -> Judged:
    ours = {"sheets": float(len(_rows(results, "expert")))}
    ours["less_deviation"] = sum(
        _sheets(results, "fine_tune", "expert", lambda a, b: a["path_deviation_mm"] < b["path_deviation_mm"])
    )
    for name in ("mrv_mm3", "load_n"):
        ours[f"more_{name}"] = sum(
            _sheets(results, "fine_tune", "expert", lambda a, b, name=name: a[name] > b[name])
        )
    return rule(all(count == ours["sheets"] for count in ours.values())), ours


def _fine_tuned_reward(results: Results) -> Judged:
    better = {
        sheet: row["reward"] - _rows(results, "expert")[sheet]["reward"]
        for sheet, row in _rows(results, "fine_tune").items()
    }
    ours = {f"{sheet}_gain": float(gain) for sheet, gain in better.items()}
    return rule(all(gain > 0 for sheet, gain in better.items() if sheet != "foam")), ours


def _imitation_and_fine_tuning(results: Results) -> Judged:
    tests = target(results)["welch_reward"]
    ours = {}
    for strategy in ("bc", "dagger"):
        pair = {frozenset(name.split(" - ")): test for name, test in tests.items()}
        ours[f"{strategy}_p_value"] = float(pair[frozenset((strategy, "fine_tune"))]["p_value"])
    return rule(all(p >= 0.05 for p in ours.values())), ours


def _re_trained_slow(results: Results) -> Judged:
    ours = {s: _all(results, s, "time_s") for s in ("expert", "re_train")}
    return rule(ours["re_train"] > 2 * ours["expert"]), ours


def _re_trained(results: Results) -> Judged:
    more = _sheets(results, "re_train", "expert", lambda a, b: a["mrv_mm3"] > b["mrv_mm3"])
    nearer = _sheets(
        results, "re_train", "expert", lambda a, b: a["path_deviation_mm"] < b["path_deviation_mm"]
    )
    ours = {"sheets": float(len(more)), "more_mrv": float(sum(more)), "less_deviation": float(sum(nearer))}
    return rule(all(more) and all(nearer)), ours


def _re_trained_load(results: Results) -> Judged:
    rows, base = _rows(results, "re_train"), _rows(results, "baseline")
    ours = {sheet: float(row["load_n"] - base[sheet]["load_n"]) for sheet, row in rows.items()}
    return rule(all((more > 0) == (sheet != "aluminium") for sheet, more in ours.items())), ours


def _re_trained_worst(results: Results) -> Judged:
    rows = _rows(results, "re_train")
    others = [_rows(results, s) for s in ("baseline", "expert", "fine_tune", "bc", "dagger")]
    ours = {
        sheet: float(row["reward"] - min(other[sheet]["reward"] for other in others))
        for sheet, row in rows.items()
    }
    return rule(all(lead < 0 for lead in ours.values())), ours


def _dagger_slower(results: Results) -> Judged:
    rows, expert = _rows(results, "dagger"), _rows(results, "expert")
    ours = {s: float(rows[s]["time_s"] - expert[s]["time_s"]) for s in ("plastic", "cardboard")}
    return rule(all(later > 0 for later in ours.values())), ours


def _expert_and_baseline(results: Results) -> Judged:
    faster = _sheets(results, "expert", "baseline", lambda a, b: a["time_s"] < 0.75 * b["time_s"])
    further = _sheets(
        results, "expert", "baseline", lambda a, b: a["path_deviation_mm"] > b["path_deviation_mm"]
    )
    less = _sheets(results, "expert", "baseline", lambda a, b: a["mrv_mm3"] < b["mrv_mm3"])
    ours = {
        "sheets": float(len(faster)),
        "faster": float(sum(faster)),
        "more_deviation": float(sum(further)),
        "less_mrv": float(sum(less)),
    }
    return rule(all([*faster, *further, *less])), ours


def _approach(results: Results) -> Judged:
    ours = {
        s: float(target(results)["strategies"][s]["set_points"]["approach_feed_adjustment"])
        for s in ("expert", "bc", "dagger", "fine_tune", "re_train")
    }
    return rule(all(feed > 0.5 for feed in ours.values())), ours


def _growth(results: Results) -> Judged:
    return NOT_COMPARABLE, {}


def _table(results: Results) -> Judged:
    ours = {f"baseline_{name}": _all(results, "baseline", name) for name in MEASURES}
    paper = {
        f"paper_{name}": sum(row[name] for row in TABLE["baseline"].values()) / len(TABLE["baseline"])
        for name in MEASURES
    }
    return NOT_COMPARABLE, {**ours, **paper}


_HEADLINES = (
    Headline("less_load", "BC and DAgger: less load and deviation than the expert, all sheets", _less_load),
    Headline(
        "fine_tuned_grips", "fine-tuned: less deviation, more MRV, more load than the expert, all sheets",
        _fine_tuned,
    ),
    Headline(
        "fine_tuned_beats_expert", "fine-tuned: more reward than the expert except on foam (p < .05)",
        _fine_tuned_reward,
    ),
    Headline(
        "imitation_equals_fine_tuning",
        "BC and DAgger against fine-tuned: no significant difference of the reward but on foam",
        _imitation_and_fine_tuning,
    ),
    Headline("re_trained_is_slow", "the re-trained policy is four times slower", _re_trained_slow),
    Headline(
        "re_trained_against_expert", "re-trained: removes more and deviates less than the expert", _re_trained
    ),
    Headline(
        "re_trained_load", "re-trained: more load than the baseline except on aluminium", _re_trained_load
    ),
    Headline("re_trained_is_worst", "re-trained: the least reward on every sheet", _re_trained_worst),
    Headline("dagger_is_slower", "DAgger is slower than the expert on plastic and cardboard", _dagger_slower),
    Headline(
        "expert_against_baseline",
        "the expert takes half the baseline's time, deviates more and removes less, all sheets",
        _expert_and_baseline,
    ),
    Headline("approach_at_full_feed", "the feed of the approach is near its maximum for all", _approach),
    Headline(
        "growth_along_the_cut",
        "on foam error, depth and force grow along the cut; on mica the feed force rises at 7-9 s: "
        "properties of the sheets that were cut",
        _growth,
    ),
    Headline("robot_table", "baseline 19.9 s, 2.8 mm, 10.9 N, 128 mm^3, mean of five sheets", _table),
)  # fmt: skip
HEADLINES = tuple(dataclasses.replace(headline, measured="robot") for headline in _HEADLINES)
