"""Drills and turning tools are traced by their levels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.study import make
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.records.course import along_path
from mjx_cutting.tracing.records.levels import as_levels
from mjx_cutting.trials import resolve
from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo, Trial

RATE_HZ, TOUCH_S = 250.0, 0.3
BONDS = {6.2e-3: -0.24, 9.8e-3: 0.12, 13.1e-3: 0.3}


def _drills(wear: float, seed: int = 0) -> Dataset:
    """Three drills of eight holes at three feeds; edge forces grow by `wear` of themselves a metre."""
    generator, trials = np.random.default_rng(seed), []
    radius, teeth = 3e-3, 2
    for drill in "abc":
        for hole in range(8):
            feed = (1e-4, 2e-4, 4e-4)[hole % 3]
            length = 0.01 * hole
            edge = 1.0 + wear * length
            thrust = teeth * radius * (1.5e9 * feed / teeth + 6e4 * edge)
            torque = teeth * radius * (2.5e9 * feed / teeth + 4e4 * edge) * radius / 2.0
            time = np.arange(500) / RATE_HZ
            inside = (time > TOUCH_S) & (time < 1.8)
            force = np.full((500, 3), np.nan)
            force[:, 2] = thrust * inside + generator.normal(0.0, 2.0, 500)
            trials.append(
                Trial(
                    file=f"{drill}{hole}.csv",
                    kind="cut",
                    milling=None,
                    spindle_speed_rev_s=13.0,
                    feed_speed_m_s=13.0 * feed,
                    radial_depth_m=radius,
                    axial_width_m=radius,
                    tool_id=drill,
                    cut_length_before_m=length,
                    time_s=time,
                    force_n=force,
                    torque_nm=torque * inside + generator.normal(0.0, 0.005, 500),
                )
            )
    return Dataset(
        name="drills",
        source="made by calculation",
        licence="Apache-2.0",
        tool=ToolInfo("drill", teeth, 2 * radius),
        sensor=Sensor(RATE_HZ),
        trials=tuple(trials),
    )


def test_only_the_steady_part_is_kept():
    before, after = _drills(0.0), as_levels(_drills(0.0))
    assert len(after.trials) == len(before.trials)
    for trial in after.trials:
        assert 0.3 < trial.time_s[0] < 0.6 and 1.5 < trial.time_s[-1] < 1.8
        assert np.all(trial.force_n[:, 0] == 0.0) and np.all(trial.force_n[:, 1:] > 0.0)


@pytest.mark.parametrize("comes_in", [False, True])
def test_ends_are_trimmed_where_the_tool_comes_in(turning_cut, comes_in):
    """A record that begins at the level of the force shows the sheet from its first sample."""
    time = np.arange(2000) / 200.0
    force = np.outer(np.where(time < 3.0, 1.0, 1.2), [-40.0, 90.0, -10.0])
    if comes_in:
        force *= np.minimum(0.6 + 0.4 * time, 1.0)[:, None]
    trial = turning_cut(time, force)
    made = Dataset(name="t", tool=ToolInfo("turning", 1, 0.04), sensor=Sensor(200.0), trials=(trial,))
    (kept,) = as_levels(made).trials
    assert len(kept.time_s) == (1800 if comes_in else 2000)


def test_thrust_counts_positive_whichever_way_it_was_recorded():
    """Else wear of a drill, which adds to the thrust, would be taken for the opposite of wear."""
    made = _drills(20.0)
    upward = replace(
        made,
        trials=tuple(replace(each, force_n=-each.force_n, torque_nm=-each.torque_nm) for each in made.trials),
    )
    for one, other in zip(as_levels(made).trials, as_levels(upward).trials, strict=True):
        np.testing.assert_array_equal(one.force_n, other.force_n)
    verdict = trace(upward, effects=("flank_wear", "size_effect")).verdict
    assert [each["name"] for each in verdict["effects"]] == ["flank_wear"]


def test_wear_of_drills_is_named_on_drills_held_out():
    verdict = trace(_drills(20.0), effects=("flank_wear", "size_effect", "ploughing")).verdict
    assert [each["name"] for each in verdict["effects"]] == ["flank_wear"]
    assert verdict["after"]["heldout_nrmse"] < 0.5 * verdict["before"]["heldout_nrmse"]


def test_sharp_drills_are_left_alone():
    verdict = trace(_drills(0.0), effects=("flank_wear", "size_effect", "ploughing")).verdict
    assert verdict["effects"] == [] and verdict["verdict"] == "nothing missing"


def _with(dataset: Dataset, change) -> Dataset:
    """The dataset with `change(trial, depth in the hole [T], inside [T])` in place of each trial."""
    trials = []
    for trial in dataset.trials:
        inside = trial.force_n[:, 2] > 0.5 * np.median(trial.force_n[100:400, 2])
        trials.append(change(trial, trial.feed_speed_m_s * (trial.time_s - TOUCH_S), inside))
    return replace(dataset, trials=tuple(trials))


def _layered(trial: Trial, position: np.ndarray, inside: np.ndarray) -> Trial:
    gain = 1.0 - 0.3 * ((position > 1.2e-3) & (position < 1.8e-3))
    return replace(trial, force_n=trial.force_n * gain[:, None], torque_nm=trial.torque_nm * gain)


def _humming(trial: Trial, position: np.ndarray, inside: np.ndarray) -> Trial:
    """Mains, at a phase of each trial's own."""
    phase = 2.0 * np.pi * 50.0 * (trial.time_s + 0.37 * trial.cut_length_before_m + len(trial.tool_id or ""))
    hum = np.zeros((len(phase), 3))
    hum[:, 2] = 20.0 * np.cos(phase)
    return replace(trial, force_n=trial.force_n + hum)


