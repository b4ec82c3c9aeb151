"""The finding in two sentences, and effects and covariates in words a machinist uses.

What an effect is in plain words is the first sentence of its module's docstring ("Radial runout: the axis of
the teeth is not ..."), so an effect of the user's own is described by its author.
"""

from __future__ import annotations

import inspect
from typing import Any

from mjx_cutting._report.quantities import interval, joined, percent
from mjx_cutting.cutting import AbstractEffect, effect_class
from mjx_cutting.tracing.told import Tracing

TONES = {
    "explained": "good",
    "nothing missing": "good",
    "partly explained": "part",
    "ambiguous": "open",
    "unexplained": "open",
}
_SPELT_OUT = {"trial": "which trial it is", "another axis": "the force on another axis"}


def spoken(name: str) -> str:
    """Returns the name of an effect in words."""
    return name.replace("_", " ")


def gloss(name: str) -> str:
    """Returns what an effect is, in plain words, without a full stop; "" where its author does not say."""
    try:
        kind = effect_class(name)
    except ValueError:
        return ""
    module = inspect.getmodule(kind)
    said = (module.__doc__ or "") if module is not None else ""
    first = " ".join(said.split("\n\n")[0].split())
    head, colon, rest = first.partition(": ")
    if colon and len(head) < 60:
        return rest.split(". ")[0].rstrip(".")
    return kind.signature


def strength(entry: dict[str, Any]) -> str:
    """Returns the size of an effect of the verdict with its 95 % interval; "" where it has none."""
    kind = _kind(entry["name"])
    name = kind.strength if kind is not None and kind.strength in entry["parameters"] else None
    name = name or next(iter(entry["parameters"]), None)
    if name is None:
        return ""
    one = entry["parameters"][name]
    value, ends, unit = interval(one["value"], one["low"], one["high"], one["unit"])
    return f"{bare(name)} {joined(value, unit)}, 95 % interval {joined(ends, unit)}"


def bare(parameter: str) -> str:
    """Returns the name of a parameter without its unit suffix."""
    for suffix in ("_n_m2", "_n_m", "_rad", "_hz", "_kg_m", "_kg", "_pa", "_m_s", "_m", "_s", "_n"):
        if parameter.endswith(suffix):
            return parameter[: -len(suffix)].replace("_", " ")
    return parameter.replace("_", " ")


def finding(tracing: Tracing) -> tuple[str, str]:
    """Returns the finding: one sentence on what is missing, one on how well that explains the trials."""
    verdict = tracing.verdict
    said = {
        "explained": _explained,
        "partly explained": _partly,
        "ambiguous": _ambiguous,
        "unexplained": _unexplained,
        "nothing missing": _nothing,
    }
    return said[verdict["verdict"]](tracing, verdict)


def _explained(tracing: Tracing, verdict: dict[str, Any]) -> tuple[str, str]:
    return (
        f"{_lacks(verdict)}.",
        f"{_errors(verdict)}, which is what sensor noise alone leaves ({_floor(verdict)}), and what "
        "remains depends on nothing that was measured.",
    )


def _partly(tracing: Tracing, verdict: dict[str, Any]) -> tuple[str, str]:
    left = _depends_on(verdict)
    more = f"and what remains still depends on {left}" if left else "so something more is missing"
    return (
        f"{_lacks(verdict)}.",
        f"{_errors(verdict)}; sensor noise alone would leave {_floor(verdict)}, {more}.",
    )


def _ambiguous(tracing: Tracing, verdict: dict[str, Any]) -> tuple[str, str]:
    first = verdict["ambiguous"][0]
    names = " or ".join(spoken(name) for name in first["names"])
    before, after = (percent(verdict[key]["heldout_nrmse"]) for key in ("before", "after"))
    better = spoken(verdict["effects"][0]["name"]) if verdict["effects"] else spoken(first["names"][0])
    return (
        f"The force model lacks something, and these trials cannot tell whether it is {names}: both fit.",
        f"With {better} the error on trials the model has not seen falls from "
        f"{before} to {after} of the force; what would tell them apart: "
        f"{first['separating_trial'].rstrip('.')}.",
    )


def _unexplained(tracing: Tracing, verdict: dict[str, Any]) -> tuple[str, str]:
    left = _depends_on(verdict)
    depends = f", and what it misses depends on {left}" if left else ""
    error = percent(verdict["before"]["heldout_nrmse"])
    return (
        f"The force model lacks something, and {_tried(tracing, 'explains it', 'explain it')}.",
        f"It misses trials it has not seen by {error} of the force where sensor noise alone would leave "
        f"{_floor(verdict)}{depends}.",
    )


def _nothing(tracing: Tracing, verdict: dict[str, Any]) -> tuple[str, str]:
    error = percent(verdict["before"]["heldout_nrmse"])
    return (
        f"Nothing is missing from the force model as far as these {len(tracing.before)} trials can show.",
        f"Without any further effect it predicts trials it has not seen to {error} of the force, where "
        f"sensor noise alone would leave {_floor(verdict)}; "
        f"{_tried(tracing, 'passes every test', 'pass every test')}.",
    )


def _lacks(verdict: dict[str, Any]) -> str:
    parts = []
    for entry in verdict["effects"]:
        told = gloss(entry["name"])
        part = spoken(entry["name"]) + (f", that is, {told}" if told else "")
        size = strength(entry)
        parts.append(part + (f" ({size})" if size else ""))
    return "The force model lacks " + "; and ".join(parts)


def _errors(verdict: dict[str, Any]) -> str:
    before, after = (percent(verdict[key]["heldout_nrmse"]) for key in ("before", "after"))
    return f"With it, the error on trials the model has not seen falls from {before} to {after} of the force"


def _floor(verdict: dict[str, Any]) -> str:
    return percent(verdict["noise_floor_nrmse"])


def _tried(tracing: Tracing, one_does: str, it_does: str) -> str:
    """What the effects that were tried do not do, in words, however many they were."""
    first = tracing.search.rounds[0] if tracing.search.rounds else None
    count = 0 if first is None else max(len(first.screened), len(first.candidates))
    if count == 0:
        return "no known effect could be tried"
    if count == 1:
        return f"the one known effect that was tried does not {it_does}"
    return f"none of the {count} known effects that were tried {one_does}"


def _depends_on(verdict: dict[str, Any]) -> str:
    return _listed([_SPELT_OUT.get(name, name) for name in verdict["remaining"]["depends_on"]])


def _listed(names: list[str]) -> str:
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + f" and {names[-1]}" if names else ""


def _kind(name: str) -> type[AbstractEffect] | None:
    try:
        return effect_class(name)
    except ValueError:
        return None
