"""The fit's residual: measured lines minus the lines of a force model, with each trial's own unknowns solved
inside.

Global unknowns x are six mechanistic constants and the coordinates of the effects. A trial's phase and (where
the sensor was zeroed before each trial) its bias are nuisances: for given x the phase is found by a search
over the whole turn and a few Gauss-Newton steps, the bias in closed form. What is returned is the whitened
residual with both projected out, whose Jacobian in x is Kaufman's variable projection (Golub and Pereyra,
Inverse Problems 19 (2003) R1-R26). So the outer problem is small, smooth, and the choice among phases that
differ by whole teeth is made anew at every step.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from mjx_cutting.cutting import AbstractEffect, Cut, ForceModel, Material, Tool, arc, order_lines
from mjx_cutting.tracing.course import along_path
from mjx_cutting.tracing.levels import LEVEL_KINDS
from mjx_cutting.tracing.line_gain import line_gain
from mjx_cutting.tracing.lines import Lines
from mjx_cutting.trials.dataset import Dataset, Trial

CONSTANTS = 6
_IN_PLANE = (0, 1, 3, 4)
_ANGLES_PER_TOOTH = 24
_FEWEST_ANGLES = 128
_ANGLES_PER_ORDER = 12
_PHASES = 1024
_GAUSS_NEWTON = 4
_TERMS = 3
_BIAS_SPREAD = 0.3
_MODEL_ERROR = 0.02
_PLACES = 6
_ARC_STEP = np.pi / 8.0
_TRIALS_STEP = 4


class Problem(eqx.Module):
    """Everything a fit reads, as arrays over R trials.

    Fields:
        tool: the cutter, with straight teeth (see `model_lines`).
        cut: conditions, every field [R].
        path_m: [R] length of the path that the record covers, about `cut.position_m`.
        whitened, factor, present: see `Lines`.
        gain: [R, orders + 1] complex response at each order of the known anti-alias filter and of the helix.
        weight: [3] 1 / standard deviation given to each axis, 1/N.
        bias_spread_n: [3] prior standard deviation of a trial's bias, N; 0 where all trials share one bias.
        scale: [6] units of the mechanistic constants, so that the unknowns are of order one.
        bias_unit_n: [] unit of a shared bias, N.
        shared_bias: True where the sensor was zeroed once a session (static).
        orders, angles: highest order and angles evaluated a turn (static).
        arc_rad: longest engagement arc of any trial, rounded up (static).
    """

    tool: Tool
    cut: Cut
    path_m: Array
    whitened: Array
    factor: Array
    present: Array
    gain: Array
    weight: Array
    bias_spread_n: Array
    scale: Array
    bias_unit_n: Array
    shared_bias: bool = eqx.field(static=True)
    orders: int = eqx.field(static=True)
    angles: int = eqx.field(static=True)
    arc_rad: float = eqx.field(static=True)

    @property
    def trials(self) -> int:
        """Number of trials R."""
        return self.whitened.shape[0]


def pose(dataset: Dataset, lines: Lines) -> Problem:
    """The fitting problem of a dataset's cut trials (call it in float64)."""
    trials = [trial for trial in dataset.trials if trial.kind == "cut"]
    shape = dataset.tool
    tool = Tool(shape.kind, shape.teeth, shape.diameter_m, helix_rad=0.0)
    places = [along_path(trial) for trial in trials]
    cuts = [
        Cut.milling(
            trial.milling or "slot",
            dataset.tool.diameter_m,
            angle_rad=0.0,
            spindle_speed_rev_s=float(speed),
            feed_speed_m_s=trial.feed_speed_m_s,
            radial_depth_m=trial.radial_depth_m,
            axial_width_m=trial.axial_width_m,
            position_m=float(np.mean(place)),
            cut_length_m=trial.cut_length_before_m + 0.5 * _length_m(trial),
            time_s=0.5 * float(trial.time_s[-1] - trial.time_s[0]),
            clock_s=trial.clock_start_s + 0.5 * float(trial.time_s[-1] - trial.time_s[0]),
        )
        for trial, place, speed in zip(trials, places, lines.speed_rev_s, strict=True)
    ]
    rms = np.sqrt(lines.energy_n2.sum() / lines.samples.sum() / 3.0)
    noise = lines.noise_std_n()
    shared = dataset.sensor.zeroed == "session"
    known = shared or dataset.tool.kind in LEVEL_KINDS
    angles = dataset.tool.teeth * int(
        np.ceil(
            max(_FEWEST_ANGLES, _ANGLES_PER_ORDER * lines.orders, _ANGLES_PER_TOOTH * dataset.tool.teeth)
            / dataset.tool.teeth
        )
    )
    return Problem(
        tool=tool,
        cut=jax.tree.map(lambda *leaves: jnp.asarray(leaves, dtype=float), *cuts),
        path_m=jnp.asarray([float(np.ptp(place)) for place in places]),
        whitened=jnp.asarray(lines.whitened),
        factor=jnp.asarray(lines.factor),
        present=jnp.asarray(lines.present),
        gain=jnp.asarray(
            line_gain(dataset, lines.speed_rev_s, np.array([t.axial_width_m for t in trials]), lines.orders)
        ),
        weight=jnp.asarray(1.0 / np.sqrt(noise**2 + (_MODEL_ERROR * _rms_by_axis(dataset, lines, rms)) ** 2)),
        bias_spread_n=jnp.full(3, 0.0 if known else _BIAS_SPREAD * rms),
        scale=jnp.asarray(
            _scale(trials, dataset.tool.teeth, dataset.tool.diameter_m, lines.speed_rev_s, rms)
        ),
        bias_unit_n=jnp.asarray(_BIAS_SPREAD * rms),
        shared_bias=shared,
        orders=lines.orders,
        angles=angles,
        arc_rad=_ARC_STEP * float(np.ceil(max(map(_arc, cuts)) / _ARC_STEP)),
    )


