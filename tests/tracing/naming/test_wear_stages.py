"""Wear in stages is wear: named, with the length that a run-in takes and where a late stage begins."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.cutting import Tool
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.naming.wear_stages import _kind
from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo, Trial

RATE_HZ, SAMPLES, NOISE_N = 200.0, 400, 0.5
LENGTHS_M = (0.0, 0.5, 1.5, 4.0, 7.0, 11.0, 16.0, 22.0, 30.0)
MORE_M = (0.3, 0.7, 1.0, 2.0, 3.0, 5.0, 9.0, 13.0, 19.0, 25.0, 28.0)
FEEDS_M = (5e-5, 2e-4, 1e-4)


def _turned(land_m, seed: int = 0, shorter: float = 1.0, lengths_m=LENGTHS_M) -> Dataset:
    """Cuts of one turning edge of which the wear land is `land_m(length cut)`, over 30 m or a session so many
    times shorter."""
    generator, trials = np.random.default_rng(seed), []
    width, speed = 1e-3, 15.0
    for index, length in enumerate(np.asarray(lengths_m) / shorter):
        feed = FEEDS_M[index % 3]
        level = width * (np.array([0.8e9, 2e9, 0.4e9]) * feed + np.array([3e4, 3e4, 1e4]))
        level += width * land_m(length) * np.array([8e8, 4e8, 3e8])
        trials.append(
            Trial(
                file=f"t{index}.csv",
                kind="cut",
                milling=None,
                spindle_speed_rev_s=speed,
                feed_speed_m_s=feed * speed,
                radial_depth_m=width,
                axial_width_m=width,
                cut_length_before_m=length,
                time_s=np.arange(SAMPLES) / RATE_HZ,
                force_n=level * np.array([-1.0, 1.0, -1.0]) + generator.normal(0.0, NOISE_N, (SAMPLES, 3)),
            )
        )
    tool, sensor = ToolInfo("turning", 1, 0.05), Sensor(RATE_HZ, (NOISE_N,) * 3, zeroed="session")
    return Dataset(name="turned", tool=tool, sensor=sensor, trials=tuple(trials))


@pytest.mark.parametrize("far", [-9000.0, 9000.0])
def test_stages_that_nothing_shows_are_finite_from_the_first_cut_on(far):
    """Nothing holds the length of a run-in that makes no land: a descent went to a length of zero."""
    kind = _kind(longest_m=20.0, runs_in=True, late=True)
    tool = Tool("slitting_saw", 20, 0.05)
    wear = kind.build(jnp.array([0.3, 0.5, 0.3, -abs(far), far, -abs(far), far]), tool)
    land_m = np.asarray(wear.land_m(np.array([0.0, 1e-9, 20.0])))
    assert np.all(np.isfinite(land_m)) and np.all(np.diff(land_m) > 0.0)


def test_a_run_in_is_found_with_its_length():
    def land_m(length: float) -> float:
        return 6e-5 * -np.expm1(-length / 2.0) + 3e-6 * length

    verdict = trace(_turned(land_m)).verdict
    (wear,) = verdict["effects"]
    assert wear["name"] == "flank_wear" and verdict["verdict"] == "explained"
    values = {name: each["value"] for name, each in wear["parameters"].items()}
    assert values["run_in_m"] == pytest.approx(2.0, rel=0.1)
    # only kappa times the land shows: the run-in's over that of a metre's steady wear
    assert values["initial_m"] / values["rate"] == pytest.approx(20.0, rel=0.1)


def test_wear_that_only_runs_in_is_wear():
    """Over one metre next to nothing wears evenly: kappa and the land could trade off without end."""
    verdict = trace(_turned(lambda length: 4e-5 * -np.expm1(-length / 0.4), shorter=30.0)).verdict
    (wear,) = verdict["effects"]
    assert wear["name"] == "flank_wear" and verdict["verdict"] == "explained"
    values = {name: each["value"] for name, each in wear["parameters"].items()}
    assert values["run_in_m"] == pytest.approx(0.4, rel=0.2)
    assert values["rate"] < 0.3 * values["initial_m"]


def test_a_late_stage_is_found_with_its_start():
    verdict = trace(_turned(lambda length: 1e-6 * length + 8e-6 * np.maximum(length - 13.0, 0.0))).verdict
    (wear,) = verdict["effects"]
    assert wear["name"] == "flank_wear" and verdict["verdict"] == "explained"
    values = {name: each["value"] for name, each in wear["parameters"].items()}
    assert values["late_start_m"] == pytest.approx(13.0, abs=1.0)
    assert values["late_rate"] / values["rate"] == pytest.approx(8.0, rel=0.2)
    assert values["initial_m"] == 0.0


def test_all_three_stages_are_found():
    def land_m(length: float) -> float:
        return 3e-5 * -np.expm1(-length / 1.0) + 2e-6 * length + 1e-5 * np.maximum(length - 18.0, 0.0)

    verdict = trace(_turned(land_m, lengths_m=sorted(LENGTHS_M + MORE_M))).verdict
    (wear,) = verdict["effects"]
    assert wear["name"] == "flank_wear" and verdict["verdict"] == "explained"
    values = {name: each["value"] for name, each in wear["parameters"].items()}
    assert values["run_in_m"] == pytest.approx(1.0, rel=0.15)
    assert values["late_start_m"] == pytest.approx(18.0, abs=1.5)
    assert values["initial_m"] / values["rate"] == pytest.approx(15.0, rel=0.2)


def test_a_run_in_and_a_late_stage_of_which_neither_alone_stands_out_are_found_together():
    """Beside what the one leaves, the other alone is no more than chance makes it."""

    def land_m(length: float) -> float:
        return 4e-5 * -np.expm1(-length / 0.5) + 1e-5 * length + 3e-5 * np.maximum(length - 6.2, 0.0)

    verdict = trace(_turned(land_m, lengths_m=np.linspace(0.0, 7.8, 16))).verdict
    (wear,) = verdict["effects"]
    assert wear["name"] == "flank_wear" and verdict["verdict"] == "explained"
    values = {name: each["value"] for name, each in wear["parameters"].items()}
    assert values["run_in_m"] == pytest.approx(0.5, rel=0.3)
    assert values["late_start_m"] == pytest.approx(6.2, abs=0.4)


def test_even_wear_is_told_without_stages():
    verdict = trace(_turned(lambda length: 6e-6 * length)).verdict
    (wear,) = verdict["effects"]
    assert wear["name"] == "flank_wear" and wear["parameters"]["initial_m"]["value"] == 0.0
    assert wear["parameters"]["late_rate"]["value"] == 0.0
    assert wear["parameters"]["kappa_n_m2"]["values"] == pytest.approx([6 * 4e8, 6 * 8e8, 6 * 3e8], rel=0.03)


def test_wear_of_two_inserts_is_named():
    """Of two tools, each held out once, nobody could say how sure a parameter is; so trials are held out."""
    lengths = (0.0, 2.0, 5.0, 9.0, 14.0, 20.0)
    first, second = (_turned(lambda length, per=per: per * length, lengths_m=lengths) for per in (5e-6, 8e-6))
    trials = [replace(each, tool_id="a") for each in first.trials]
    trials += [replace(each, tool_id="b", file=f"b{each.file}") for each in second.trials]
    verdict = trace(replace(first, trials=tuple(trials))).verdict
    (wear,) = verdict["effects"]
    assert wear["name"] == "flank_wear"
    assert 5 * 4e8 < wear["parameters"]["kappa_n_m2"]["values"][0] < 8 * 4e8
    assert verdict["after"]["heldout_nrmse"] < 0.5 * verdict["before"]["heldout_nrmse"]


def test_a_sharp_edge_has_none():
    assert trace(_turned(lambda length: 0.0)).verdict["verdict"] == "nothing missing"


def test_stages_that_drift_hides_at_first_are_found_beside_it():
    """Even wear is found first, then the drift of the sensor; only beside that do the stages show."""

    def land_m(length: float) -> float:
        return 5e-5 * -np.expm1(-length / 1.0) + 4e-6 * length

    lengths_m = sorted((*LENGTHS_M, *MORE_M))
    dataset = _turned(land_m, lengths_m=lengths_m)
    order = np.random.default_rng(1).permutation(len(lengths_m))
    trials = [
        replace(
            trial,
            clock_start_s=60.0 * after,
            force_n=trial.force_n + 25.0 * -np.expm1(-60.0 * after / 500.0) * np.array([-1.0, 1.0, 1.0]),
        )
        for trial, after in zip(dataset.trials, order, strict=True)
    ]
    verdict = trace(replace(dataset, trials=tuple(trials))).verdict
    assert {each["name"] for each in verdict["effects"]} == {"flank_wear", "thermal_drift"}
    wear = next(each["parameters"] for each in verdict["effects"] if each["name"] == "flank_wear")
    assert wear["run_in_m"]["value"] == pytest.approx(1.0, rel=0.2)
    assert verdict["verdict"] == "explained"
