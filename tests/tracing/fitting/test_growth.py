"""Wear that goes on within a trial counts in the error on held-out trials."""

from __future__ import annotations

from dataclasses import replace

import jax
import numpy as np

from mjx_cutting.cutting import effect_class
from mjx_cutting.tracing.fitting.fit import fit_base
from mjx_cutting.tracing.fitting.heldout import folds, held_out
from mjx_cutting.tracing.naming.candidate import fitted
from mjx_cutting.trials.dataset import AntiAlias, Dataset, Sensor, ToolInfo
from mjx_cutting.trials.synthetic import Conditions, Sheet, make_trials

NOISE_N = 0.2


def _worn_while_cut(duration_s: float = 4.0) -> Dataset:
    """Six long cuts with a saw of which the edge force rises evenly by a half of itself over the session."""
    cuts = [
        Conditions(speed, speed * 20 * chip, 2e-3, 0.0016, "conventional")
        for speed in (17.0, 20.0)
        for chip in (2e-5, 4e-5, 6e-5)
    ]
    sensor = Sensor(500.0, (NOISE_N,) * 3, anti_alias=AntiAlias(order=4, hz=200.0))
    sharp, blunt = (
        make_trials(
            ToolInfo("slitting_saw", 20, 0.05),
            Sheet((6e8, 1.8e8, 6e7), (edge, edge, 0.3 * edge)),
            cuts,
            sensor,
            duration_s=duration_s,
            seed=3,
        )
        for edge in (1e4, 1.5e4)
    )
    trials, before_m = [], 0.0
    whole_m = sum(each.feed_speed_m_s for each in cuts) * duration_s
    for new, worn in zip(sharp.trials, blunt.trials, strict=True):
        land = ((before_m + new.feed_speed_m_s * new.time_s) / whole_m)[:, None]
        force = (1.0 - land) * new.force_n + land * worn.force_n
        trials.append(replace(new, force_n=force, cut_length_before_m=before_m))
        before_m += new.feed_speed_m_s * duration_s
    return replace(sharp, trials=tuple(trials))


def test_wear_explains_what_it_does_within_a_trial_too(posed):
    dataset, wear = _worn_while_cut(), effect_class("flank_wear")
    with jax.enable_x64(True):
        lines, problem = posed(dataset)
        problem, base = fit_base(problem)
        start = np.append(base.x, wear.starts(problem.tool)[0])
        fold = folds(dataset, 0)
        _, after = fitted(problem, lines, (wear,), start, fold)
        before = held_out(problem, lines, (), base.x, fold)
    passed = dataset.sensor.anti_alias.hz / 250.0
    noise = NOISE_N * np.sqrt(passed * 3.0 * lines.samples.sum() / lines.energy_n2.sum())
    between = np.sqrt(lines.rest_n2.sum() / lines.energy_n2.sum())
    # what no line of a whole trial holds is much more than noise
    assert between > 1.5 * noise
    assert after.nrmse < 1.1 * noise < 0.5 * before.nrmse
