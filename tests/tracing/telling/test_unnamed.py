"""What goes with a condition and has no name: a factor is fitted, added to the model, and never named."""

from __future__ import annotations

import json

import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks.study import make
from mjx_cutting.cutting import Cut, ForceModel, Material, Tool
from mjx_cutting.cutting.effects.unnamed_arc import along_arc
from mjx_cutting.cutting.effects.unnamed_gain import CONDITIONS, UnnamedGain
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.along.predicted import predict_trials
from mjx_cutting.tracing.trace import save
from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo, Trial


def over(condition: str, knots: tuple[float, ...], gain: tuple[float, ...]) -> UnnamedGain:
    places, values = np.zeros((6, 3)), np.zeros((6, 2))
    index = CONDITIONS.index(condition)
    places[index], values[index] = knots, gain
    return UnnamedGain(values.ravel(), places.ravel())


@pytest.mark.parametrize(
    "speed, factor",
    [(5.0, 1.0), (10.0, 1.0), (15.0, 1.1), (20.0, 1.2), (30.0, 0.8), (40.0, 0.4), (90.0, 0.4)],
)
def test_the_factor_is_straight_between_knots_and_constant_beyond(speed, factor):
    effect = over("spindle speed", (10.0, 20.0, 40.0), (0.2, -0.6))
    cut = Cut.milling(
        "slot",
        0.016,
        angle_rad=jnp.linspace(0.0, 6.0, 40),
        spindle_speed_rev_s=speed,
        feed_speed_m_s=0.01,
        radial_depth_m=0.016,
        axial_width_m=0.002,
    )
    bare = ForceModel(Tool("end_mill", 4, 0.016), Material(8e8, 2e4, 2.4e8, 1.6e4, 1e8, 4e3))
    force = bare.with_effects(effect).process_force(cut)
    np.testing.assert_allclose(force, factor * bare.process_force(cut), rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize(
    "cause, conditions",
    [
        ("speed_softening", ("spindle speed",)),
        ("feed_speed_cross", ("feed", "spindle speed", "feed with spindle speed")),
    ],
)
def test_a_law_nobody_modelled_is_fitted_and_left_unnamed(cause, conditions, tmp_path):
    case = make("turning", {cause: "strong"}, 311)
    found = trace(case.dataset, effects=("flank_wear", "size_effect", "ploughing"))
    verdict = found.verdict
    assert verdict["verdict"] == "unexplained" and verdict["effects"] == []
    assert verdict["after"]["heldout_nrmse"] == verdict["before"]["heldout_nrmse"]
    assert found.unnamed is not None and found.unnamed.over == conditions
    assert found.unnamed.after.nrmse < 0.3 * verdict["before"]["heldout_nrmse"]
    assert "unnamed factor" in verdict["remaining"]["description"]
    assert any("unnamed factor" in each for each in found.caveats)
    save(found, tmp_path)
    model = ForceModel.from_dict(json.loads((tmp_path / "model.json").read_text()))
    assert [type(each) for each in model.effects] == [UnnamedGain]
    left, bare = (predict_trials(case.dataset, each) for each in (model, found.base_model))
    error, without = (sum(float(np.sum(p.residual_n**2)) for p in each) for each in (left, bare))
    assert error < 0.1 * without


def _rolled(angle: np.ndarray) -> np.ndarray:
    """Strength of a sheet that is a fifth stronger along its grain, at 40 degrees, than on the mean."""
    return 1.0 + 0.2 * np.cos(2.0 * (angle - np.deg2rad(40.0)))


def _session_on(strength) -> Dataset:
    """Cuts of a mill of two straight teeth, whose force at every angle is so much times the chip's."""
    trials, rate_hz, noise_n = [], 4000.0, 0.3
    plan = [("slot", 0.008, 40), ("slot", 0.008, 90), ("slot", 0.008, 140)]
    plan += [("climb", 0.003, 80), ("conventional", 0.003, 80), ("conventional", 0.003, 130)]
    for seed, (milling, depth_m, chip_um) in enumerate(plan):
        rng, time = np.random.default_rng(seed), np.arange(2400) / rate_hz
        wide = np.arccos(1.0 - depth_m / 0.004)
        begin, end = (np.pi - wide, np.pi) if milling == "climb" else (0.0, wide)
        angle = rng.uniform(0.0, 6.0) + 2.0 * np.pi * 50.37 * time
        force = noise_n * rng.normal(size=(2400, 3))
        for tooth in range(2):
            own = (angle - np.pi * tooth) % (2.0 * np.pi)
            chip = (begin < own) * (own < end) * 0.002 * chip_um * 1e-6 * np.sin(own) * strength(own)
            t, r = 8e8 * chip, 2.5e8 * chip
            sine, cosine = np.sin(own), np.cos(own)
            force += np.stack([-t * cosine - r * sine, t * sine - r * cosine, -0.1 * t], axis=1)
        trials.append(
            Trial(
                file=f"t{seed}.csv",
                kind="cut",
                time_s=time,
                force_n=force,
                spindle_speed_rev_s=50.37,
                feed_speed_m_s=chip_um * 1e-6 * 2.0 * 50.37,
                radial_depth_m=depth_m,
                axial_width_m=0.002,
                milling=milling,
            )
        )
    tool, sensor = ToolInfo("end_mill", 2, 0.008), Sensor(rate_hz, (noise_n,) * 3)
    return Dataset(name="rolled", tool=tool, sensor=sensor, trials=tuple(trials))


def test_a_force_that_goes_with_the_angle_of_the_edge_is_fitted_and_left_unnamed(tmp_path):
    session = _session_on(_rolled)
    found = trace(session, effects=())
    assert found.verdict["verdict"] == "unexplained" and found.verdict["effects"] == []
    assert found.unnamed is not None and found.unnamed.over == ("tooth phase",)
    assert found.unnamed.after.nrmse < 0.25 * found.unnamed.before.nrmse
    save(found, tmp_path)
    model = ForceModel.from_dict(json.loads((tmp_path / "model.json").read_text()))
    (arc,) = model.effects
    angle = np.linspace(0.4, np.pi - 0.4, 30)
    factor = np.asarray(along_arc(arc.gain, angle))[:, 0]
    np.testing.assert_allclose(factor / factor.mean(), _rolled(angle) / _rolled(angle).mean(), atol=0.05)
    assert "along the arc the tangential force" in found.verdict["remaining"]["description"]


def test_of_few_multiples_of_tooth_passing_no_arc_is_fitted():
    """Two of them, at 101 and 201 Hz, are met by many a factor along the arc."""
    found = trace(_session_on(_rolled), effects=(), band_hz=(0.0, 250.0))
    assert found.verdict["verdict"] == "unexplained"
    assert "tooth phase" in found.verdict["remaining"]["depends_on"] and found.unnamed is None


def test_of_a_sheet_alike_in_every_direction_no_arc_is_fitted():
    found = trace(_session_on(np.ones_like), effects=())
    assert found.verdict["verdict"] == "nothing missing" and found.unnamed is None


def test_nothing_unnamed_is_added_where_a_name_explains_it():
    case = make("turning", {"size_effect": "medium"}, 311)
    found = trace(case.dataset, effects=("flank_wear", "size_effect", "ploughing"))
    assert [each["name"] for each in found.verdict["effects"]] == ["size_effect"]
    assert found.unnamed is None and "unnamed" not in found.verdict["remaining"]["description"]


def test_it_is_never_looked_for_by_name_or_listed_as_untestable():
    found = trace(make("turning", {}, 311).dataset, effects=("size_effect",))
    assert "unnamed_gain" not in {each["name"] for each in found.verdict["not_testable"]}
