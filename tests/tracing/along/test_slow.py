"""Effects along a trial are found where they are, and a gain that only wanders is given no name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal, stats

from mjx_cutting.tracing.along.slow import search_slow
from mjx_cutting.tracing.along.slow_kinds import KINDS
from mjx_cutting.tracing.along.slow_try import Asked, fall_of_error, try_one
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.records.course import Course, along_path, felt_at
from mjx_cutting.tracing.records.line_gain import filter_delay_s, heard
from mjx_cutting.trials.dataset import AntiAlias, Sensor, Trial

RATE_HZ, SECONDS, TRIALS = 500.0, 4.0, 6
FEEDS = (0.008, 0.010, 0.0125, 0.015, 0.018, 0.02)
NOISE_N = 0.1


def _trials(gain, edge_share=0.0) -> tuple[tuple[Course, ...], HeldOut]:
    """Six cuts whose chip force, and a share of the edge's, is multiplied by 1 + gain(position, trial)."""
    found, error, energy = [], [], []
    time = np.arange(int(RATE_HZ * SECONDS)) / RATE_HZ
    for index, feed in enumerate(FEEDS):
        generator = np.random.default_rng(index)
        position = feed * time
        teeth = np.cos(2 * np.pi * 80.0 * time + index)[:, None]
        chip = (1.0 + 0.5 * teeth) * np.array([3.0, 5.0, 1.0])
        edge = np.full_like(chip, 2.0)
        varying = (chip + edge_share * edge) * gain(position, index)[:, None]
        left = varying + NOISE_N * generator.normal(size=chip.shape)
        found.append(
            Course(time, position, None, chip, edge, left - left.mean(axis=0), RATE_HZ, (0.0, 200.0))
        )
        error.append(np.sum(found[-1].left_n ** 2, axis=0))
        energy.append(np.sum((chip + edge + left) ** 2, axis=0))
    return tuple(found), HeldOut(np.stack(error), np.stack(energy), None, np.arange(TRIALS))


def _named(gain, edge_share=0.0):
    trials, before = _trials(gain, edge_share)
    rounds = search_slow(trials, before, np.full(3, 1.0 / NOISE_N))
    return [each.accepted for each in rounds if each.accepted is not None], rounds


@pytest.mark.parametrize("edge_share", [0.0, 1.0])
def test_a_periodic_material_is_named_with_its_size(edge_share):
    """Whether only the chip's resistance varies, or all of the sheet's."""
    (found, *more), _ = _named(lambda s, i: 0.3 * np.cos(2 * np.pi * s / 6e-3 + 0.5), edge_share)
    assert found.kind.name == "material_periodicity" and not more
    values = found.effect.values()
    assert values["amplitude"] == pytest.approx(0.3, rel=0.03)
    assert values["wavelength_m"] == pytest.approx(6e-3, rel=0.003)
    assert values["phase_rad"] == pytest.approx(0.5, abs=0.1)
    assert values["edge_share"] == edge_share
    assert found.heldout.nrmse == pytest.approx(NOISE_N * np.sqrt(3 / np.mean(
        [np.sum(e) / (RATE_HZ * SECONDS) for e in found.heldout.energy_n2])), rel=0.05)  # fmt: skip


def _with_a_layer(change: float, start_m: float, end_m: float):
    """The rounds on six cuts whose force changes by a share of it between two places."""
    trials = _trials(lambda s, i: 0.0 * s)[0]
    left = []
    for each in trials:
        inside = (each.position_m > start_m) & (each.position_m < end_m)
        more = change * inside[:, None] * (each.chip_n + each.edge_n)
        left.append(each.left_n + more - more.mean(axis=0))
    made = tuple(
        Course(t.time_s, t.position_m, None, t.chip_n, t.edge_n, one, RATE_HZ, t.band_hz)
        for t, one in zip(trials, left, strict=True)
    )
    error = np.stack([np.sum(one**2, axis=0) for one in left])
    before = HeldOut(error, 20.0 * error + 1e4, None, np.arange(TRIALS))
    return search_slow(made, before, np.full(3, 1.0 / NOISE_N))


