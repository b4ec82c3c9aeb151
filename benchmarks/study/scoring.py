"""Marks a verdict against the truth of its session."""

from __future__ import annotations

from typing import Any

import numpy as np

from .cases import Question
from .generator import make

# The parameter by which an effect's size is judged, where it is not a matter of convention.
STRENGTH = {
    "radial_runout": "offset_m",
    "unequal_pitch": "pitch_error_rad",
    "broken_tooth": "share",
    "size_effect": "exponent",
    "ploughing": "minimum_chip_m",
    "flank_wear": "kappa_n_m2",
    "helix_lag": "helix_rad",
    "static_compliance": "compliance_m_n",
    "robot_mode": "mass_ratio",
    "clamp_mode": "mass_ratio",
    "spindle_droop": "droop_rev_s_nm",
    "torque_ripple": "amplitude",
    "unbalance": "moment_kg_m",
    "side_friction": "drag_pa",
    "clogging": "gain",
    "material_periodicity": "amplitude",
    "layered_material": "change",
    "entry_exit": "start_m",
    "hysteresis": "coulomb_n",
    "process_damping": "damping_n_m",
    "sensor_lowpass": "cutoff_hz",
    "sensor_resonance": "frequency_hz",
    "crosstalk": "coupling",
    "thermal_drift": "drift_n",
    "mains_pickup": "amplitude_n",
    "command_stair": "share",
    "regenerative_chatter": "frequency_hz",
}

# What no channel of a drill shows of a value for each direction: the first force column, the radial edge.
UNHEARD = {"drill": {"amplitude_n": 0, "drift_n": 0, "kappa_n_m2": 1}}


def marked(question: Question, truth: dict[str, Any], verdict: dict[str, Any]) -> dict[str, Any]:
    """One row of the study: what was named, whether that is right, and how well the parameters came out.

    top1: the first name is right (all are, for a pair); top2: right among the first name, its runner-up and
    what was called ambiguous with it; refused: nothing named; wrong: a name that is not in the session.
    """
    hidden = set(question.effects) & set(truth["effects"])
    named = [each["name"] for each in verdict["effects"]]
    tied = {name for each in verdict["ambiguous"] for name in each["names"]}
    second = {each["runner_up"]["name"] for each in verdict["effects"][:1] if each.get("runner_up")}
    row: dict[str, Any] = {
        "key": question.key,
        "kind": question.kind,
        "design": question.design,
        "effects": list(question.effects),
        "strength": question.strength,
        "seed": question.seed,
        "verdict": verdict["verdict"],
        "named": named,
        "ambiguous": sorted(tied),
        "runner_up": sorted(second),
        "top1": bool(hidden) and set(named[: len(hidden)]) == hidden,
        "top2": bool(hidden) and hidden <= set(named[: len(hidden)]) | second | tied,
        "refused": not named,
        "wrong": bool(set(named) - hidden),
        "before": verdict["before"]["heldout_nrmse"],
        "after": verdict["after"]["heldout_nrmse"],
        "floor": verdict["noise_floor_nrmse"],
        "remaining": verdict["remaining"].get("depends_on", []),
        "parameters": {},
    }
    for each in verdict["effects"]:
        if each["name"] in hidden:
            true = truth["effects"][each["name"]]
            row["parameters"][each["name"]] = _parameter(each, true, UNHEARD.get(question.design, {}))
    return row


def _parameter(found: dict[str, Any], true: dict[str, Any], unheard: dict[str, int]) -> dict[str, Any]:
    """Truth, estimate, relative error and coverage of the parameter that is the effect's size, without the
    entry `unheard` of it."""
    name = STRENGTH[found["name"]]
    told = found["parameters"].get(name)
    if told is None:
        return {"name": name, "true": _plain(true[name])}
    known = np.atleast_1d(np.asarray(true[name], float))
    value, low, high = (
        _array(told.get(f"{word}s", told[word]), known.size) for word in ("value", "low", "high")
    )
    if name in unheard and known.size > unheard[name]:
        known, value, low, high = (np.delete(each, unheard[name]) for each in (known, value, low, high))
    if found["name"] == "unequal_pitch":
        turns = [np.roll(known, shift) for shift in range(known.size)]
        known = min(turns, key=lambda turn: float(np.nansum((turn - value) ** 2)))
    sized = float(np.linalg.norm(value - known) / max(np.linalg.norm(known), 1e-300))
    inside = (known >= low) & (known <= high)
    rated = np.isfinite(low) & np.isfinite(high)
    with np.errstate(divide="ignore", invalid="ignore"):
        sure = np.abs(value) / ((high - low) / 3.92)
    return {
        "name": name, "true": _plain(known), "value": _plain(value), "low": _plain(low), "high": _plain(high),
        "relative_error": sized if np.isfinite(sized) else None,
        "covered": float(np.mean(inside[rated])) if rated.any() else None,
        "standard_errors": float(np.nanmax(sure)) if np.isfinite(sure).any() else None,
    }  # fmt: skip


def seen_over_noise(question: Question) -> float | None:
    """RMS of what the effect changes in the record over the RMS of the sensor's noise."""
    if question.kind == "nothing":
        return None
    effects = dict.fromkeys(question.effects, question.strength)
    with_it = make(question.design, effects, question.seed, noise=1e-6)
    without = make(question.design, {}, question.seed, noise=1e-6)
    if with_it.dataset.sensor.zeroed != without.dataset.sensor.zeroed:
        return None
    plain = {trial.file: trial for trial in without.dataset.trials if trial.kind == "cut"}
    pairs = [(trial, plain[trial.file]) for trial in with_it.dataset.trials if trial.file in plain]
    change = [(a.signals - b.signals) for a, b in pairs if a.samples == b.samples]
    noise = make(question.design, {}, question.seed).dataset.sensor.noise_std_n or (0.0, 1.0, 0.01)
    if not change:
        return None
    scale = np.asarray(noise)[-change[0].shape[1] :]
    return float(np.sqrt(np.mean(np.square(np.concatenate(change) / scale))))


def _array(value: Any, size: int) -> np.ndarray:
    listed = np.atleast_1d(np.asarray([np.nan] if value is None else value, dtype=object)).ravel()
    made = np.array([np.nan if each is None else float(each) for each in listed])
    return made if made.size == size else np.full(size, np.nan)


def _plain(value: Any) -> Any:
    listed = np.asarray(value, float).tolist()
    return listed[0] if isinstance(listed, list) and len(listed) == 1 else listed
