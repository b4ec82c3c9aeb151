"""The fitting problem: measured lines of all trials, the conditions they were measured under, the unknowns of
a force model.

Global unknowns x are six mechanistic constants, a shared bias where the sensor was zeroed once a session,
and the coordinates of the effects; what each trial leaves unknown beside them is solved inside (`residual`).
So the outer problem is small, smooth, and the choice among phases that differ by whole teeth is made anew at
every step.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting import AbstractEffect, Cut, ForceModel, Material, Tool, arc
from mjx_cutting.tracing.fitting.sheets import sheet_of_each, sheets_of
from mjx_cutting.tracing.fitting.swinging import Swinging
from mjx_cutting.tracing.records.air import Air, air_levels, left_in_air
from mjx_cutting.tracing.records.course import along_path
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.line_gain import line_gain
from mjx_cutting.tracing.records.lines import Lines
from mjx_cutting.tracing.records.turns import holds_ripple
from mjx_cutting.trials.dataset import Dataset, Trial

TOLERANCE = 0.003
"""Share of the force by which two calculations of it may differ."""
CONSTANTS = 6
_IN_PLANE = (0, 1, 3, 4)
_ANGLES_PER_TOOTH = 24
_FEWEST_ANGLES = 128
_ANGLES_PER_ORDER = 12
_BIAS_SPREAD = 0.3
_MODEL_ERROR = 0.02
_ARC_STEP = np.pi / 8.0
_TRIALS_STEP = 4
_ORDERS_STEP = 8
_WIDTHS_APART = 1.1


class Problem(eqx.Module):
    """Everything a fit reads, as arrays over R trials.

    Fields:
        tool: the cutter; its teeth are computed as straight ones (see `fitting.model_lines`).
        cut: conditions, every field [R].
        path_m: [R] length of the path that the record covers, about `cut.position_m`.
        whitened, factor, present: see `Lines`; without the orders that are heard in no trial.
        heard: [K] orders compared, without the constant: P = 2 K + 1.
        gain: [R, orders + 1] complex response at each order of the known anti-alias filter.
        weight: [3] 1 / standard deviation given to each axis, 1/N.
        bias_spread_n: [3] prior standard deviation of a trial's bias, N; 0 where all trials share one bias.
        scale: [6] units of the mechanistic constants, so that the unknowns are of order one.
        bias_unit_n: [] unit of a shared bias, N.
        shared_bias: True where the sensor was zeroed once a session, and that shows (static).
        orders, angles: highest order and angles evaluated a turn (static).
        arc_rad: longest engagement arc of any trial, rounded up (static).
        motion: [R, K, 3] lines of the tool's motion at its measured angle, m, which is then no unknown; None
            for a straight path and phases of the trials' own.
        trust: [R, 3] factor on the weight of each trial; None: one.
        tolerance: share of the force by which any model of it may be wrong (static).
        given: effects that every model has, and that are not looked for (static).
        droop_rev_s_nm: [] about how far the motor gives way that is `given` as swinging, rev/s/(N m).
        air: levels in air, where all trials share one bias.
        alive: axes on which anything was recorded; of the others nothing is predicted (static).
    """

    tool: Tool
    cut: Cut
    path_m: Array
    whitened: Array
    factor: Array
    present: Array
    heard: Array
    gain: Array
    weight: Array
    bias_spread_n: Array
    scale: Array
    bias_unit_n: Array
    shared_bias: bool = eqx.field(static=True)
    orders: int = eqx.field(static=True)
    angles: int = eqx.field(static=True)
    arc_rad: float = eqx.field(static=True)
    motion: Array | None = None
    trust: Array | None = None
    given: tuple[type[AbstractEffect], ...] = eqx.field(static=True, default=())
    tolerance: float = eqx.field(static=True, default=TOLERANCE)
    droop_rev_s_nm: Array | None = None
    air: Air | None = None
    alive: tuple[bool, bool, bool] = eqx.field(static=True, default=(True, True, True))

    @property
    def trials(self) -> int:
        """Number of trials R."""
        return self.whitened.shape[0]

    @property
    def order(self) -> np.ndarray[Any, Any]:
        """[P] order of each basis function."""
        return np.concatenate([[0], np.repeat(np.asarray(self.heard), 2)])

    @property
    def weights(self) -> Array:
        """[R, 3] 1 / standard deviation given to each axis of each trial, 1/N."""
        return self.weight * (jnp.ones((self.trials, 3)) if self.trust is None else self.trust)

    @property
    def common(self) -> int:
        """Number of unknowns before those of the effects looked for."""
        bias = 3 if self.shared_bias else 0
        return CONSTANTS + bias + sum(each.size(self.tool) for each in self.given)


def cuts_of(dataset: Dataset, speed_rev_s: ArrayLike) -> Cut:
    """The cut trials [R] at the middle of their paths, at those speeds [R]."""
    trials = [trial for trial in dataset.trials if trial.kind == "cut"]
    cuts = [
        Cut.milling(
            trial.milling or "slot",
            dataset.tool.diameter_m,
            angle_rad=0.0,
            spindle_speed_rev_s=float(speed),
            feed_speed_m_s=trial.feed_speed_m_s,
            radial_depth_m=trial.radial_depth_m,
            axial_width_m=trial.axial_width_m,
            position_m=float(np.mean(along_path(trial))),
            cut_length_m=trial.cut_length_before_m + 0.5 * _length_m(trial),
            time_s=0.5 * float(trial.time_s[-1] - trial.time_s[0]),
            clock_s=trial.clock_start_s + 0.5 * float(trial.time_s[-1] - trial.time_s[0]),
            angle_holds_ripple=float(holds_ripple(trial)),
            sheet=float(sheet),
        )
        for trial, speed, sheet in zip(trials, np.asarray(speed_rev_s), sheet_of_each(dataset), strict=True)
    ]
    return jax.tree.map(lambda *leaves: jnp.asarray(leaves, dtype=float), *cuts)


def pose(dataset: Dataset, lines: Lines) -> Problem:
    """The fitting problem of a dataset's cut trials (call it in float64)."""
    trials = [trial for trial in dataset.trials if trial.kind == "cut"]
    shape = dataset.tool
    tool = Tool(shape.kind, shape.teeth, shape.diameter_m, shape.helix_rad, slices=1)
    places = [along_path(trial) for trial in trials]
    cut = cuts_of(dataset, lines.speed_rev_s)
    rms = np.sqrt(lines.energy_n2.sum() / lines.samples.sum() / 3.0)
    own_rms = np.sqrt(lines.energy_n2.sum(axis=1) / lines.samples)
    width = np.array([max(trial.axial_width_m, 1e-9) for trial in trials])
    noise = lines.noise_std_n()
    zeroed_once = dataset.sensor.zeroed == "session"
    air = air_levels(dataset)
    known = zeroed_once or dataset.tool.kind in LEVEL_KINDS
    angles = dataset.tool.teeth * int(
        np.ceil(
            max(_FEWEST_ANGLES, _ANGLES_PER_ORDER * lines.orders, _ANGLES_PER_TOOTH * dataset.tool.teeth)
            / dataset.tool.teeth
        )
    )
    heard = _heard(lines)
    kept = np.concatenate([[0], np.stack([2 * heard - 1, 2 * heard], axis=1).ravel()]).astype(int)
    return Problem(
        tool=tool,
        cut=cut,
        path_m=jnp.asarray([float(np.ptp(place)) for place in places]),
        whitened=jnp.asarray(lines.whitened[:, kept]),
        factor=jnp.asarray(lines.factor[:, kept[:, None], kept]),
        present=jnp.asarray(lines.present[:, kept]),
        heard=jnp.asarray(heard),
        gain=jnp.asarray(line_gain(dataset.sensor, lines.speed_rev_s, lines.orders)),
        weight=jnp.asarray(1.0 / np.sqrt(noise**2 + (_MODEL_ERROR * _rms_by_axis(dataset, lines, rms)) ** 2)),
        bias_spread_n=jnp.full(3, 0.0 if known else _BIAS_SPREAD * rms),
        scale=jnp.asarray(
            _scale(trials, dataset.tool.teeth, dataset.tool.diameter_m, lines.speed_rev_s, rms)
        ),
        bias_unit_n=jnp.asarray(_BIAS_SPREAD * rms),
        shared_bias=zeroed_once and (air is not None or _bias_shows(dataset.tool.kind, trials)),
        orders=lines.orders,
        angles=angles,
        arc_rad=_ARC_STEP * float(np.ceil(_longest_arc(cut) / _ARC_STEP)),
        given=(*sheets_of(dataset, own_rms / width), *((Swinging,) if lines.droop_rev_s_nm else ())),
        droop_rev_s_nm=jnp.asarray(lines.droop_rev_s_nm) if lines.droop_rev_s_nm else None,
        air=air,
        alive=_alive(trials),
    )