def test_a_layer_is_named_with_its_place():
    found = _with_a_layer(0.4, 0.01, 0.018)[0].accepted
    assert found is not None and found.kind.name == "layered_material"
    values = found.effect.values()
    assert values["start_m"] == pytest.approx(0.01, abs=1e-4)
    assert values["length_m"] == pytest.approx(0.008, abs=1e-4)
    assert values["change"] == pytest.approx(0.4, rel=0.05)


@pytest.mark.parametrize("edge_share", [0.0, 1.0])
def test_a_layer_is_told_with_whether_the_edge_force_changes_too(edge_share):
    (found, *more), _ = _named(lambda s, i: np.where((s > 0.012) & (s < 0.02), 0.3, 0.0), edge_share)
    assert found.kind.name == "layered_material" and not more
    values = found.effect.values()
    assert values["edge_share"] == edge_share
    assert values["change"] == pytest.approx(0.3, rel=0.05)


def test_force_that_is_missing_at_the_end_of_the_path_is_no_layer():
    (round_,) = _with_a_layer(-0.6, -1.0, 0.006)
    assert round_.accepted is None
    layer = next(each for each in round_.candidates if each.kind.name == "layered_material")
    assert "enters or leaves the sheet" in layer.decision.reasons[0]


def test_a_layer_near_the_beginning_is_one_where_there_is_force_before_it():
    found = _with_a_layer(-0.3, 0.0008, 0.006)[0].accepted
    assert found is not None and found.kind.name == "layered_material"
    assert found.effect.values()["start_m"] == pytest.approx(0.0008, abs=1e-4)


@pytest.mark.parametrize(("start_m", "never"), [(0.042, 2), (0.051, 3)])
def test_a_deep_layer_is_named_that_some_of_six_cuts_never_reach(start_m, never):
    """They gain nothing from it, which says nothing against it."""

    def inside(position, index):
        return np.where((position > start_m) & (position < start_m + 0.005), -0.2, 0.0)

    (found,), rounds = _named(inside, edge_share=1.0)
    assert found.kind.name == "layered_material"
    assert found.effect.values()["start_m"] == pytest.approx(start_m, abs=2e-4)
    gained = np.sum(rounds[0].before.error_n2 - found.heldout.error_n2, axis=1)
    assert np.all(gained[never:] > 100.0 * np.abs(gained[:never]).max())


def test_noise_is_given_no_name():
    assert _named(lambda s, i: 0.0 * s)[0] == []


def test_a_gain_that_wanders_in_every_trial_anew_is_given_no_name():
    def wander(position, index):
        steps = np.random.default_rng(50 + index).normal(size=len(position))
        return 0.01 * np.cumsum(steps) / np.sqrt(5.0)

    assert _named(wander)[0] == []


@pytest.mark.parametrize("heights", [(0.3,), (0.5, -0.4, 0.4)], ids=["one swell", "three"])
def test_a_smooth_dependence_on_position_is_neither_called_periodic_nor_layers(heights):
    swells = list(zip(heights, (0.016, 0.037, 0.058), strict=False))
    found, rounds = _named(lambda s, i: sum(h * np.exp(-(((s - at) / 8e-3) ** 2)) for h, at in swells))
    assert found == []
    reasons = [why for each in rounds for one in each.candidates for why in one.decision.reasons]
    assert any("gradually" in why for why in reasons)


def test_a_smooth_rise_along_the_path_is_not_called_a_layer():
    assert _named(lambda s, i: 0.3 * np.tanh((s - 0.02) / 0.012))[0] == []


HUM = np.array([0.3, 0.2, 0.25])


def test_three_layers_and_two_lines_of_the_mains_are_all_found():
    def gain(s, i):
        return np.select([s < 0.004, s < 0.010, s < 0.013], [0.0, 0.45, -0.3], 0.2)

    trials, _ = _trials(lambda s, i: 0.0 * s)
    made = []
    for index, each in enumerate(trials):
        turn = 2 * np.pi * 50.02 * each.time_s[:, None] + 1.7 * index
        varied = gain(each.position_m, index)[:, None] * (each.chip_n + each.edge_n)
        more = varied + HUM * np.cos(turn) + 0.5 * HUM * np.cos(2.0 * turn + 0.4)
        made.append(replace(each, left_n=each.left_n + more - more.mean(axis=0)))
    error = np.stack([np.sum(each.left_n**2, axis=0) for each in made])
    before = HeldOut(error, 20.0 * error, None, np.arange(TRIALS))
    rounds = search_slow(made, before, np.full(3, 1.0 / NOISE_N))
    named = [each.accepted.kind.name for each in rounds if each.accepted is not None]
    assert sorted(named) == ["layered_material"] * 3 + ["mains_pickup"] * 2


