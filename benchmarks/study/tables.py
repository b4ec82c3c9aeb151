"""Rates and figures of the study, from the rows of its log."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .strengths import LEVELS

Row = dict[str, Any]
TOLERANCE = 0.003
AT_FLOOR = 1.1
_SHARES = ("top1", "top2", "refused", "wrong")


def gathered(rows: Sequence[Row]) -> dict[str, Any]:
    """Rates of every design, effect and strength; of pairs, nothing, outside; peers; failures."""
    good = [row for row in rows if "error" not in row]
    groups: dict[tuple[str, str, str, str], list[Row]] = {}
    for row in good:
        name = "+".join(row["effects"]) or "nothing"
        groups.setdefault((row["kind"], row["design"], name, row["strength"]), []).append(row)
    return {
        "cases": len(rows),
        "failures": [{"key": row["key"], "error": row["error"]} for row in rows if "error" in row],
        "groups": [
            {"kind": kind, "design": design, "effect": name, "strength": strength, **_rates(members)}
            for (kind, design, name, strength), members in sorted(groups.items())
        ],
        "clear": _rates([row for row in good if _clear(row)]),
        "clear_and_large": _rates([row for row in good if _clear(row) and _large(row)]),
        "overall": {
            kind: _rates([r for r in good if r["kind"] == kind]) for kind in sorted({r["kind"] for r in good})
        },
        "peers": _peers(good),
    }


def _clear(row: Row) -> bool:
    """Whether the trials can show the effect and tell it from the others: the cases that must be right."""
    said = row.get("isolability")
    return (
        bool(said) and said["survival"] >= 0.3 and said["cosine"] <= 0.6 and said["standard_errors"] >= 10.0
    )


def _large(row: Row) -> bool:
    """Whether the effect is more of the force than any model's own calculation may be off."""
    return bool(row["before"] ** 2 - row["floor"] ** 2 > TOLERANCE**2)


def _rates(rows: Sequence[Row]) -> dict[str, Any]:
    if not rows:
        return {"sessions": 0}
    parameters = [p for row in rows for p in row["parameters"].values()]
    return {
        "sessions": len(rows),
        **{word: float(np.mean([row[word] for row in rows])) for word in _SHARES},
        "relative_error": _middle(p.get("relative_error") for p in parameters),
        "coverage": _mean(p.get("covered") for p in parameters),
        "before": _middle(row["before"] for row in rows),
        "after": _middle(row["after"] for row in rows),
        "floor": _middle(row["floor"] for row in rows),
        "at_floor": float(np.mean([row["after"] <= AT_FLOOR * row["floor"] for row in rows])),
        "seen_over_noise": _middle(row.get("seen_over_noise") for row in rows),
        "seconds": _middle(row.get("seconds") for row in rows),
        "named": _counted(name for row in rows for name in (row["named"] or ["-"])),
        "verdicts": _counted(row["verdict"] for row in rows),
    }


def _peers(rows: Sequence[Row]) -> list[dict[str, Any]]:
    groups: dict[tuple[str, str], list[dict[str, float]]] = {}
    for row in rows:
        if "base" in row.get("peers", {}):
            groups.setdefault((row["design"], "+".join(row["effects"]) or "nothing"), []).append(row["peers"])
    made = []
    for (design, name), scores in sorted(groups.items()):
        middles = {peer: _middle(each.get(peer) for each in scores) for peer in scores[0]}
        made.append({"design": design, "effect": name, "sessions": len(scores), **middles})
    return made


def _counted(words: Any) -> dict[str, int]:
    listed = list(words)
    return {word: listed.count(word) for word in sorted(set(listed), key=listed.count, reverse=True)}


def _values(numbers: Any) -> list[float]:
    return [float(each) for each in numbers if each is not None and np.isfinite(each)]


def _middle(numbers: Any) -> float | None:
    kept = _values(numbers)
    return float(np.median(kept)) if kept else None


def _mean(numbers: Any) -> float | None:
    kept = _values(numbers)
    return float(np.mean(kept)) if kept else None


