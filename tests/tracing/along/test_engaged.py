"""Records that begin and end in the air, wherever each does, are traced where the tool is in the cut."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting.tracing import trace
from mjx_cutting.tracing.along.ends import way_in_m
from mjx_cutting.tracing.along.engaged import (
    SURELY_TURNS,
    at_places_of_their_own,
    engaged,
    mostly_in_the_cut,
)
from mjx_cutting.tracing.records.course import along_path
from mjx_cutting.trials.dataset import AntiAlias, Dataset, Sensor, ToolInfo
from mjx_cutting.trials.synthetic import Conditions, Sheet, make_trials

Times = dict[str, tuple[float, float]]


def _in_air_at_both_ends(dataset: Dataset, feed_speed_m_s: float) -> tuple[Dataset, Times]:
    """The trials with the tool going in and out over its radius; from when to when it is fully in."""
    generator, trials, times = np.random.default_rng(5), [], {}
    ramp_s = 0.5 * dataset.tool.diameter_m / feed_speed_m_s
    for trial in dataset.trials:
        bias, noise = generator.normal(0.0, 1.0, 3), generator.normal(0.0, 0.3, trial.force_n.shape)
        touch, leave = generator.uniform(0.1, 0.2), trial.time_s[-1] - generator.uniform(0.1, 0.2)
        inside = np.clip(np.minimum(trial.time_s - touch, leave - trial.time_s) / ramp_s, 0.0, 1.0)
        force = np.where(inside[:, None] == 0.0, noise, trial.force_n * inside[:, None]) + bias
        trials.append(replace(trial, force_n=force, feed_speed_m_s=feed_speed_m_s))
        times[trial.file] = (touch + ramp_s, leave - ramp_s)
    return replace(dataset, trials=tuple(trials)), times


def test_what_is_kept_lies_where_the_arc_is_full(mill):
    dataset, times = _in_air_at_both_ends(mill(), 0.16)
    found = engaged(dataset)
    assert found is not None and set(found.spans_s) == set(times)
    for file, (low, high) in found.spans_s.items():
        first, last = times[file]
        assert first - 1e-3 <= low < first + 0.1 and last - 0.1 < high <= last + 1e-3
    # the air has shown each trial's bias
    assert found.dataset.sensor.zeroed == "session"


def test_a_record_that_ends_on_the_way_out_is_kept_to_where_the_arc_is_full(mill):
    """It never reaches the air; the others do."""
    feed_m_s = 0.08
    dataset, times = _in_air_at_both_ends(mill(), feed_m_s)
    way_s = 0.5 * dataset.tool.diameter_m / feed_m_s
    short, (_, full_s) = dataset.trials[1], times[dataset.trials[1].file]
    kept = short.time_s < full_s + 0.7 * way_s
    short = replace(short, time_s=short.time_s[kept], force_n=short.force_n[kept])
    found = engaged(replace(dataset, trials=(dataset.trials[0], short, *dataset.trials[2:])))
    assert found is not None
    assert full_s - way_s < found.spans_s[short.file][1] < full_s
    last_m = along_path(next(each for each in found.whole.trials if each.file == short.file))[-1]
    assert found.touched_m[short.file][1] == pytest.approx(last_m, abs=1e-4)


@pytest.mark.parametrize("measured", [False, True])
def test_places_count_from_the_edge_where_every_record_has_it_elsewhere(mill, measured):
    """Of a position that was measured nobody knows better."""
    dataset, times = _in_air_at_both_ends(mill(), 0.16)
    if measured:
        places = [np.outer(0.16 * each.time_s, [1.0, 0.0, 0.0]) for each in dataset.trials]
        trials = [replace(t, position_m=place) for t, place in zip(dataset.trials, places, strict=True)]
        dataset = replace(dataset, trials=tuple(trials))
    found = engaged(dataset)
    assert found is not None and found.from_the_edge != measured
    assert at_places_of_their_own(dataset) != measured and not at_places_of_their_own(mill())
    counted = {each.file: each for each in found.whole.trials}
    full_m = []
    for file, (full_s, _) in times.items():
        place = np.interp(full_s, counted[file].time_s, along_path(counted[file]))
        full_m.append(place - 0.16 * full_s * measured)
    # the force is seen to rise a while after the first touch, in all of them by as much
    assert np.ptp(full_m) < 1e-3 and np.abs(full_m).max() < 0.15 * dataset.tool.diameter_m


def test_an_unbalance_in_the_air_is_no_cut(mill):
    """It goes round once a turn, as large as half of the force; the tool touches where it did without."""
    dataset, times = _in_air_at_both_ends(mill(), 0.16)
    size = 0.5 * np.sqrt(np.mean(dataset.trials[0].force_n ** 2))

    def unbalanced(trial):
        # the spindle turns 1 % faster than was said
        angle = 2.0 * np.pi * 1.01 * trial.spindle_speed_rev_s * trial.time_s
        wave = size * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
        return replace(trial, force_n=trial.force_n + wave)

    found = engaged(replace(dataset, trials=tuple(map(unbalanced, dataset.trials))))
    assert found is not None and set(found.spans_s) == set(times)
    for file, (low, high) in found.spans_s.items():
        first, last = times[file]
        assert first - 5e-3 <= low < first + 0.1 and last - 0.1 < high <= last + 5e-3


def test_a_slot_is_entered_over_its_radius_though_the_force_is_at_its_level_soon(mill):
    """The thickest chips, straight ahead, are met first: over half of the way in nothing grows any more."""
    made, feed_m_s, touch_s = mill(), 0.048, 0.1
    radius = 0.5 * made.tool.diameter_m
    trials = []
    for trial in made.trials:
        way = np.clip(feed_m_s * (trial.time_s - touch_s) / radius, 0.0, 1.0)
        angle = 2.0 * np.pi * (trial.spindle_speed_rev_s * trial.time_s[:, None] + np.arange(2) / 2.0)
        chip = np.maximum(np.sin(angle), 0.0)
        met = np.where(chip > 1.0 - way[:, None], chip, 0.0) * (way > 0.0)[:, None]
        force = 100.0 * np.stack([np.sum(met * np.cos(angle), axis=1), np.sum(met, axis=1)], axis=1)
        force = np.column_stack([force, 0.3 * force[:, 1]])
        depth = {"radial_depth_m": made.tool.diameter_m, "milling": "slot", "feed_speed_m_s": feed_m_s}
        trials.append(replace(trial, force_n=force, **depth))
    found = engaged(replace(made, tool=replace(made.tool, teeth=2), trials=tuple(trials)))
    assert found is not None and len(found.spans_s) == len(trials)
    assert min(low for low, _ in found.spans_s.values()) >= touch_s + radius / feed_m_s


def test_out_of_a_pocket_the_arc_is_full_at_once(mill):
    """The force is at its level within a turn: no way in is cut off, though geometry knows one."""
    made, trials, times = mill(), [], {}
    for index, trial in enumerate(made.trials):
        first, last = 0.15 + 0.01 * index, trial.time_s[-1] - 0.15
        cutting = (trial.time_s >= first) & (trial.time_s <= last)
        # a zero that is as large as half of the force
        force = np.where(cutting[:, None], trial.force_n, 0.0) + 0.5 * np.sqrt(np.mean(trial.force_n**2))
        trials.append(replace(trial, force_n=force))
        times[trial.file] = (first, last)
    found = engaged(replace(made, trials=tuple(trials)))
    assert found is not None and set(found.spans_s) == set(times)
    for file, (low, high) in found.spans_s.items():
        first, last = times[file]
        assert first < low < first + 0.08 and last - 0.08 < high < last


def test_a_sheet_shorter_than_the_way_in_never_holds_the_tool_fully(saw):
    """Its force is highest early, as out of a pocket, but it takes many turns to get there."""
    made, trials = saw(), []
    for index, trial in enumerate(made.trials):
        cut, way_s = trial.time_s - 0.4, way_in_m(trial.radial_depth_m, made.tool.diameter_m) / 0.01
        length_s = 2.5 if index < 3 else 0.45 * way_s
        inside = np.clip(np.minimum(np.minimum(cut, length_s), way_s + length_s - cut) / way_s, 0.0, 1.0)
        force = trial.force_n * inside[:, None]
        trials.append(replace(trial, force_n=force, feed_speed_m_s=0.01))
    found = engaged(replace(made, trials=tuple(trials)))
    assert found is not None
    assert {each.file for each in found.dataset.left_out} == {trial.file for trial in trials[3:]}
    assert set(found.spans_s) == {trial.file for trial in trials[:3]}


def test_a_record_that_is_hardly_in_the_cut_is_left_out_and_the_others_stay_whole(mill):
    made = mill()
    late, half = made.trials[2], slice(2000)
    force = np.where(late.time_s[:, None] < 0.26, 0.0, late.force_n)
    late = replace(late, time_s=late.time_s[half], force_n=force[half])
    trials = (*made.trials[:2], late, *made.trials[3:])
    found = engaged(replace(made, trials=trials))
    assert found is not None and found.spans_s == {}
    assert [each.file for each in found.dataset.left_out] == [late.file]
    assert found.dataset.trials == (*made.trials[:2], *made.trials[3:])
    assert str(found).endswith("so they are left out")


@pytest.mark.parametrize("air_share, mostly", [(0.0, False), (0.3, True), (0.6, True), (0.75, False)])
def test_records_are_mostly_in_the_cut_where_no_more_than_two_thirds_of_one_are_air(saw, air_share, mostly):
    made = saw()
    first = made.trials[0]
    cutting = first.time_s >= air_share * first.time_s[-1]
    begins = replace(first, force_n=np.where(cutting[:, None], first.force_n, 0.0))
    assert mostly_in_the_cut(replace(made, trials=(begins, *made.trials[1:]))) == mostly


def test_one_record_that_begins_in_the_air_costs_no_second_search(saw):
    """The whole records are held against the base model and the ends of the sheet alone."""
    made, told = saw(), []
    first = made.trials[0]
    begins = replace(first, force_n=np.where(first.time_s[:, None] >= 0.5, first.force_n, 0.0))
    dataset = replace(made, trials=(begins, *made.trials[1:]))
    found = trace(dataset, effects=("radial_runout", "entry_exit"), progress=told.append)
    assert any(first.file in each for each in found.caveats)
    assert told.count("screening radial_runout") == 1


@pytest.mark.parametrize("once", [2.0, 4.0])
def test_two_turns_of_air_are_air(saw, once):
    """Of a spindle that turns slowly, two turns are a good part of a record; where the ends of the sheet are
    known, more of them in one record show that they are not."""
    made, trials, times = saw(), [], {}
    for trial in made.trials:
        air_s = (once if not trials else 2.0) / trial.spindle_speed_rev_s
        first, last = air_s, trial.time_s[-1] - air_s
        cutting = (trial.time_s >= first) & (trial.time_s <= last)
        trials.append(replace(trial, force_n=np.where(cutting[:, None], trial.force_n, 0.5)))
        times[trial.file] = first, last
    found = engaged(replace(made, trials=tuple(trials)))
    assert found is not None and set(found.spans_s) == set(times)
    for file, (low, high) in found.spans_s.items():
        first, last = times[file]
        assert first <= low < first + 0.15 and last - 0.15 < high <= last
    surely = engaged(replace(made, trials=tuple(trials)), SURELY_TURNS)
    assert (surely is not None) == (once > SURELY_TURNS)
    if surely is not None:
        assert surely.spans_s == found.spans_s


@pytest.mark.parametrize(("turns", "kept"), [(5.0, False), (7.5, True)])
def test_six_turns_in_the_cut_are_enough(saw, turns, kept):
    made = saw()
    last = made.trials[-1]
    recorded = last.time_s < 14.0 / last.spindle_speed_rev_s
    cutting = last.time_s < (turns + 1.0) / last.spindle_speed_rev_s  # the last turn is trimmed
    force = np.where(cutting[:, None], last.force_n, 0.0)
    short = replace(last, time_s=last.time_s[recorded], force_n=force[recorded])
    found = engaged(replace(made, trials=(*made.trials[:-1], short)))
    assert found is not None and (short.file in found.spans_s) == kept
    assert [each.file for each in found.dataset.left_out] == ([] if kept else [short.file])


def test_half_a_turn_of_air_is_air_and_teeth_that_miss_are_none(mill):
    """One tooth of four that cuts in every turn leaves as long a gap, but in every turn."""
    made, short, lone = mill(), [], []
    for trial in made.trials:
        turn = trial.time_s * trial.spindle_speed_rev_s
        cutting = (turn < turn[-1] - 0.6)[:, None]
        short.append(replace(trial, force_n=np.where(cutting, trial.force_n, 0.0)))
        lone.append(replace(trial, force_n=np.where((turn % 1.0 < 0.4)[:, None], trial.force_n, 0.0)))
    found = engaged(replace(made, trials=tuple(short)))
    assert found is not None and set(found.spans_s) == {trial.file for trial in short}
    for trial in short:
        assert found.spans_s[trial.file][1] <= trial.time_s[-1] - 0.6 / trial.spindle_speed_rev_s
    assert engaged(replace(made, trials=tuple(lone))) is None


def _smooth(dataset: Dataset, swing_n, air_s: float) -> Dataset:
    """The trials with a force that swings once a turn by `swing_n` [R] about a level, after some air, and a
    zero of a third of it."""
    generator, trials = np.random.default_rng(2), []
    for trial, swing in zip(dataset.trials, swing_n, strict=True):
        turning = np.sqrt(2.0) * np.sin(2.0 * np.pi * trial.spindle_speed_rev_s * trial.time_s)
        level = np.array([-30.0, -5.0, -3.0]) + swing * turning[:, None] * np.array([1.0, 0.0, 0.0])
        force = np.where(trial.time_s[:, None] < air_s, 0.0, level) + np.array([1.0, -1.0, -9.5])
        trials.append(replace(trial, force_n=force + generator.normal(0.0, 0.17, force.shape)))
    return replace(dataset, trials=tuple(trials))


def test_a_record_is_in_air_that_is_as_still_as_others_are_there(saw):
    """Of teeth that pass faster than the sensor follows, the force hardly swings; its zero is large."""
    swing_n = [5.0, 1.6, 1.6, 5.0, 1.6]
    found = engaged(_smooth(saw(), swing_n, 0.8))
    assert found is not None and len(found.spans_s) == 5
    assert all(0.8 <= low < 1.0 for low, _ in found.spans_s.values())
    # none shows how still it is in the air, and a zero that large is not told from a force
    assert engaged(_smooth(saw(), [1.6] * 5, 0.8)) is None


def test_a_force_that_rests_in_the_cut_is_not_air(saw):
    """As still for a while as others are in the air, but about the same level."""
    dataset = _smooth(saw(), [5.0] * 5, 0.8)
    still = _smooth(saw(), [0.0] * 5, 0.0)
    last, rest = (each.trials[-1] for each in (_smooth(saw(), [1.6] * 5, 0.0), still))
    resting = replace(last, force_n=np.where(last.time_s[:, None] < 0.8, rest.force_n, last.force_n))
    found = engaged(replace(dataset, trials=(*dataset.trials[:-1], resting)))
    assert found is not None and resting.file not in found.spans_s and len(found.spans_s) == 4


def test_cuts_that_fill_their_records_are_left_alone(mill, saw):
    assert engaged(mill()) is None and engaged(saw()) is None


def test_the_air_in_records_is_not_called_an_effect():
    cuts = [
        Conditions(speed, speed * 20 * chip, depth, 0.0016, "conventional")
        for speed in (17.0, 19.0)
        for chip, depth in ((4e-5, 1e-3), (7e-5, 1e-3), (5e-5, 1.5e-3), (8e-5, 1.5e-3))
    ]
    sheet = Sheet((6e8, 1.8e8, 6e7), (1e4, 4e3, 1e3))
    sensor = Sensor(500.0, (0.1, 0.1, 0.2), anti_alias=AntiAlias(order=4, hz=200.0))
    made = make_trials(
        ToolInfo("slitting_saw", 20, 0.05), sheet, cuts, sensor, duration_s=4.0, bias_n=0.0, seed=3
    )
    feeds = {trial.file: trial.feed_speed_m_s for trial in made.trials}
    quick, _ = _in_air_at_both_ends(made, 0.05)
    true = tuple(replace(each, feed_speed_m_s=feeds[each.file]) for each in quick.trials)
    asked = ("radial_runout", "size_effect", "entry_exit")
    plain, found = (trace(each, effects=asked).verdict for each in (made, replace(quick, trials=true)))
    assert found["effects"] == [] and plain["effects"] == []
    assert found["after"]["heldout_nrmse"] < 1.3 * plain["after"]["heldout_nrmse"]
    assert "enters or leaves the sheet" in found["remaining"]["description"]


def test_a_record_that_is_in_the_cut_for_an_eighth_of_it_is_cut_down_to_that(saw):
    """Three quarters of its samples are of the air, and so is what is usual among them."""
    trials = [
        replace(trial, force_n=np.where(trial.time_s[:, None] > 3.5, 1.0, 1e-3) * trial.force_n)
        for trial in saw().trials
    ]
    found = engaged(replace(saw(), trials=tuple(trials)))
    assert found is not None and set(found.spans_s) == {trial.file for trial in trials}
    assert all(3.5 <= low < 3.7 and high > 3.9 for low, high in found.spans_s.values())


def test_noise_that_touches_now_and_then_in_the_air_is_no_cut(saw):
    """A weak cut, of which a sample in two hundred of the air behind it reaches a fifth."""
    made = saw()
    trials = []
    for trial in made.trials:
        force = np.where(trial.time_s[:, None] < 3.0, 1.0, 1e-3) * trial.force_n
        force[1560::200] = 0.6 * np.abs(trial.force_n).max(axis=0)
        trials.append(replace(trial, force_n=force))
    found = engaged(replace(made, trials=tuple(trials)))
    assert found is not None and set(found.spans_s) == {trial.file for trial in trials}
    assert all(2.7 < high <= 3.0 for _, high in found.spans_s.values())