def test_a_layer_is_found_along_the_holes_and_not_where_all_have_one_feed():
    drills = _with(_drills(0.0), _layered)
    names = ("flank_wear", "layered_material", "material_periodicity", "mains_pickup")
    verdict = trace(drills, effects=names).verdict
    (layer,) = verdict["effects"]
    assert layer["name"] == "layered_material"
    assert layer["parameters"]["change"]["value"] == pytest.approx(-0.3, abs=0.02)
    assert layer["parameters"]["start_m"]["value"] == pytest.approx(1.2e-3, abs=5e-5)
    assert verdict["after"]["heldout_nrmse"] < 0.5 * verdict["before"]["heldout_nrmse"]
    alike = [each for each in drills.trials if each.feed_speed_m_s == drills.trials[0].feed_speed_m_s]
    verdict = trace(replace(drills, trials=tuple(alike)), effects=names).verdict
    assert verdict["effects"] == [] and verdict["verdict"] == "unexplained"
    needs = {each["name"]: each["needs"] for each in verdict["not_testable"]}
    assert "different feeds" in needs["layered_material"]


def test_a_layer_keeps_its_share_where_the_sensor_was_zeroed_once():
    # a bias would pass for edge force, and torque and thrust then change by different shares
    case = make("drill", {"layered_material": "medium"}, 203)
    session = replace(case.dataset, sensor=replace(case.dataset.sensor, zeroed="session"))
    (layer,) = trace(session, effects=("layered_material", "thermal_drift")).verdict["effects"]
    change = case.truth["effects"]["layered_material"]["change"]
    assert layer["parameters"]["change"]["value"] == pytest.approx(change, rel=0.05)


def _stacked(trial: Trial, position: np.ndarray, inside: np.ndarray) -> Trial:
    gain = np.where(position < 1.2e-3, 1.0, np.where(position < 1.8e-3, 2.0, 1.3))
    return replace(trial, force_n=trial.force_n * gain[:, None], torque_nm=trial.torque_nm * gain)


def test_layers_of_three_strengths_are_fitted_together():
    """The first layer found takes the mean of the two others for the force beside it."""
    found = trace(_with(_drills(0.0), _stacked), effects=("flank_wear", "layered_material"))
    layers = [each.effect.values() for each in found.along]
    assert [each.kind.name for each in found.along] == ["layered_material"] * 2

    def force(place_m):
        inside = (a["start_m"] < place_m < a["start_m"] + a["length_m"] for a in layers)
        return float(np.prod([1.0 + a["change"] * here for a, here in zip(layers, inside, strict=True)]))

    first, second, third = (force(place) for place in (0.8e-3, 1.5e-3, 3e-3))
    assert second / first == pytest.approx(2.0, abs=0.02)
    assert third / first == pytest.approx(1.3, abs=0.02)


