"""Blind trials with hidden effects: `make` gives a dataset and the truth about it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mjx_cutting.trials.dataset import Dataset, Trial

from . import chatter, continuous, outside, sensing, shaking
from .designs import Plan, TrueCut, plan, stream
from .milling import Array, Milling, Params, grid_force, settle, smear
from .strengths import OUTSIDE, draw, milling_of

SETTLE_S = 0.3
_FINE_HZ = 16_000.0
_CHATTER_STEPS = {"mill": 80, "saw": 24}
_WITH_CHATTER = {
    "radial_runout", "size_effect", "ploughing", "unbalance", "sensor_lowpass", "sensor_resonance",
    "crosstalk", "thermal_drift", "mains_pickup", "robot_mode", "helix_lag", "side_friction",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Case:
    """A dataset and what is hidden in it.

    truth: "effects" {name: {parameter: value}} in the package's names and units, "outside" the same for what
    no library holds, "material" {"K_tc_n_m2", ...}, "trials" {file: {"speed_rev_s", "phase_rad",
    "bias_n"}}, "design", "seed", "strength".
    """

    dataset: Dataset
    truth: dict[str, Any]


def make(
    design: str,
    effects: dict[str, str | float] | None = None,
    seed: int = 0,
    *,
    noise: float = 1.0,
    new: bool = False,
) -> Case:
    """A blind dataset.

    Arguments:
        design: "mill", "saw", "drill" or "turning".
        effects: hidden effects by name with their strengths ("weak", "medium", "strong" or a factor on the
            medium); none for a session that the base model explains. Names beyond the library are in OUTSIDE.
        seed: everything follows from it; adding an effect changes nothing else.
        noise: factor on the sensor's noise (the stated figure follows).
        new: same tool, material and effects at new speeds and feeds, for scoring predictions.

    Raises ValueError on an unknown name or strength, or an effect that the design cannot show.
    """
    asked = dict(effects or {})
    if "regenerative_chatter" in asked and not set(asked) <= _WITH_CHATTER | {"regenerative_chatter"} | set(
        OUTSIDE
    ):
        raise ValueError(
            f"regenerative_chatter: got it with {sorted(asked)}, expected it with {sorted(_WITH_CHATTER)}."
        )
    session = plan(design, seed, tuple(asked))
    drawn = {name: draw(name, session, size, stream(seed, design, name)) for name, size in asked.items()}
    if new:
        session = plan(design, seed, tuple(asked), new=True)
    session, trials = recorded(session, drawn, seed, noise=noise, new=new)
    told = {
        trial.file: {
            "speed_rev_s": cut.speed_rev_s, "phase_rad": cut.phase_rad, "bias_n": bias.tolist(),
        }
        for trial, cut, bias in zip(trials, session.cuts, session.bias_n, strict=True)
    }  # fmt: skip
    dataset = Dataset(
        name=f"{design}-{seed}", source="benchmarks/study", licence="Apache-2.0", tool=session.tool,
        sensor=session.sensor, trials=trials,
    )  # fmt: skip
    truth = {
        "design": design, "seed": seed, "strength": dict(asked),
        "effects": {k: v for k, v in drawn.items() if k not in OUTSIDE},
        "outside": {k: v for k, v in drawn.items() if k in OUTSIDE},
        "material": _material(session),
        "trials": told,
    }  # fmt: skip
    return Case(dataset, truth)


def recorded(
    session: Plan, drawn: dict[str, Params], seed: int, *, noise: float = 1.0, new: bool = False
) -> tuple[Plan, tuple[Trial, ...]]:
    """The trials of a session with effects of given parameters; the session with its noise stated."""
    deviation_n = _noise(session, noise)
    if session.sensor.noise_std_n is not None:
        session = replace(session, sensor=replace(session.sensor, noise_std_n=tuple(map(float, deviation_n))))
    shaken = _shaken(session, drawn) if "regenerative_chatter" in drawn else {}
    trials = []
    for index, cut in enumerate(session.cuts):
        own = stream(seed, session.design, "trial", index, new)
        white = own.normal(size=(round(cut.duration_s * session.sensor.sample_rate_hz), 3)) * deviation_n
        trials.append(_trial(session, cut, drawn, index, own, white, shaken.get(index)))
    return session, tuple(trials)


def _material(session: Plan) -> dict[str, float]:
    """The constants under the package's names."""
    chip, edge = session.chip_n_m2, session.edge_n_m
    return {
        **{f"K_{way}c_n_m2": float(chip[i]) for i, way in enumerate("tra")},
        **{f"K_{way}e_n_m": float(edge[i]) for i, way in enumerate("tra")},
    }


def _noise(session: Plan, factor: float) -> Array:
    if session.design == "drill":
        return factor * np.array([0.0, 0.01, 1.0])
    assert session.sensor.noise_std_n is not None
    return factor * np.asarray(session.sensor.noise_std_n)


def _fine(session: Plan) -> tuple[int, float, int]:
    """Factor of the fine grid, its rate, and its samples of settling."""
    rate = session.sensor.sample_rate_hz
    factor = max(4, int(np.ceil(_FINE_HZ / rate)))
    return factor, rate * factor, int(np.ceil(SETTLE_S * rate)) * factor