def _heard(lines: Lines) -> np.ndarray[Any, Any]:
    """[K] orders that are heard in any trial, and the lowest others up to a round number of them, so that
    what is compiled for one data set serves others."""
    present = lines.present[:, 1::2].any(axis=0)
    count = min(-(-int(present.sum()) // _ORDERS_STEP) * _ORDERS_STEP, lines.orders)
    return np.sort(1 + np.argsort(~present, kind="stable")[:count])


def _alive(trials: Sequence[Trial]) -> tuple[bool, bool, bool]:
    """Axes on which the records are not nil throughout, as those of a channel that was not connected are."""
    x, y, z = np.any([np.any(trial.force_n != 0.0, axis=0) for trial in trials], axis=0).tolist()
    return x, y, z


def _bias_shows(kind: str, trials: Sequence[Trial]) -> bool:
    """Whether a bias differs from an edge force, which over a level of one width it does not: there it stays
    part of that."""
    if kind not in LEVEL_KINDS:
        return True
    width = [trial.axial_width_m for trial in trials]
    return kind == "turning" and max(width) > _WIDTHS_APART * min(width)


def _longest_arc(cut: Cut) -> float:
    return float(np.max(np.asarray(cut.exit_rad) - np.asarray(cut.entry_rad)))


def model_at(problem: Problem, x: Array, effects: Sequence[type[AbstractEffect]]) -> ForceModel:
    """The force model at the global unknowns `x` [6 + ...]: `effects`, then those given."""
    constants = x[:CONSTANTS] * problem.scale
    start = CONSTANTS + (3 if problem.shared_bias else 0)
    parts = []
    for effect in (*problem.given, *effects):
        size = effect.size(problem.tool)
        built = effect.build(x[start : start + size], problem.tool)
        if isinstance(built, Swinging) and problem.droop_rev_s_nm is not None:
            built = built.in_unit(problem.droop_rev_s_nm)
        parts.append(built)
        start += size
    given = len(problem.given)
    tc, rc, ac, te, re, ae = constants
    return ForceModel(problem.tool, Material(tc, te, rc, re, ac, ae), (*parts[given:], *parts[:given]))


def unknowns(problem: Problem, effects: Sequence[type[AbstractEffect]]) -> int:
    """Number of global unknowns."""
    return problem.common + sum(effect.size(problem.tool) for effect in effects)


def padded(problem: Problem) -> Problem:
    """The problem with its last trial repeated up to a multiple of four: what is compiled for it serves more
    data sets. What the repeated trials leave is for the caller to drop."""
    rows = -(-problem.trials // _TRIALS_STEP) * _TRIALS_STEP
    index = np.minimum(np.arange(rows), problem.trials - 1)

    def by_trial(problem: Problem) -> tuple[Any, ...]:
        record = problem.cut, problem.path_m, problem.whitened, problem.factor, problem.present, problem.gain
        return (*record, *(each for each in (problem.motion, problem.trust) if each is not None))

    more = jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf)[index]), by_trial(problem))
    return eqx.tree_at(by_trial, problem, more)