def test_what_the_sensor_reads_in_the_air_before_the_cut_is_its_zero():
    made = _drills(0.0)
    made = replace(made, sensor=replace(made.sensor, zeroed="trial"))
    offsets = np.random.default_rng(1).normal(0.0, 30.0, len(made.trials))
    pairs = zip(made.trials, offsets, strict=True)
    off = replace(made, trials=tuple(replace(each, force_n=each.force_n + by) for each, by in pairs))
    for true, found in zip(as_levels(made).trials, as_levels(off).trials, strict=True):
        np.testing.assert_allclose(found.force_n.mean(axis=0), true.force_n.mean(axis=0), atol=1.0)
    # a sensor at its zero is left there, whatever its noise reads
    once = as_levels(replace(made, sensor=replace(made.sensor, zeroed="session")))
    cuts = [each for each in once.trials if each.kind == "cut"]
    for true, found in zip(cuts, as_levels(made).trials, strict=True):
        np.testing.assert_array_equal(found.force_n, true.force_n)


def test_air_beside_the_cut_stands_beside_the_cuts_where_the_session_was_zeroed_once():
    made = _drills(0.0)
    made = replace(made, sensor=replace(made.sensor, zeroed="session"))
    offsets = np.linspace(0.0, 40.0, len(made.trials))
    moved = tuple(
        replace(each, force_n=each.force_n + by, clock_start_s=60.0 * by)
        for each, by in zip(made.trials, offsets, strict=True)
    )
    airs = [each for each in as_levels(replace(made, trials=moved)).trials if each.kind == "air"]
    assert [each.file for each in airs] == [f"{each.file}, beside the cut" for each in made.trials]
    for air, by in zip(airs, offsets, strict=True):
        assert air.force_n[:, 2].mean() == pytest.approx(by, abs=1.0)
        assert air.clock_start_s == 60.0 * by and len(air.time_s) == len(air.force_n) < 0.3 * RATE_HZ


def test_air_after_the_cut_shows_the_zero_of_a_turning_tool(turning_cut):
    generator, offsets = np.random.default_rng(2), (3.0, -5.0, 2.0)
    time = np.arange(500) / RATE_HZ
    cut = np.outer(time < 1.5, (-40.0, 80.0, -15.0))
    trials = []
    for index, offset in enumerate(offsets):
        noise = generator.normal(0.0, 0.5, cut.shape)
        trials.append(turning_cut(time, cut + offset + noise, file=f"{index}.csv"))
    tool, sensor = ToolInfo("turning", 1, 0.03), Sensor(RATE_HZ, zeroed="trial")
    made = Dataset(
        name="cuts", source="made by calculation", licence="Apache-2.0", tool=tool, sensor=sensor,
        trials=tuple(trials),
    )  # fmt: skip
    for found in as_levels(made).trials:
        np.testing.assert_allclose(found.force_n.mean(axis=0), (-40.0, 80.0, -15.0), atol=0.2)


def test_a_zero_of_two_fifths_of_the_force_is_still_told_from_the_cut(turning_cut):
    generator, cutting = np.random.default_rng(3), np.array([-40.0, 80.0, -30.0])
    time = np.arange(500) / RATE_HZ
    shape = np.clip((time - 0.5) / 0.02, 0.0, 1.0)
    trials = []
    for index, zero in enumerate([(15.0, -30.0, 11.0), (-14.0, 5.0, -12.0), (2.0, 32.0, 4.0)]):
        force = np.outer(shape, cutting) + zero + generator.normal(0.0, 0.5, (500, 3))
        trials.append(turning_cut(time, force, file=f"{index}.csv"))
    tool, sensor = ToolInfo("turning", 1, 0.03), Sensor(RATE_HZ, zeroed="trial")
    for found in as_levels(Dataset(name="cuts", tool=tool, sensor=sensor, trials=tuple(trials))).trials:
        np.testing.assert_allclose(found.force_n.mean(axis=0), cutting, atol=0.2)


def test_what_wear_does_within_a_hole_counts_in_the_error():
    def wearing(trial: Trial, position: np.ndarray, inside: np.ndarray) -> Trial:
        more = 60.0 * (trial.cut_length_before_m + position - 0.5 * position[-1])
        edge = np.where(inside, 2.0 * 3e-3 * 6e4 * more, 0.0)
        return replace(trial, force_n=trial.force_n + edge[:, None] * [0, 0, 1])

    found = trace(_with(_drills(0.0), wearing), effects=("flank_wear", "size_effect"))
    assert [each["name"] for each in found.verdict["effects"]] == ["flank_wear"]
    left = sum(float(np.sum(each.residual_n**2)) for each in found.after)
    force = sum(float(np.sum(each.measured_n**2)) for each in found.after)
    after = found.verdict["after"]["heldout_nrmse"]
    assert after == pytest.approx(np.sqrt(left / force), rel=0.1)
    assert after < 1.2 * found.verdict["noise_floor_nrmse"]


