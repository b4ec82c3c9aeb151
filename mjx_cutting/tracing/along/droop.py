"""Spindle droop, named from the speeds: how much each trial's spindle lost against the torque of the cut.

The lines of a record stand where the loaded spindle turned (`spindle`), so no fit to lines can show what
slowed it. What names droop is the law of the losses, stated - found = d T - e stated, with T the mean torque
under the fitted model and e one relative error of all stated speeds: a straight line through the trials,
steeper than chance makes it, and without which the losses are more than stated speeds may err by.

Held-out error: a speed may be up to 1 % off the stated one and is then fitted on the trial itself. "Before"
is the base model fitted and scored with every speed within that reach of the stated one, "after" with every
speed within that reach of what droop and e, fitted without the trial, say it is under load. Where no trial is
slower than that reach, droop cannot lower the error and is not named.

Where the speed itself was measured, as an angle or in a column, it is that of the loaded spindle, the nominal
speeds are the stated ones, and no more is read from records: so drills and turning tools show droop too.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy import stats

from mjx_cutting import _platform
from mjx_cutting.cutting import Cut, ForceModel, effect_class
from mjx_cutting.cutting.average import mean_load
from mjx_cutting.cutting.orders import swung
from mjx_cutting.tracing.along.slow_round import BeforeOthers, SlowCandidate, SlowRound
from mjx_cutting.tracing.fitting.fit import fit_base
from mjx_cutting.tracing.fitting.heldout import HeldOut, held_out, on_other_lines
from mjx_cutting.tracing.fitting.prediction import droop_of, loaded_about, predictions, without_droop
from mjx_cutting.tracing.fitting.problem import Problem, pose, shared_bias
from mjx_cutting.tracing.naming.decision import decide
from mjx_cutting.tracing.naming.intervals import interval
from mjx_cutting.tracing.naming.search import Search
from mjx_cutting.tracing.records.comb import SPREAD
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.lines import Lines, compress
from mjx_cutting.tracing.records.spindle import measured_speed, stated_speed
from mjx_cutting.trials.dataset import Dataset

NAME = "spindle_droop"
CHANCE = 1e-3
_TIMES_LESS_SURE = 10.0
Array = NDArray[np.floating]


def find_droop(dataset: Dataset, lines: Lines, found: Search) -> BeforeOthers | None:
    """Droop beside what the search over lines found (call it in float64); None where no spindle is slow."""
    trials = [trial for trial in dataset.trials if trial.kind == "cut"]
    measured = all(measured_speed(trial) is not None for trial in trials)
    stated = np.array([each.spindle_speed_rev_s if measured else stated_speed(each) for each in trials])
    slow = lines.speed_rev_s < (1.0 - SPREAD) * stated
    in_part = any(trial.spindle_angle_rad is not None for trial in trials)
    unread = not measured and (in_part or dataset.tool.kind in LEVEL_KINDS)
    if unread or len(trials) < 4 or not slow.any():
        return None
    kind = effect_class(NAME)
    loss = stated - lines.speed_rev_s
    torque = _torque(found.problem, found.final_fit.model)
    law = _law(loss, torque, stated)
    assert found.final.fits is not None
    fold, laws, centres = found.final.fold, [], np.empty_like(stated)
    for f in range(int(fold.max()) + 1):
        model = jax.tree.map(lambda leaf, f=f: leaf[f], found.final.fits.model)
        keep = fold != f
        own = _law(loss[keep], _torque(found.problem, model)[keep], stated[keep])
        about = loaded_about(
            dataset, without_droop(model).with_effects(kind(max(own.droop, 0.0))), stated, own.off
        )
        laws.append(own.droop)
        centres[~keep] = about[~keep]
    # the lines found may be those of records less what changes along them, which the base model has to face
    whole = compress(dataset, lines.band_hz, lines.speed_rev_s, like=lines) if measured else lines
    whole = replace(whole, droop_rev_s_nm=0.0)
    near = _near(dataset, whole, stated, measured)
    problem, base = fit_base(pose(dataset, near))
    before = held_out(problem, near, (), base.x, found.base.fold)
    after = _within_reach(dataset, lines, found, centres, measured)
    parameters = {"droop_rev_s_nm": interval(kind, "droop_rev_s_nm", law.droop, np.array(laws), law.spread)}
    # the trials speak through the law of the losses, of which few may be beyond what a stated speed may err
    rigid = _within_reach(dataset, lines, found, stated, measured)
    decision = decide(kind, rigid, after, law.chance * 0.01 / CHANCE, parameters, over_trials=False)
    effect = kind(law.droop)
    silent = tuple(np.zeros((len(trial.time_s), 3)) for trial in trials)
    candidate = SlowCandidate(kind, effect, after, decision, silent)
    tried = SlowRound(rigid, (candidate,), candidate if decision.accepted else None)
    shown = predictions(dataset, near, problem, base.model, shared_bias(problem, base.x))
    return BeforeOthers(tried, before, shown, _evidence(loss / stated, torque, law))


def _torque(problem: Problem, model: ForceModel) -> Array:
    """[R] mean torque of every trial at the speed it was cut at, N m, over time: a spindle that swings within
    the turn is longest where it is heavy."""
    model = ForceModel(problem.tool, model.material, model.effects)
    load = mean_load(model, problem.cut)
    torque = load.chip_torque + load.edge_torque
    if (droop := droop_of(model)) is not None:
        speed = jnp.asarray(problem.cut.spindle_speed_rev_s)
        torque = torque + _excess(problem, model) * speed / droop.droop_rev_s_nm
    return np.asarray(torque)


@_platform.jit_for_few_calls
def _excess(problem: Problem, model: ForceModel) -> jax.Array:
    """[R] by what share of its mean over time the mean over the angle of the speed exceeds that."""

    def of(cut: Cut) -> jax.Array:
        droop = droop_of(swung(model, cut, problem.orders, problem.angles, problem.arc_rad))
        return jnp.zeros(()) if droop is None or droop.turn is None else droop.turn.excess

    return jax.vmap(of)(problem.cut)


class Law(NamedTuple):
    """Losses over stated speed as d T / stated - e.

    Fields:
        droop: d, rev/s/(N m); spread: its standard error.
        off: e, the relative error of all stated speeds.
        beyond: chance of the losses where no stated speed errs by more than it may.
        along: chance that they go with the torque as much.
    """

    droop: float
    off: float
    spread: float
    beyond: float
    along: float

    @property
    def chance(self) -> float:
        """What is held against `CHANCE`: of going with the torque ten times as much will do."""
        return max(self.beyond, self.along / _TIMES_LESS_SURE)


def _law(loss: Array, torque: Array, stated: Array) -> Law:
    """The law of the losses [R], rev/s, under the torques [R], N m."""
    columns = np.stack([torque / stated, -np.ones_like(stated)], axis=1)
    share = loss / stated
    weights, *_ = np.linalg.lstsq(columns, share, rcond=None)
    freedom = max(len(share) - 2, 1)
    variance = max(float(np.sum((share - columns @ weights) ** 2)) / freedom, 1e-300)
    spread = float(np.sqrt(variance * np.linalg.pinv(columns.T @ columns)[0, 0]))
    without = float(np.sum((share - np.clip(share.mean(), -SPREAD, SPREAD)) ** 2)) - freedom * variance
    beyond = float(stats.f.sf(without / variance, 1, freedom))
    along = float(stats.t.sf(weights[0] / spread, freedom))
    return Law(float(weights[0]), float(weights[1]), spread, beyond, along)


def _near(dataset: Dataset, lines: Lines, about_rev_s: Array, measured: bool) -> Lines:
    """The lines of the trials at speeds within reach of those [R]; measured ones are brought there."""
    if not measured:
        return compress(dataset, lines.band_hz, about_rev_s=about_rev_s, like=lines)
    reach = SPREAD * about_rev_s
    speeds = np.clip(lines.speed_rev_s, about_rev_s - reach, about_rev_s + reach)
    return replace(lines, speed_rev_s=speeds)


def _within_reach(dataset: Dataset, lines: Lines, found: Search, centres: Array, measured: bool) -> HeldOut:
    """Held-out error of the final model, every speed within reach of what droop says."""
    if np.all(np.abs(lines.speed_rev_s - centres) <= SPREAD * centres):
        return found.final
    near = _near(dataset, lines, centres, measured)
    return on_other_lines(pose(dataset, near), near, found.effects, found.final)


def _evidence(share: Array, torque: Array, law: Law) -> tuple[str, ...]:
    light, heavy = int(np.argmin(torque)), int(np.argmax(torque))
    together = np.corrcoef(share, torque)[0, 1]
    return (
        f"the spindle turned {share[light]:.1%} slower than stated at {torque[light]:.3g} N m and "
        f"{share[heavy]:.1%} slower at {torque[heavy]:.3g} N m; over {len(share)} trials the loss goes with "
        f"the torque (correlation {together:.2f}, p = {law.along:.1g} by chance); p = {law.beyond:.1g} where "
        f"no stated speed errs by more than {SPREAD:.0%}",
        "without it, every speed was looked for within 1 % of the stated one; with it, within 1 % of what "
        "the motor's stiffness gives under the load of the trial",
    )