def rescaled(problem: Problem, factor: float) -> Problem:
    """The same problem with every standard deviation multiplied by `factor`."""
    return eqx.tree_at(lambda p: p.weight, problem, problem.weight / factor)


def out_of_range(problem: Problem, x: Array, effects: Sequence[type[AbstractEffect]]) -> Array:
    """[...] how far each bounded quantity lies outside its range, in units of the range; zero inside.

    Bounded are the in-plane constants (not negative) and every parameter of an effect with its declared
    range.
    """
    parts = [jnp.minimum(x[jnp.array(_IN_PLANE)], 0.0)]
    for effect in model_at(problem, x, effects).effects:
        for name, parameter in effect.parameters.items():
            value = jnp.atleast_1d(jnp.asarray(getattr(effect, name), dtype=float))
            span = parameter.high - parameter.low
            parts.append(
                (jnp.maximum(value - parameter.high, 0.0) + jnp.minimum(value - parameter.low, 0.0)) / span
            )
    return jnp.concatenate(parts)


def beside_the_cuts(problem: Problem, x: Array, model: ForceModel) -> Array:
    """[...] weighted residual that holds in every set of cut trials: that of the levels in air."""
    if problem.air is None:
        return jnp.zeros(0)
    return left_in_air(problem.air, model, shared_bias(problem, x), problem.weight)


def shared_bias(problem: Problem, x: Array) -> Array:
    """[3] bias of the session, N, in the global unknowns; zero where each trial has its own, and in the
    channel in which a drill has nothing."""
    if not problem.shared_bias:
        return jnp.zeros(3)
    bias = x[CONSTANTS : CONSTANTS + 3] * problem.bias_unit_n
    return bias.at[0].set(0.0) if problem.tool.kind == "drill" else bias


def _rms_by_axis(dataset: Dataset, lines: Lines, rms: float) -> np.ndarray[Any, Any]:
    """[3] size of the force that a model error is counted from; torque and thrust differ in unit."""
    if dataset.tool.kind != "drill":
        return np.full(3, rms)
    own = np.sqrt(lines.energy_n2.sum(axis=0) / lines.samples.sum())
    return np.where(own > 0.0, own, rms)


def _length_m(trial: Trial) -> float:
    """Length cut in the trial, m."""
    return trial.feed_speed_m_s * float(trial.time_s[-1] - trial.time_s[0])


def _scale(
    trials: Sequence[Trial], teeth: int, diameter_m: float, speed_rev_s: np.ndarray[Any, Any], rms: float
) -> np.ndarray[Any, Any]:
    """[6] constants that would make a force of the measured size: three for the chip, three for the edge."""
    chip, width = [], []
    for trial, speed in zip(trials, speed_rev_s, strict=True):
        entry, exit_ = arc(trial.milling or "slot", trial.radial_depth_m, diameter_m)
        engaged = max(1.0, teeth * float(exit_ - entry) / (2.0 * np.pi))
        chip.append(trial.feed_speed_m_s / (teeth * speed))
        width.append(trial.axial_width_m * engaged)
    thickness = max(float(np.median(chip)), 1e-9)
    per_width = rms / max(float(np.median(width)), 1e-9)
    return np.array([per_width / thickness] * 3 + [per_width] * 3)