def test_what_a_model_may_be_off_anyway_is_not_named():
    trials, before = _trials(lambda s, i: 0.3 * np.cos(2 * np.pi * s / 6e-3 + 0.5))
    (first, *_) = search_slow(trials, before, np.full(3, 1.0 / NOISE_N), tolerance=0.5)
    assert first.accepted is None and "accounts for" in first.candidates[0].decision.reasons[0]


def test_places_are_those_where_the_force_arose_before_the_filter():
    sensor = Sensor(1000.0, anti_alias=AntiAlias(order=4, hz=200.0))
    delay = filter_delay_s(sensor)
    frequency, response = signal.freqs(*signal.butter(4, 2.0 * np.pi * 200.0, analog=True), worN=[1e-3, 2e-3])
    expected = -float(np.diff(np.angle(response))[0] / np.diff(frequency)[0])
    assert delay == pytest.approx(expected, rel=1e-4)
    assert filter_delay_s(Sensor(1000.0, anti_alias=AntiAlias(zero_phase=True))) == 0.0
    assert filter_delay_s(Sensor(1000.0)) == 0.0
    time = 0.5 + np.arange(400) / 1000.0
    trial = Trial(
        file="t.csv",
        kind="cut",
        milling="slot",
        spindle_speed_rev_s=20.0,
        feed_speed_m_s=0.01,
        radial_depth_m=0.016,
        axial_width_m=0.002,
        time_s=time,
        force_n=np.zeros((400, 3)),
    )
    np.testing.assert_allclose(felt_at(trial, delay), along_path(trial) - 0.01 * delay, atol=1e-12)


@pytest.mark.parametrize("zero_phase", [False, True])
def test_what_steps_is_heard_as_the_known_filter_passes_it(zero_phase):
    """Against the filter in time, on a grid of its own."""
    alias, finer = AntiAlias(order=4, hz=60.0, zero_phase=zero_phase), 40
    time = np.arange(400 * finer) / (500.0 * finer)
    # ramps of 8 ms, which samples show, one after another
    value = np.interp(time, np.arange(0.0, 0.9, 0.008), np.random.default_rng(3).normal(size=113))
    sections = signal.butter(4, 60.0, fs=500.0 * finer, output="sos")
    run = signal.sosfiltfilt if zero_phase else signal.sosfilt
    expected = run(sections, value - value[0], axis=0)[::finer] + value[0]
    seen = heard(value[::finer], alias, 500.0)
    np.testing.assert_allclose(seen[20:-20], expected[20:-20], atol=0.06)
    np.testing.assert_array_equal(heard(value, None, 500.0), value)


@pytest.mark.parametrize("pitch_s", [1e-9, 0.012, 0.05])
def test_a_stair_holds_the_feed_of_its_own_beginning_and_each_tooth_cuts_what_was_fed_since_the_last(pitch_s):
    time, period = np.arange(100) / RATE_HZ, 0.02
    one = np.ones((100, 3))
    band = (0.0, 200.0)
    course = Course(time, 0.01 * time, time, one, one, one, RATE_HZ, band, pitch_s=pitch_s)
    (stair,) = (each for each in KINDS if each.name == "command_stair")
    fine = np.arange(-0.1, time[-1], 1e-5) + 0.5e-5
    held = np.maximum(period * np.floor(fine / period), 0.0)
    cut = [held[(fine > t - pitch_s) & (fine < t)] for t in time]
    expected = [each.mean() if len(each) else held[min(np.searchsorted(fine, t), len(fine) - 1)]
                for each, t in zip(cut, time, strict=True)]  # fmt: skip
    off_steps = np.abs(np.sin(np.pi * time / period)) > 1e-6
    seen = stair.columns(course, np.array([period]))[:, 1, 0]
    np.testing.assert_allclose(seen[off_steps], np.array(expected)[off_steps], atol=1e-4)