def _trial(
    session: Plan,
    cut: TrueCut,
    drawn: dict[str, Params],
    index: int,
    own: np.random.Generator,
    white: Array,
    shaken: tuple[Array, Array] | None,
) -> Trial:
    factor, fine_hz, before = _fine(session)
    count = len(white)
    time = (np.arange(count * factor + before) - before) / fine_hz
    work = milling_of(session, cut, drawn)
    measured_feed = _travels(work, cut, drawn, own, count / session.sensor.sample_rate_hz)
    outside.wander(work, drawn, index)
    outside.stick(work, drawn, index)
    continuous_tool = session.design in ("drill", "turning")
    if cut.kind == "air":
        force = np.zeros((len(time), 3))
    elif continuous_tool:
        force = continuous.loads(work, time, session.design == "drill")
    else:
        work = settle(work)
        if shaken is None:
            force = grid_force(work, time[0], len(time), fine_hz)
        else:
            force = chatter.onto_grid(*shaken, time[0], len(time), fine_hz)
        force = smear(force, _lag_s(work, drawn), fine_hz)
        if "process_damping" in drawn:
            p = drawn["process_damping"]
            pressed = smear(shaking.rubbing(work, time, p), _lag_s(work, drawn), fine_hz)
            force = force + pressed * shaking.motion(time, index, p)[1][:, None]
    place = work.position(time)
    force = force * outside.gain(time, place, force, session, cut, drawn, index)[:, None]
    angle = work.phase_rad + 2.0 * np.pi * work.speed_rev_s * time
    area = sensing.segment_m2(work.radius_m, work.depth_m) if session.design == "saw" else 0.0
    force = sensing.structure(force, time, place, angle, work.speed_rev_s, drawn, cut.kind == "cut", area)
    force = sensing.sense(force, time, cut.clock_s, drawn, own)
    record = sensing.sampled(force, before, factor, session.sensor.anti_alias, fine_hz)
    record = outside.spiked(record + session.bias_n[index] + white, drawn, index)
    stamps = np.arange(count) / session.sensor.sample_rate_hz
    torque = None
    if session.design == "drill":
        torque = record[:, 1].copy()
        record = record * np.array([np.nan, np.nan, 1.0])
    position = np.zeros((count, 3))
    position[:, 0] = work.position(stamps)
    if "process_damping" in drawn:
        position[:, 1] = shaking.encoded(stamps, index, drawn["process_damping"])
    noisy = own.normal(0.0, 0.004 * cut.feed_m_s, count)
    return Trial(
        file=f"t{index + 1:02d}.csv", kind=cut.kind, milling=cut.milling,  # type: ignore[arg-type]
        spindle_speed_rev_s=cut.nominal_rev_s, feed_speed_m_s=cut.feed_m_s, radial_depth_m=cut.depth_m,
        axial_width_m=cut.width_m, tool_id=cut.tool_id, cut_length_before_m=cut.length_before_m,
        clock_start_s=cut.clock_s, time_s=stamps, force_n=record, torque_nm=torque,
        position_m=position if session.position or "process_damping" in drawn else None,
        feed_speed_measured_m_s=measured_feed(stamps) + noisy if session.feed else None,
    )  # fmt: skip


def _lag_s(work: Milling, drawn: dict[str, Params]) -> float:
    helix = work.helix_rad + drawn.get("helix_lag", {}).get("helix_rad", 0.0)
    return float(work.width_m * np.tan(helix) / work.radius_m / (2.0 * np.pi * work.speed_rev_s))


def _travels(
    work: Milling, cut: TrueCut, drawn: dict[str, Params], own: np.random.Generator, end_s: float
) -> Any:
    """Sets how the tool travels; returns what the feed sensor would show over time."""
    if "command_stair" not in drawn:
        return lambda time: np.full(len(time), cut.feed_m_s)
    p = drawn["command_stair"]
    knots = np.arange(0.0, end_s + 1.0, 0.05)
    walk = np.zeros(len(knots))
    for i in range(1, len(knots)):
        walk[i] = 0.85 * walk[i - 1] + np.sqrt(1.0 - 0.85**2) * own.normal()
    deviation = cut.feed_m_s * np.clip(p["deviation"] * walk, -0.7, 0.7)
    shown = lambda time: cut.feed_m_s + np.interp(time, knots, deviation)  # noqa: E731
    starts = np.arange(0.0, end_s + 0.5, p["period_s"])
    held = cut.feed_m_s + p["share"] * (shown(starts) - cut.feed_m_s)
    places = np.concatenate([[0.0], np.cumsum(held * p["period_s"])])
    ends = np.append(starts, starts[-1] + p["period_s"])
    work.travel = lambda time: np.where(time < 0.0, held[0] * time, np.interp(time, ends, places))
    return shown


def _shaken(session: Plan, drawn: dict[str, Params]) -> dict[int, tuple[Array, Array]]:
    """Process forces of the flexible tool for all cuts of a session at once."""
    indices = [i for i, cut in enumerate(session.cuts) if cut.kind == "cut"]
    cuts = [milling_of(session, session.cuts[i], drawn) for i in indices]
    _, fine_hz, before = _fine(session)
    end = max(session.cuts[i].duration_s for i in indices)
    made = chatter.forces(cuts, -before / fine_hz - 0.01, end + 0.01, _CHATTER_STEPS[session.design])
    return dict(zip(indices, made, strict=True))