def test_a_hum_of_the_mains_is_found_in_the_thrust():
    verdict = trace(_with(_drills(0.0), _humming), effects=("flank_wear", "mains_pickup")).verdict
    assert [each["name"] for each in verdict["effects"]] == ["mains_pickup"]
    assert verdict["effects"][0]["parameters"]["amplitude_n"]["value"] == pytest.approx(20.0, rel=0.05)
    assert verdict["verdict"] == "explained"


def test_drift_of_all_channels_is_named_where_the_session_was_zeroed_once():
    def drifting(trial: Trial, position: np.ndarray, inside: np.ndarray) -> Trial:
        clock = trial.clock_start_s + trial.time_s
        drift = 1.0 - np.exp(-clock / 600.0)
        torque = trial.torque_nm - 0.2 * drift
        return replace(trial, force_n=trial.force_n + 60.0 * drift[:, None] * [0, 0, 1], torque_nm=torque)

    sharp = _drills(0.0)
    places = np.random.default_rng(1).permutation(len(sharp.trials))
    clocked = [
        replace(each, clock_start_s=90.0 * place) for each, place in zip(sharp.trials, places, strict=True)
    ]
    session = replace(sharp, trials=tuple(clocked), sensor=replace(sharp.sensor, zeroed="session"))
    verdict = trace(_with(session, drifting), effects=("flank_wear", "thermal_drift", "size_effect")).verdict
    (drift,) = verdict["effects"]
    assert drift["name"] == "thermal_drift"
    _, torque_nm, thrust_n = drift["parameters"]["drift_n"]["values"]
    assert thrust_n == pytest.approx(60.0, rel=0.05) and torque_nm == pytest.approx(-0.2, rel=0.05)


def test_records_without_a_cut_are_refused_in_words():
    drills = _drills(0.0)
    idle = tuple(replace(each, kind="air") for each in drills.trials)
    with pytest.raises(ValueError, match="needs at least two"):
        trace(replace(drills, trials=idle))


def test_a_bar_that_is_softer_from_some_place_on_is_named_with_its_share(turning_cut):
    """Only the quickest cuts get there, and one of them alone goes on: the others say where it begins."""
    generator, trials = np.random.default_rng(6), []
    time = np.arange(400) / RATE_HZ
    law = (np.array([-9e8, 2e9, -7e8]), np.array([-4e4, 5e4, -3e4]))
    for index, chip_m in enumerate(1e-6 * np.array([50, 70, 170, 120, 50, 240, 60, 120, 340])):
        feed = 15.0 * chip_m
        place = feed * time
        force = 1e-3 * (chip_m * law[0] + law[1]) * np.where(place > 1.35e-3, 0.8, 1.0)[:, None]
        cut = turning_cut(time, force + generator.normal(0.0, 1.0, force.shape), file=f"{index}.csv")
        trials.append(
            replace(
                cut,
                spindle_speed_rev_s=15.0,
                feed_speed_m_s=feed,
                radial_depth_m=1e-3,
                axial_width_m=1e-3,
                position_m=np.stack([place, 0.0 * place, 0.0 * place], axis=1),
            )
        )
    tool, sensor = ToolInfo("turning", 1, 0.03), Sensor(RATE_HZ, (1.0, 1.0, 1.0), zeroed="session")
    made = Dataset(name="bar", tool=tool, sensor=sensor, trials=tuple(trials))
    verdict = trace(made, effects=("layered_material",)).verdict
    (layer,) = verdict["effects"]
    told = {name: each["value"] for name, each in layer["parameters"].items()}
    ends = (told["start_m"], told["start_m"] + told["length_m"])
    assert min(abs(1.35e-3 - end) for end in ends) < 2e-5
    assert 1.0 + told["change"] == pytest.approx(0.8 if told["change"] < 0.0 else 1.25, rel=0.02)
    assert verdict["after"]["heldout_nrmse"] < 2.0 * verdict["noise_floor_nrmse"]