def test_a_measured_feed_that_is_a_stair_shows_its_period_and_when_each_began():
    """A record begins in the middle of a period: no multiples of any from its start."""
    time, band, one = np.arange(200) / 500.0, (0.0, 200.0), np.ones((200, 3))
    commanded = np.random.default_rng(0).normal(0.0, 0.1, 40)

    def course(first_s: float) -> Course:
        feed = commanded[np.floor((time + first_s + 1e-9) / 0.02).astype(int)]
        return Course(time, 0.01 * time, feed, one, one, one, 500.0, band, pitch_s=1e-9)

    (stair,) = (each for each in KINDS if each.name == "command_stair")
    courses = [course(0.01), course(0.004)]
    np.testing.assert_allclose(stair.grid(courses), [[0.02]], rtol=1e-6)
    for each in courses:
        # taken anew between two samples, it is there at the second
        np.testing.assert_allclose(stair.columns(each, np.array([0.02]))[:, 1, 0], each.feed_share, atol=1e-6)
    wavy = [replace(each, feed_share=each.feed_share + 0.03 * np.sin(1e4 * time)) for each in courses]
    assert len(stair.grid(wavy)) > 1
    # what the sensor of the feed adds hides no step of many times its size
    noise = 0.003 * np.random.default_rng(2).normal(size=len(time))
    noisy = [replace(each, feed_share=each.feed_share + noise) for each in courses]
    np.testing.assert_allclose(stair.grid(noisy), [[0.02]], rtol=1e-6)


@pytest.mark.parametrize("scatter", [1.0, 35.0])
def test_a_share_is_known_no_better_than_the_force_that_it_is_of(scatter):
    """Where the fits of the folds do not agree on that: the share's interval is wider, the place's is not,
    and that something varies is as sure as ever."""
    trials, before = _trials(lambda s, i: 0.3 * np.cos(2 * np.pi * s / 6e-3 + 0.5))
    sure = np.ones((TRIALS, 3))
    unsure = sure + scatter * np.array([-0.01, 0.004, 0.0, 0.012, -0.003, -0.003])[:, None]

    def parameters(chip_by_fold):
        seen = [replace(each, chip_by_fold=chip_by_fold, edge_by_fold=sure) for each in trials]
        return search_slow(seen, before, np.full(3, 1.0 / NOISE_N))[0].accepted.decision.parameters

    narrow, wide = parameters(sure), parameters(unsure)
    share = 1.0 / unsure[:, 0]
    jackknife = np.sqrt((TRIALS - 1) / TRIALS * np.sum((share - share.mean()) ** 2))
    more = stats.t.ppf(0.975, TRIALS - 1) * jackknife
    low, high = wide["amplitude"].low, wide["amplitude"].high
    assert wide["wavelength_m"] == narrow["wavelength_m"]
    if scatter == 1.0:
        same = 0.5 * (narrow["amplitude"].high - narrow["amplitude"].low)
        assert 0.5 * (high - low) == pytest.approx(same + 0.3 * more, rel=1e-3)
    else:
        assert more > 1.2
        assert 0.0 < low < 0.5 * 0.3 and high > 2.0 * 0.3


def test_a_periodic_sheet_need_not_be_a_sine():
    """Its second harmonic is told beside the first."""
    wave = 2.0 * np.pi / 0.0062

    def gain(place, trial):
        return 0.3 * np.cos(wave * place) + 0.1 * np.cos(2.0 * wave * place + 0.5)

    named, _ = _named(gain, edge_share=1.0)
    assert [each.kind.name for each in named] == ["material_periodicity"] * 2
    lengths, sizes = (
        [float(each.effect.values()[name]) for each in named] for name in ("wavelength_m", "amplitude")
    )
    np.testing.assert_allclose(lengths, [0.0062, 0.0031], rtol=2e-3)
    np.testing.assert_allclose(sizes, [0.3, 0.1], rtol=0.05)


