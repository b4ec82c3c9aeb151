"""Two effects at once, one steady and one along the trial: either hides the other until it is taken out."""

from __future__ import annotations

import pytest

from benchmarks.study import make
from benchmarks.study.fewer import FEWER
from mjx_cutting.tracing.trace import trace


@pytest.mark.slow
def test_wear_is_found_beneath_a_periodic_material():
    """The variation with position, twelve per cent, is more than six times what wear leaves; none of it is
    taken for wear by a steady model, so nothing but what remains says that there is more to find."""
    hidden = {"flank_wear": "medium", "material_periodicity": "medium"}
    case = make("mill", hidden, seed=402)
    found = trace(case.dataset, effects=[*hidden, "clamp_mode", "layered_material", "size_effect"])
    assert {each["name"] for each in found.verdict["effects"]} == set(hidden)
    assert found.verdict["verdict"] == "explained"
    assert found.verdict["after"]["heldout_nrmse"] < 1.1 * found.verdict["noise_floor_nrmse"]
    periodic = next(each for each in found.model.effects if each.name == "material_periodicity")
    assert float(periodic.amplitude) == pytest.approx(0.25, rel=0.02)


@pytest.mark.slow
def test_a_pattern_that_every_tooth_meets_by_itself_is_found_as_that():
    """Over the arc of the slot it goes through two wavelengths: by the place of the centre there is none."""
    case = make("mill", {"material_periodicity": "medium"}, seed=404)
    true = case.truth["effects"]["material_periodicity"]
    assert true["tooth_place"] == 1.0
    found = trace(case.dataset, effects=["material_periodicity", "layered_material", "radial_runout"])
    (named,) = found.verdict["effects"]
    assert named["name"] == "material_periodicity"
    values = {name: each["value"] for name, each in named["parameters"].items()}
    assert values["tooth_place"] == 1.0
    assert values["amplitude"] == pytest.approx(true["amplitude"], rel=0.03)
    assert values["wavelength_m"] == pytest.approx(true["wavelength_m"], rel=1e-3)
    before, after = (found.verdict[each]["heldout_nrmse"] for each in ("before", "after"))
    assert after < 0.04 * before


@pytest.mark.slow
def test_drift_is_found_beneath_a_hum_of_the_mains():
    """The hum, different in each trial's share of the force, makes what drift brings look like scatter."""
    hidden = {"thermal_drift": "medium", "mains_pickup": "medium"}
    case = make("mill", hidden, seed=401)
    found = trace(case.dataset, effects=[*hidden, "flank_wear", "unbalance"])
    assert {each["name"] for each in found.verdict["effects"]} == set(hidden)
    assert found.verdict["after"]["heldout_nrmse"] < 1.1 * found.verdict["noise_floor_nrmse"]


@pytest.mark.slow
def test_runout_and_a_pattern_are_found_together_where_few_cuts_show_neither_alone():
    """Five cuts: what each leaves of the other's work is scatter, and alone chance might have made it."""
    case = make("mill", {"radial_runout": 0.5, "material_periodicity": 1.0}, seed=511)
    found = trace(FEWER["five"](case.dataset), effects=["radial_runout", "material_periodicity"])
    assert {each["name"] for each in found.verdict["effects"]} == {"radial_runout", "material_periodicity"}
    assert found.verdict["after"]["heldout_nrmse"] < 1.1 * found.verdict["noise_floor_nrmse"]
    true = case.truth["effects"]
    runout, pattern = (
        next(each for each in found.model.effects if each.name == name)
        for name in ("radial_runout", "material_periodicity")
    )
    assert float(runout.offset_m) == pytest.approx(true["radial_runout"]["offset_m"], rel=0.03)
    assert float(pattern.amplitude) == pytest.approx(true["material_periodicity"]["amplitude"], rel=0.03)