@pytest.mark.slow
@pytest.mark.measured
def test_measured_drills_wear(measured_data):
    verdict = trace(resolve("drilling")).verdict
    assert [each["name"] for each in verdict["effects"]] == ["flank_wear"]
    assert verdict["after"]["heldout_nrmse"] < verdict["before"]["heldout_nrmse"]
    assert ["d14h45" in each["file"] for each in verdict["left_out"]] == [True]
    assert any(each["name"] == "radial_runout" for each in verdict["not_testable"])


def test_what_goes_with_the_force_of_the_cut_is_no_air():
    # cuts that end in a soft layer: a quarter of the force of each, as air that a sensor of one zero reads
    session = make("turning", {"layered_material": "strong"}, 403).dataset
    air = [trial.file for trial in as_levels(session).trials if trial.kind == "air"]
    assert air == [trial.file for trial in session.trials if trial.kind == "air"]


@pytest.mark.slow
def test_a_layer_is_judged_by_its_share_of_the_force_outside_it():
    # the steady model is at first that of the mean, of which the layer takes away more than there is
    case = make("turning", {"layered_material": "strong"}, 403)
    (layer,) = trace(case.dataset, effects=("layered_material",)).verdict["effects"]
    change = case.truth["effects"]["layered_material"]["change"]
    assert layer["parameters"]["change"]["value"] == pytest.approx(change, abs=0.01)


@pytest.mark.slow
def test_a_share_that_stays_out_of_its_range_is_refused():
    session = make("turning", {}, 403).dataset
    trials = []
    for trial in session.trials:
        place = along_path(trial)
        pulled = np.where((place > 1.3e-3) & (place < 4e-3), -0.5, 1.0)
        cut = trial.kind == "cut"
        trials.append(replace(trial, force_n=trial.force_n * pulled[:, None]) if cut else trial)
    found = trace(replace(session, trials=tuple(trials)), effects=("layered_material",))
    assert found.verdict["effects"] == []
    (only,) = found.slow[0].candidates
    assert not only.decision.physical and "physical range" in only.decision.reasons[0]


def _bonded_bar(rate_hz: float = 100.0) -> Dataset:
    """Cuts of a turned bar over parts of its length, whose k_c changes softly at three places."""
    generator, trials = np.random.default_rng(4), []
    stretches_mm = ((2, 10), (1, 17), (2, 17), (1, 17), (6, 15), (2, 17), (0, 15))
    chips_m, depths_m = 1e-4 * np.array([1, 2, 3, 2, 1, 3, 1.5]), 1e-3 * np.array([1, 1, 1, 2, 2, 0.5, 1.5])
    chip_law, edge_law = np.array([-5.5e8, 1.6e9, -3.2e8]), np.array([-3.5e4, 4.5e4, -3e4])
    for index, ((first, last), chip, depth) in enumerate(zip(stretches_mm, chips_m, depths_m, strict=True)):
        feed = 10.0 * float(chip)
        time = np.arange(int(1e-3 * (last - first) / feed * rate_hz)) / rate_hz
        place = 1e-3 * first + feed * time
        steps = [step * 0.5 * (1.0 + np.tanh((place - at) / 2.5e-4)) for at, step in BONDS.items()]
        force = depth * (chip * (1.0 + sum(steps))[:, None] * chip_law + edge_law)
        trials.append(
            Trial(
                file=f"{index}.csv",
                kind="cut",
                milling=None,
                spindle_speed_rev_s=10.0,
                feed_speed_m_s=feed,
                radial_depth_m=float(depth),
                axial_width_m=float(depth),
                time_s=time,
                force_n=force + 2.0 * generator.normal(size=force.shape),
                position_m=np.stack([place, 0.0 * place, 0.0 * place], axis=1),
            )
        )
    told = {"name": "bar", "source": "made by calculation", "licence": "Apache-2.0"}
    sensor = Sensor(rate_hz, (2.0, 2.0, 2.0), zeroed="session")
    return Dataset(**told, tool=ToolInfo("turning", 1, 0.045), sensor=sensor, trials=tuple(trials))


@pytest.mark.slow
def test_three_soft_borders_of_a_bar_are_found_though_two_layers_do_nearly_as_well():
    """No trial has all of the bar, and of two layers that overlap, three stretches have two levels."""
    found = trace(_bonded_bar(), effects=("layered_material",))
    borders = np.array([at for each in found.along for at in each.shape[:2].cumsum()])
    for true in BONDS:
        assert np.abs(borders - true).min() < 1.5e-4
    before, after = (found.verdict[each]["heldout_nrmse"] for each in ("before", "after"))
    assert after < 0.3 * before