def test_layers_whose_borders_blend_are_no_periodic_sheet():
    """Harder and softer by turns, each over 1.5 mm: a wave comes near, but not to what force free in position
    explains."""
    places = [0.0101, 0.0116, 0.0181, 0.0196, 0.0261, 0.0276]
    named, _ = _named(
        lambda place, trial: np.interp(place, places, [0.0, 0.5, 0.5, -0.3, -0.3, 0.3]), edge_share=1.0
    )
    layers = [each.effect.values() for each in named]
    assert {each.kind.name for each in named} == {"layered_material"}
    for each in layers:
        assert float(each["border_m"]) == pytest.approx(1.5e-3, rel=0.1)
    borders = np.array([at for each in layers for at in _ends(each)])
    for true in (0.01085, 0.01885, 0.02685):
        assert np.abs(borders - true).min() < 1e-4


@pytest.mark.parametrize(("times", "named"), [(100.0, True), (400.0, False)])
def test_a_wave_that_does_next_to_nothing_of_what_layers_do_is_what_their_borders_leave(times, named):
    trials, before = _trials(lambda place, trial: 0.05 * np.sin(2.0 * np.pi * place / 0.007), edge_share=1.0)
    weight, periodic = np.full(3, 1.0 / NOISE_N), KINDS[0]
    alone = try_one(periodic, trials, before, Asked(weight, 0.0, 1, 0.003, True))
    assert alone.decision.accepted and periodic.name == "material_periodicity"
    layers = times * fall_of_error(before, alone.heldout, weight)
    beside = try_one(periodic, trials, before, Asked(weight, 0.0, 1, 0.003, True, layers))
    assert beside.decision.accepted == named
    assert named or "of what layers do" in beside.decision.reasons[0]


def _ends(layer):
    return float(layer["start_m"]), float(layer["start_m"]) + float(layer["length_m"])


def test_layers_beside_each_other_are_all_found():
    def gain(place, trial):
        return np.where(place < 0.012, 0.0, np.where(place < 0.02, -0.3, 0.25 * (place < 0.026)))

    named, _ = _named(gain)
    layers = [each.effect.values() for each in named]
    assert [each.kind.name for each in named] == ["layered_material"] * 2
    found = sorted(
        (float(each["start_m"]), float(each["length_m"]), float(each["change"])) for each in layers
    )
    np.testing.assert_allclose(found[0][:2], [0.012, 0.008], atol=3e-4)
    np.testing.assert_allclose(found[1][0], 0.02, atol=3e-4)
    # fitted at once, they share out what each trial's own mean has taken of them
    assert found[0][2] < -0.15 and found[0][2] / found[1][2] == pytest.approx(-0.3 / 0.25, rel=0.03)


def test_three_levels_between_blended_borders_are_three_layers():
    """Two layers that overlap have two levels for three stretches of the path."""
    places = [0.0115, 0.0125, 0.0195, 0.0205, 0.0275, 0.0285]
    levels = np.array([0.0, -0.24, -0.24, -0.12, -0.12, 0.18])
    named, rounds = _named(lambda place, trial: np.interp(place, places, levels), edge_share=1.0)
    assert {each.kind.name for each in named} == {"layered_material"}
    borders = np.array([at for each in named for at in _ends(each.effect.values())])
    for true in (0.012, 0.02, 0.028):
        assert np.abs(borders - true).min() < 2e-4
    assert named[-1].heldout.nrmse < 0.2 * rounds[0].before.nrmse


def test_a_second_layer_is_held_to_chance_as_the_one_kind_that_was_tried_beside_the_first():
    """The first alone leaves so much that it passes with the second only, which four of six cuts reach, all
    of which sway by more than it."""

    def gain(place, trial):
        layers = np.where((place > 0.01) & (place < 0.016), -0.27, 0.0)
        layers += np.where((place > 0.042) & (place < 0.056), -0.2, 0.0)
        sway = np.sin(0.02 * np.arange(len(place)) * (1.0 + 0.37 * trial) + 2.1 * trial)
        return layers + 0.3 * sway

    named, _ = _named(gain, edge_share=1.0)
    assert [each.kind.name for each in named] == ["layered_material"] * 2
    (first, middle), (second, last) = sorted(_ends(each.effect.values()) for each in named)
    np.testing.assert_allclose([first, middle, second], [0.01, 0.016, 0.042], atol=3e-4)
    assert last > 0.055
