"""How strong each hidden effect is: parameters drawn by name, design and strength, in the package's names.

Strengths "weak", "medium" and "strong" are 0.4, 1 and 2.5 times a physically usual value; a number is such a
factor itself. Where no usual value exists (wear, droop, clogging) the effect is set by what it does to the
session: growth of the edge force, loss of speed, share of the gullet.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .continuous import torque_nm
from .designs import Plan, TrueCut
from .milling import Milling, mean_load

LEVELS = {"weak": 0.4, "medium": 1.0, "strong": 2.5}
WEAR_RATE = 1e-6
Params = dict[str, Any]
Draw = Callable[[Plan, float, np.random.Generator], Params]

MILLS = ("mill", "saw")
ALL = ("mill", "saw", "drill", "turning")


def level(strength: str | float) -> float:
    """The factor of a strength."""
    if isinstance(strength, str):
        if strength not in LEVELS:
            raise ValueError(f"strength: got {strength!r}, expected one of {', '.join(LEVELS)} or a number.")
        return LEVELS[strength]
    return float(strength)


def _of(design: Plan, **values: float) -> float:
    return values[design.design]


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _turn(rng: np.random.Generator) -> float:
    return float(rng.uniform(-np.pi, np.pi))


def _runout(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    return {"offset_m": 1e-5 * g * _spread(rng), "angle_rad": _turn(rng)}


def _spread(rng: np.random.Generator) -> float:
    return float(np.exp(rng.uniform(-0.25, 0.25)))


def _pitch(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    error = rng.normal(size=plan.tool.teeth)
    error -= error.mean()
    usual = _of(plan, mill=0.02, saw=0.01)
    return {"pitch_error_rad": np.clip(usual * g * error / error.std(), -0.085, 0.085)}


def _broken(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    return {"share": float(np.clip(0.75 * g**0.35, 0.55, 1.0)), "tooth": 0.0}


def _size(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    return {"exponent": min(0.4, 0.2 * g * _spread(rng))}


def _plough(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    usual = _of(plan, mill=4e-6, saw=1.5e-6, drill=8e-6, turning=1.2e-5)
    return {"minimum_chip_m": min(2e-5, usual * g), "ratio": float(rng.uniform(2.0, 4.0))}


def _wear(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    longest = max(cut.length_before_m + cut.path_m for cut in plan.cuts)
    chip = 0.3 * _middle_chip(plan) if plan.design in ("drill", "turning") else 0.0
    force = plan.edge_n_m + plan.chip_n_m2 * chip
    share = np.array([0.15, 0.4, 0.25]) if plan.design != "drill" else np.array([0.15, 0.0, 0.3])
    grown = g * _spread(rng) * share * force.max() * np.where(force > 0.0, 1.0, 0.0)
    return {"kappa_n_m2": grown / (WEAR_RATE * longest), "rate": WEAR_RATE}


def _chatter(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    low, high = _of(plan, mill=250.0, saw=60.0), _of(plan, mill=560.0, saw=160.0)
    give = _of(plan, mill=4e-8, saw=4e-7) * g
    return {
        "compliance_m_n": give * np.exp(rng.uniform(-0.4, 0.4, 2)),
        "frequency_hz": rng.uniform(low, high) * np.exp(rng.uniform(-0.1, 0.1, 2)),
        "damping": rng.uniform(0.02, 0.05, 2),
    }


def _helix(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    return {"helix_rad": 0.2 * g * (1.0 if plan.tool.helix_rad == 0.0 else -1.0)}


def _compliance(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    return {"compliance_m_n": _of(plan, mill=3e-6, saw=1e-5) * g * _spread(rng)}


def _mode(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    frequency = rng.uniform(60.0, 220.0) if plan.design == "mill" else rng.uniform(12.0, 180.0)
    ratio, zeta = min(1.0, 0.2 * g), rng.uniform(0.02, 0.08)
    return {
        "mass_ratio": ratio,
        "frequency_hz": frequency,
        "damping": zeta,
        "direction_rad": _turn(rng) / 2.0,
    }


def _clamp(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    frequency = rng.uniform(80.0, 300.0) if plan.design == "mill" else rng.uniform(40.0, 180.0)
    slope, zeta = rng.uniform(1.0, 5.0) * _sign(rng), rng.uniform(0.01, 0.05)
    # half of the sheets are held at both ends: the frequency comes back on the way
    held = rng.choice([0.0, rng.uniform(0.5, 1.0)])
    return {
        "mass_ratio": min(1.0, 0.3 * g),
        "frequency_hz": frequency,
        "gradient_1_m": slope,
        "damping": zeta,
        "curvature_1_m2": -held * slope / max(cut.path_m for cut in plan.cuts),
    }


def _droop(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    cuts = [cut for cut in plan.cuts if cut.kind == "cut"]
    loads = [steady_torque(plan, cut) for cut in cuts]
    speed = np.mean([cut.speed_rev_s for cut in cuts])
    return {"droop_rev_s_nm": float(0.03 * g * speed / np.mean(loads))}


def _ripple(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    order = float(rng.choice([2, 3, 4, 6, 7, 10, 14]))
    return {"amplitude": 0.008 * g, "order": order, "phase_rad": _turn(rng)}


def _unbalance(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    return {"moment_kg_m": 2e-5 * g * _spread(rng), "phase_rad": _turn(rng)}


def _friction(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    return {"drag_pa": min(1e5, 3e4 * g)}


def _clog(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    areas = []
    for cut in (each for each in plan.cuts if each.kind == "cut"):
        entry, exit_ = milling_of(plan, cut, {}).arc()
        feed = cut.feed_m_s / (cut.speed_rev_s * plan.tool.teeth)
        areas.append(feed * 0.5 * plan.tool.diameter_m * (np.cos(entry) - np.cos(exit_)))
    return {"gain": 0.4 * g, "capacity_m2": float(np.max(areas) * rng.uniform(0.35, 0.6))}


def _periodic(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    drawn = {
        "amplitude": min(0.9, 0.25 * g),
        "wavelength_m": rng.uniform(2e-3, 1e-2),
        "phase_rad": _turn(rng),
    }
    # a pattern goes by the place of the tool's centre, or every tooth meets it by itself
    return drawn | ({"tooth_place": float(rng.integers(2))} if plan.design in MILLS else {})


def _layer(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    path = float(np.median([cut.path_m for cut in plan.cuts]))
    change = max(-0.9, 0.3 * g * _sign(rng))
    return {
        "change": change,
        "start_m": path * rng.uniform(0.15, 0.4),
        "length_m": path * rng.uniform(0.2, 0.4),
    }


def _entry(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    shortest = min(cut.path_m for cut in plan.cuts)
    longest = max(cut.path_m for cut in plan.cuts)
    length = 0.6 * longest if g > 2.0 else 1.0
    return {"share": 1.0, "start_m": shortest * rng.uniform(0.05, 0.15), "length_m": length}


def _hysteresis(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    usual = _of(plan, mill=8.0, saw=2.0, drill=6.0, turning=6.0)
    slow = float(np.median([cut.feed_m_s for cut in plan.cuts]))
    return {
        "coulomb_n": usual * g,
        "presliding_m": min(8e-3, slow * rng.uniform(0.1, 0.4)),
        "stiction": 1.0,
        "viscous_n_s_m": 0.4 * usual * g / slow,
    }


def _damping(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    return {
        "damping_n_m": 4e5 * g * _spread(rng),
        "vibration_m": 2e-5,
        "between_hz": _of(plan, mill=1.0, saw=0.5) * np.array([70.0, 240.0]),
        "seed": int(rng.integers(2**31)),
    }


def _lowpass(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    band = plan.sensor.anti_alias.hz if plan.sensor.anti_alias else 0.5 * plan.sensor.sample_rate_hz
    return {"cutoff_hz": 0.45 * band / g**0.7 * _spread(rng), "order": float(rng.integers(1, 5))}


def _resonance(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    band = plan.sensor.anti_alias.hz if plan.sensor.anti_alias else 0.5 * plan.sensor.sample_rate_hz
    frequency = float(np.clip(1.1 * band / g**0.7 * _spread(rng), 105.0, 1450.0))
    return {"frequency_hz": frequency, "damping": rng.uniform(0.02, 0.1)}


def _crosstalk(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    return {"coupling": np.clip(0.03 * g * rng.normal(size=6), -0.19, 0.19)}


def _drift(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    drift = _of(plan, mill=4.0, saw=1.0, drill=8.0, turning=4.0) * g * rng.normal(size=3)
    if plan.design == "drill":
        drift[1] *= 0.004
    return {"drift_n": drift, "tau_s": rng.uniform(300.0, 1800.0)}


def _mains(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    usual = _of(plan, mill=1.5, saw=0.3, drill=1.0, turning=0.6)
    amplitude = usual * g * np.exp(rng.normal(0.0, 0.4, 3))
    if plan.design == "drill":
        amplitude[1] *= 0.004
    frequency = float(rng.choice([50.0, 60.0])) + rng.normal(0.0, 0.02)
    return {"amplitude_n": amplitude, "phase_rad": rng.uniform(-np.pi, np.pi, 3), "frequency_hz": frequency}


def _stair(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    return {"share": 1.0, "period_s": 0.02, "deviation": 0.08 * g}


def _outside(plan: Plan, g: float, rng: np.random.Generator) -> Params:
    return {"size": 0.12 * g, "seed": int(rng.integers(2**31))}


DRAWS: dict[str, tuple[tuple[str, ...], Draw]] = {
    "radial_runout": (MILLS, _runout),
    "unequal_pitch": (MILLS, _pitch),
    "broken_tooth": (MILLS, _broken),
    "size_effect": (ALL, _size),
    "ploughing": (MILLS, _plough),
    "flank_wear": (ALL, _wear),
    "regenerative_chatter": (MILLS, _chatter),
    "helix_lag": (MILLS, _helix),
    "static_compliance": (MILLS, _compliance),
    "robot_mode": (MILLS, _mode),
    "clamp_mode": (MILLS, _clamp),
    "spindle_droop": (ALL, _droop),
    "torque_ripple": (ALL, _ripple),
    "unbalance": (MILLS, _unbalance),
    "side_friction": (("saw",), _friction),
    "clogging": (MILLS, _clog),
    "material_periodicity": (ALL, _periodic),
    "layered_material": (ALL, _layer),
    "entry_exit": (MILLS, _entry),
    "hysteresis": (("mill", "saw", "turning"), _hysteresis),
    "process_damping": (MILLS, _damping),
    "sensor_lowpass": (MILLS, _lowpass),
    "sensor_resonance": (MILLS, _resonance),
    "crosstalk": (("mill", "saw", "turning"), _crosstalk),
    "thermal_drift": (ALL, _drift),
    "mains_pickup": (ALL, _mains),
    "command_stair": (ALL, _stair),
}
"""Designs each effect of the library applies to, and how its parameters are drawn."""

OUTSIDE: dict[str, str] = {
    "gain_switching": "the force switches between two gains at random times",
    "position_slope": "the force varies smoothly with the position, alike in every trial",
    "random_walk_gain": "the gain of the force walks at random",
    "feed_speed_cross": "the force depends on the product of feed and speed deviations",
    "speed_softening": "the force falls with the logarithm of the cutting speed",
    "previous_force": "the force depends on the mean force of the second before",
    "speed_wander": "the spindle angle wanders at random about even turning",
    "worn_gear": "the spindle turns unevenly, at a fixed part of its own frequency",
    "sticking_chip": "a chip sticks to one tooth now and then, for some turns",
    "spikes": "single samples are hit by electrical interference",
}
"""What no library holds."""

OF_TEETH = ("speed_wander", "worn_gear", "sticking_chip")
"""Of those, what takes several teeth to show."""


def draw(name: str, plan: Plan, strength: str | float, rng: np.random.Generator) -> Params:
    """Parameters of an effect for a session."""
    if name in OUTSIDE:
        return _outside(plan, level(strength), rng)
    if name not in DRAWS:
        known = ", ".join([*DRAWS, *OUTSIDE])
        raise ValueError(f"effect: got {name!r}, expected one of {known}; correct the name.")
    designs, made = DRAWS[name]
    if plan.design not in designs:
        raise ValueError(f"{name}: got design {plan.design!r}, expected {', '.join(designs)}; choose one.")
    return made(plan, level(strength), rng)


def _middle_chip(plan: Plan) -> float:
    return float(np.median([c.feed_m_s / (c.speed_rev_s * plan.tool.teeth) for c in plan.cuts]))


def milling_of(plan: Plan, cut: TrueCut, effects: dict[str, Params]) -> Milling:
    """The trial to be cut."""
    return Milling(
        plan.tool.teeth, 0.5 * plan.tool.diameter_m, plan.tool.helix_rad, cut.milling or "slot", cut.depth_m,
        cut.width_m, cut.speed_rev_s, cut.feed_m_s, cut.phase_rad, plan.chip_n_m2, plan.edge_n_m,
        cut.length_before_m, effects,
    )  # fmt: skip


def steady_torque(plan: Plan, cut: TrueCut) -> float:
    """Torque of a cut without effects, N m."""
    made = milling_of(plan, cut, {})
    if plan.design in ("drill", "turning"):
        return torque_nm(made, plan.design == "drill")
    return mean_load(made)[1]