def _arc(cut: Cut) -> float:
    return float(np.asarray(cut.exit_rad) - np.asarray(cut.entry_rad))


def model_at(problem: Problem, x: Array, effects: Sequence[type[AbstractEffect]]) -> ForceModel:
    """The force model at the global unknowns `x` [6 + ...]."""
    constants = x[:CONSTANTS] * problem.scale
    start = CONSTANTS + (3 if problem.shared_bias else 0)
    parts = []
    for effect in effects:
        size = effect.size(problem.tool)
        parts.append(effect.build(x[start : start + size], problem.tool))
        start += size
    tc, rc, ac, te, re, ae = constants
    return ForceModel(problem.tool, Material(tc, te, rc, re, ac, ae), tuple(parts))


def unknowns(problem: Problem, effects: Sequence[type[AbstractEffect]]) -> int:
    """Number of global unknowns."""
    return CONSTANTS + (3 if problem.shared_bias else 0) + sum(e.size(problem.tool) for e in effects)


def padded(problem: Problem) -> Problem:
    """The problem with its last trial repeated up to a multiple of four: what is compiled for it serves more
    data sets. What the repeated trials leave is for the caller to drop."""
    rows = -(-problem.trials // _TRIALS_STEP) * _TRIALS_STEP
    index = np.minimum(np.arange(rows), problem.trials - 1)

    def by_trial(problem: Problem) -> tuple[Any, ...]:
        return (
            problem.cut, problem.path_m, problem.whitened, problem.factor, problem.present, problem.gain
        )  # fmt: skip

    return eqx.tree_at(by_trial, problem, jax.tree.map(lambda leaf: leaf[index], by_trial(problem)))


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


class Residual(eqx.Module):
    """What a model leaves of the measured lines.

    Fields:
        weighted: [R, P, 3] residual with nuisances projected out, in standard deviations.
        remaining_n: [R, P, 3] whitened residual with the nuisances at their best, N; its sum of squares is
        the
            squared error over the samples, less the part between the lines.
        phase_rad: [R] phase of each trial.
        bias_n: [R, 3] bias of each trial, N.
    """

    weighted: Array
    remaining_n: Array
    phase_rad: Array
    bias_n: Array


def residual(problem: Problem, x: Array, effects: tuple[type[AbstractEffect], ...]) -> Residual:
    """Residual of every trial at the global unknowns `x`."""
    return residual_of(problem, model_at(problem, x, effects), shared_bias(problem, x))


def shared_bias(problem: Problem, x: Array) -> Array:
    """[3] bias of the session, N, in the global unknowns; zero where each trial has its own."""
    return x[CONSTANTS : CONSTANTS + 3] * problem.bias_unit_n if problem.shared_bias else jnp.zeros(3)


def residual_of(problem: Problem, model: ForceModel, shared_bias_n: ArrayLike = 0.0) -> Residual:
    """Residual of every trial under a given model; `shared_bias_n` [3] is the session's bias, N."""
    return residual_of_lines(problem, model_lines(problem, model), shared_bias_n)


def _thrust_and_torque(model: ForceModel, cut: Cut) -> Array:
    """[3] nothing, torque (N m) and thrust (N) of a drill, as `levels` orders them."""
    thrust = model.sense(model.process_force(cut), cut)[2]
    return jnp.stack([jnp.zeros_like(thrust), model.torque_z(cut), thrust])


def _rms_by_axis(dataset: Dataset, lines: Lines, rms: float) -> np.ndarray[Any, Any]:
    """[3] size of the force that a model error is counted from; torque and thrust differ in unit."""
    if dataset.tool.kind != "drill":
        return np.full(3, rms)
    own = np.sqrt(lines.energy_n2.sum(axis=0) / lines.samples.sum())
    return np.where(own > 0.0, own, rms)


def residual_of_lines(problem: Problem, lines: Array, shared_bias_n: ArrayLike = 0.0) -> Residual:
    """Residual of every trial against given lines [R, orders + 1, 3], N."""
    shared = jnp.broadcast_to(jnp.asarray(shared_bias_n, dtype=float), (3,))
    solve = partial(_solve_trial, problem, shared)
    return jax.vmap(solve)(lines, problem.whitened, problem.factor, problem.present)


def model_lines(problem: Problem, model: ForceModel) -> Array:
    """[R, orders + 1, 3] complex lines of the sensed force of every trial, tooth 0 at angle zero, N.

    The tool is the problem's: straight teeth, since a helix only delays slices of the edge, which in the
    order domain is the exact factor (1 - exp(-i n lag)) / (i n lag) in `gain`.
    """
    if problem.tool.kind == "drill":
        return jax.vmap(partial(_thrust_and_torque, model))(problem.cut)[:, None] + 0j
    straight = ForceModel(problem.tool, model.material, model.effects)
    orders, angles, arc_rad = problem.orders, problem.angles, problem.arc_rad
    node, weight = np.polynomial.legendre.leggauss(_PLACES if by_position(model) else 1)

    def along(cut: Cut, path_m: Array) -> Array:
        places = cut.position_m + 0.5 * path_m * node

        def at(place: ArrayLike) -> Array:
            return order_lines(straight, cut.replace(position_m=place), orders, angles, arc_rad)

        return jnp.tensordot(0.5 * weight, jax.vmap(at)(places), axes=1)

    return jax.vmap(along)(problem.cut, problem.path_m) * problem.gain[..., None]


def by_position(model: ForceModel) -> bool:
    """Whether the response of an effect changes along the path."""
    return any(effect.by_position for effect in model.effects)


def as_measured(problem: Problem, lines: Array) -> Array:
    """[R, P, 3] lines [R, orders + 1, 3] as `Problem.whitened` holds those of a record."""
    real = jax.vmap(_real)(lines, problem.present)
    return jnp.einsum("rqp,rqa->rpa", problem.factor, real)


def marks(problem: Problem, lines: Array, phase_rad: Array) -> Array:
    """[R, P, 3] lines [R, orders + 1, 3] at given phases [R], whitened and weighted as the residual is."""
    return as_measured(problem, jax.vmap(_turned)(lines, phase_rad)) * problem.weight


def _solve_trial(
    problem: Problem, shared: Array, lines: Array, whitened: Array, factor: Array, present: Array
) -> Residual:
    weight, spread = problem.weight, problem.bias_spread_n
    constant = factor[0]
    norm = constant @ constant
    # closed-form bias with its prior: share of the projection on the constant that a bias takes away
    absorbed = (weight * spread) ** 2 * norm / (1.0 + (weight * spread) ** 2 * norm)

    def without_bias(value: Array) -> Array:
        return value - jnp.outer(constant, absorbed * (constant @ value) / norm)

    still = jax.lax.stop_gradient(lines)
    start = _best_phase(still, whitened, factor, weight)
    columns = _derivatives(_real(_turned(still, start), present), _TERMS)
    columns[0] = columns[0].at[0].add(shared)
    now, *slopes = jnp.split(-factor.T @ jnp.concatenate(columns, axis=1), 1 + _TERMS, axis=1)
    expansion = jnp.stack([without_bias(each) * weight for each in (whitened + now, *slopes)])
    phase = jax.lax.stop_gradient(start + _least_turn(expansion.reshape(1 + _TERMS, -1)))
    real = _real(_turned(lines, phase), present)
    remaining = whitened - factor.T @ real.at[0].add(shared)
    slope = without_bias(-factor.T @ jax.lax.stop_gradient(_derivatives(real, 1)[1])) * weight
    keep = 1.0 - jnp.sqrt(1.0 - absorbed)
    projected = (remaining - jnp.outer(constant, keep * (constant @ remaining) / norm)) * weight
    slope = slope / jnp.sqrt(jnp.maximum(jnp.sum(slope**2), 1e-30))
    projected = projected - slope * jnp.sum(slope * projected)
    bias = jnp.where(spread > 0.0, (constant @ remaining) / norm, 0.0)
    return Residual(projected, remaining - jnp.outer(constant, bias), phase, bias + shared)


def _derivatives(real: Array, highest: int) -> list[Array]:
    """[P, A] each: coefficients of 1, cos, sin, and their derivatives by the phase up to the highest."""
    order = jnp.arange(1, 1 + real.shape[0] // 2)[:, None]
    cosine, sine = real[1::2], real[2::2]
    turned = jnp.stack([order * sine, -order * cosine], axis=1).reshape(-1, real.shape[1])
    found = [real, jnp.concatenate([jnp.zeros_like(real[:1]), turned])]
    square = jnp.concatenate([jnp.zeros((1, 1)), jnp.repeat(order, 2, axis=0)]) ** 2
    while len(found) <= highest:
        found.append(-square * found[-2])
    return found


def _least_turn(expansion: Array) -> Array:
    """[] turn at which a residual, given by its value and derivatives [1 + terms, M], is least.

    Gauss-Newton on the Taylor series, of which only inner products are needed.
    """
    product = expansion @ expansion.T
    terms = len(product)
    factorial = np.cumprod([1.0, *range(1, terms)])

    def better(_: int, turn: Array) -> Array:
        value = turn ** np.arange(terms) / factorial
        slope = jnp.concatenate([jnp.zeros(1), value[:-1]])
        return turn - slope @ product @ value / jnp.maximum(slope @ product @ slope, 1e-30)

    return jax.lax.fori_loop(0, _GAUSS_NEWTON, better, jnp.zeros((), product.dtype))


def _turned(lines: Array, phase: Array) -> Array:
    """Lines of the same waveform with tooth 0 ahead by `phase`."""
    return lines * jnp.exp(1j * jnp.arange(lines.shape[0]) * phase)[:, None]


def _real(lines: Array, present: Array) -> Array:
    """[P, A] coefficients of 1, cos, sin from complex lines [orders + 1, A]."""
    pairs = jnp.stack([2.0 * lines.real[1:], -2.0 * lines.imag[1:]], axis=1).reshape(-1, lines.shape[1])
    return jnp.concatenate([lines.real[:1], pairs]) * present[:, None]


def _best_phase(lines: Array, whitened: Array, factor: Array, weight: Array) -> Array:
    """Phase on a grid of a turn at which the lines agree best with the measured ones, the mean left aside."""
    product = factor @ whitened
    measured = product[1::2] - 1j * product[2::2]
    agreement = jnp.sum(measured * jnp.conj(lines[1:]) * weight**2, axis=1)
    spectrum = jnp.zeros(_PHASES, dtype=agreement.dtype).at[1 : lines.shape[0]].set(agreement)
    return 2.0 * jnp.pi / _PHASES * jnp.argmax(jnp.fft.fft(spectrum).real)


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