def printed(found: dict[str, Any]) -> str:
    """The tables as text."""
    numbers = {"relative_error": 3, "coverage": 2, "before": 4, "after": 4, "floor": 4}
    numbers |= {"seen_over_noise": 1, "seconds": 0}
    short = {"relative_error": "error", "seen_over_noise": "snr", "coverage": "covered"}
    heads = [*_SHARES, *(short.get(word, word) for word in numbers)]
    lines = [
        f"{'design':8s} {'hidden':34s} {'strength':8s}   n " + " ".join(f"{h:>8s}" for h in heads) + "  named"
    ]
    for each in found["groups"]:
        named = ", ".join(f"{name} {count}" for name, count in list(each["named"].items())[:4])
        cells = [_share(each[word]) for word in _SHARES]
        cells += [_number(each[word], 8, digits) for word, digits in numbers.items()]
        head = f"{each['design']:8s} {each['effect']:34s} {each['strength']:8s} {each['sessions']:3d} "
        lines.append(head + " ".join(cells) + "  " + named)
    clear = {"single, isolable": found["clear"], "of these above .3 % of the force": found["clear_and_large"]}
    for kind, rates in {**clear, **found["overall"]}.items():
        if not rates["sessions"]:
            continue
        shares = " ".join(f"{word} {_share(rates[word])}" for word in (*_SHARES, "at_floor"))
        lines.append(f"all {kind}: {rates['sessions']} sessions, {shares}")
    if found["peers"]:
        peers = [name for name in found["peers"][0] if name not in ("design", "effect", "sessions")]
        lines.append("error at new speeds and feeds: " + " ".join(f"{name:>8s}" for name in peers))
        for each in found["peers"]:
            scores = " ".join(_number(each.get(name), 8, 4) for name in peers)
            lines.append(f"{each['design']:8s} {each['effect']:34s} {each['sessions']:3d} {scores}")
    lines += [f"failed: {each['key']}: {each['error'][:150]}" for each in found["failures"]]
    return "\n".join(lines)


def _share(value: float) -> str:
    return f"{100.0 * value:7.0f}%"


def _number(value: float | None, width: int, digits: int) -> str:
    return f"{'-':>{width}s}" if value is None else f"{value:{width}.{digits}f}"


def draw(found: dict[str, Any], path: Path) -> None:
    """Heat maps by design: share of sessions whose first name is right, effect by strength."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    singles = [each for each in found["groups"] if each["kind"] == "single"]
    designs = sorted({each["design"] for each in singles})
    if not designs:
        raise ValueError(f"{path}: got no single effect in the log, expected one at least; run some first.")
    rows = {d: sorted({each["effect"] for each in singles if each["design"] == d}) for d in designs}
    tall = max(map(len, rows.values()))
    figure, axes = plt.subplots(
        1, len(designs), figsize=(3.6 * len(designs), 1.4 + 0.26 * tall), squeeze=False
    )
    pick: Callable[[str, str], dict[tuple[str, str], float]] = lambda design, word: {  # noqa: E731
        (each["effect"], each["strength"]): each[word] for each in singles if each["design"] == design
    }
    for axis, design in zip(axes[0], designs, strict=True):
        values, wrong = pick(design, "top1"), pick(design, "wrong")
        grid = np.array([[values.get((name, level), np.nan) for level in LEVELS] for name in rows[design]])
        axis.imshow(grid, vmin=0.0, vmax=1.0, cmap="viridis", aspect="auto")
        axis.set_title(design)
        axis.set_xticks(range(len(LEVELS)), list(LEVELS))
        axis.set_yticks(
            range(len(rows[design])), [name.replace("_", " ") for name in rows[design]], fontsize=7
        )
        for row, name in enumerate(rows[design]):
            for column, level in enumerate(LEVELS):
                if (name, level) in values:
                    bad = wrong[name, level]
                    text = f"{100 * values[name, level]:.0f}" + (f" ({100 * bad:.0f})" if bad else "")
                    colour = "black" if values[name, level] > 0.6 else "white"
                    axis.text(column, row, text, ha="center", va="center", fontsize=6, color=colour)
    figure.suptitle("first name right, % of sessions\n(in brackets: a wrong name)", fontsize=9)
    figure.tight_layout()
    figure.savefig(path, dpi=150)
    plt.close(figure)
