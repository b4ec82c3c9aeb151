"""The blind-trial simulator: closed forms it must meet, and the signature each effect must leave."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import study
from benchmarks.study import chatter, milling
from benchmarks.study.fewer import FEWER


def reference_cut(kind="slot", **changes):
    """Four teeth, 2 mm wide, .05 mm a tooth: effects.md C1."""
    fields = {
        "teeth": 4, "radius_m": 0.008, "helix_rad": 0.0, "milling": kind, "depth_m": 0.008, "width_m": 0.002,
        "speed_rev_s": 50.0, "feed_m_s": 0.01, "phase_rad": 0.3,
        "chip_n_m2": np.array([796e6, 168.8e6, 0.0]), "edge_n_m": np.array([27.7e3, 30.8e3, 0.0]),
    }  # fmt: skip
    return milling.Milling(**{**fields, **changes})


def line(force, turns, samples, order):
    """Amplitude of a line of the spindle's order, of a record over whole turns."""
    angle = 2.0 * np.pi * turns * np.arange(samples) / samples
    return 2.0 * abs(np.mean(force * np.exp(-1j * order * angle)))


def record(cut, turns=20, rate=40_000.0):
    """The force over whole turns, [T, 3]."""
    samples = round(turns / cut.speed_rev_s * rate)
    return milling.grid_force(cut, 0.0, samples + 400, rate)[200:-200], turns, samples


@pytest.mark.parametrize(
    ("kind", "expected"),
    [("slot", (-95.3116, 150.1375)), ("conventional", (-108.2620, 30.4799)), ("climb", (12.9504, 119.6576))],
)
def test_mean_force_meets_the_closed_form(kind, expected):
    cut = reference_cut(kind)
    force, torque = milling.mean_load(cut)
    np.testing.assert_allclose(force[:2], expected, rtol=1e-3)
    in_time, _, samples = record(cut)
    np.testing.assert_allclose(in_time[:samples, :2].mean(0), expected, rtol=1e-3)
    tangential = {"slot": 212.1499, "conventional": 106.0749, "climb": 106.0749}[kind]
    assert torque == pytest.approx(0.008 * tangential, rel=1e-3)


def test_an_even_cutter_leaves_no_line_at_the_spindle():
    force, turns, samples = record(reference_cut())
    tooth = line(force[:samples, 1], turns, samples, 4)
    for order in (1, 2, 3):
        assert line(force[:samples, 1], turns, samples, order) < 2e-5 * tooth


def test_runout_is_flat_in_feed_and_pitch_rises_with_it():
    at = {}
    pitch = {"pitch_error_rad": np.array([0.03, -0.01, -0.04, 0.02])}
    runout = {"offset_m": 5e-6, "angle_rad": 0.4}
    for name, hidden in (("radial_runout", runout), ("unequal_pitch", pitch)):
        for feed in (0.016, 0.048):
            cut = reference_cut(feed_m_s=feed, effects={name: hidden})
            force, turns, samples = record(cut)
            at[name, feed] = line(force[:samples, 0], turns, samples, 1)
    assert at["radial_runout", 0.048] == pytest.approx(at["radial_runout", 0.016], rel=0.2)
    assert at["unequal_pitch", 0.048] > 1.5 * at["unequal_pitch", 0.016]


def test_runout_keeps_the_mean_chip_and_loses_contact():
    hidden = {"radial_runout": {"offset_m": 6e-5, "angle_rad": 0.4}}
    sharp = {"edge_n_m": np.zeros(3)}
    even, _ = milling.mean_load(reference_cut(**sharp))
    uneven, _ = milling.mean_load(reference_cut(effects=hidden, **sharp))
    np.testing.assert_allclose(uneven[:2], even[:2], rtol=3e-3)
    rubbed, _ = milling.mean_load(reference_cut(effects=hidden))
    assert abs(rubbed[1]) < 0.9 * abs(milling.mean_load(reference_cut())[0][1])


def test_droop_slows_by_load_and_compliance_gives_way():
    loaded = milling.settle(reference_cut(effects={"spindle_droop": {"droop_rev_s_nm": 1.0}}))
    assert loaded.speed_rev_s == pytest.approx(50.0 - milling.mean_load(loaded)[1], abs=1e-6)
    pushed = reference_cut(
        "conventional", depth_m=0.003, effects={"static_compliance": {"compliance_m_n": 1e-5}}
    )
    given = milling.settle(pushed)
    assert given.depth_m == pytest.approx(0.003 + 1e-5 * milling.mean_load(given)[0][1], abs=1e-8)
    assert given.depth_m < 0.003


def test_helix_keeps_the_slot_mean_and_takes_the_tooth_line():
    cut = reference_cut()
    force, turns, samples = record(cut, rate=80_000.0)
    window = 0.6 / (2.0 * np.pi * cut.speed_rev_s)
    slanted = milling.smear(force, window, 80_000.0)
    first = round(window * 80_000.0) + 1
    cut_off = slanted[first : first + samples - samples // turns]
    before = force[first : first + samples - samples // turns]
    turns -= 1
    np.testing.assert_allclose(cut_off.mean(0)[:2], before.mean(0)[:2], rtol=1e-4)
    ratio = line(cut_off[:, 1], turns, len(cut_off), 4) / line(before[:, 1], turns, len(before), 4)
    assert ratio == pytest.approx(np.sinc(4 * 0.6 / (2.0 * np.pi)), rel=1e-3)


def test_stability_limits_of_a_flexible_tool():
    """C5: one mode of 922 Hz, two teeth, 5,000 rpm: the limit depth is .40863 mm."""
    give = 1.0 / (0.03993 * (2.0 * np.pi * 922.0) ** 2)
    mode = {"compliance_m_n": [give, 0.0], "frequency_hz": [922.0, 922.0], "damping": [0.011, 0.011]}

    def swing(depth_m: float) -> float:
        cut = reference_cut(
            teeth=2, width_m=depth_m, speed_rev_s=5000.0 / 60.0, feed_m_s=0.0167,
            chip_n_m2=np.array([6e8, 2e8, 0.0]), edge_n_m=np.zeros(3), effects={"regenerative_chatter": mode},
        )  # fmt: skip
        _, force = chatter.forces([cut], 0.0, 0.5, 100)[0]
        turns = force[: len(force) // 200 * 200].reshape(-1, 200, 3)
        change = np.abs(np.diff(turns, axis=0)).max((1, 2))
        return change[-1] / change[8]

    assert swing(0.94 * 0.40863e-3) < 0.8
    assert swing(1.06 * 0.40863e-3) > 1.5


def test_no_vibration_is_larger_than_a_tooth_is_high():
    """Far beyond the stability limit loss of contact alone lets the force grow without bound."""
    mode = {"compliance_m_n": [1.4e-7, 8.7e-8], "frequency_hz": [490.0, 466.0], "damping": [0.032, 0.027]}
    cut = reference_cut(
        teeth=4, width_m=0.003, speed_rev_s=52.0, feed_m_s=0.0167,
        chip_n_m2=np.array([1.3e9, 2.5e8, 0.0]), edge_n_m=np.zeros(3), effects={"regenerative_chatter": mode},
    )  # fmt: skip
    _, force = chatter.forces([cut], 0.0, 0.5, 60)[0]
    thickest = 0.25 * 2.0 * np.pi * cut.radius_m / cut.teeth
    largest = np.abs(force).max()
    assert 100.0 < largest < 2 * 1.6e9 * cut.width_m * thickest


@pytest.mark.parametrize("design", ["mill", "saw", "drill", "turning"])
def test_a_seed_gives_the_same_session_and_effects_change_nothing_else(design):
    first, again = study.make(design, {}, 4), study.make(design, {}, 4)
    with_drift = study.make(design, {"mains_pickup": "weak"}, 4)
    for a, b, c in zip(first.dataset.trials, again.dataset.trials, with_drift.dataset.trials, strict=True):
        np.testing.assert_array_equal(a.signals, b.signals)
        assert a.spindle_speed_rev_s == c.spindle_speed_rev_s and not np.array_equal(a.signals, c.signals)
    difference = np.concatenate(
        [c.signals - a.signals for a, c in zip(first.dataset.trials, with_drift.dataset.trials, strict=True)]
    )
    assert np.abs(difference).max() <= 1.02 * np.max(
        with_drift.truth["effects"]["mains_pickup"]["amplitude_n"]
    )
    assert study.make(design, {}, 5).truth["material"] != first.truth["material"]
    assert all(np.isfinite(trial.signals).all() for trial in first.dataset.trials)


def test_the_declared_filter_and_noise_are_in_the_record():
    case = study.make("saw", {}, 2)
    rate = case.dataset.sensor.sample_rate_hz
    for trial in case.dataset.trials[:2]:
        spectrum = np.abs(
            np.fft.rfft((trial.force_n[:, 2] - trial.force_n[:, 2].mean()) * np.hanning(trial.samples))
        )
        quiet = np.median(spectrum) / np.sqrt(np.log(2) * trial.samples * 0.375)
        assert quiet == pytest.approx(0.2, rel=0.1)
    assert case.dataset.sensor.anti_alias.hz < rate / 2


def test_wear_goes_with_length_and_drift_with_the_clock():
    even = study.make("saw", {}, 7)
    worn = study.make("saw", {"flank_wear": "strong"}, 7)
    grown = [
        np.linalg.norm((b.force_n - a.force_n).mean(0)) / (a.axial_width_m * np.sqrt(a.radial_depth_m))
        for a, b in zip(even.dataset.trials, worn.dataset.trials, strict=True)
        if a.kind == "cut"
    ]
    length = [t.cut_length_before_m for t in worn.dataset.trials if t.kind == "cut"]
    assert np.corrcoef(length, grown)[0, 1] > 0.97
    drifting = study.make("saw", {"thermal_drift": "strong"}, 7)
    drift = drifting.truth["effects"]["thermal_drift"]
    air = [t for t in drifting.dataset.trials if t.kind == "air"]
    for trial in air:
        bias = drifting.truth["trials"][trial.file]["bias_n"]
        warm = -np.expm1(-(trial.clock_start_s + 4.0) / drift["tau_s"])
        np.testing.assert_allclose(trial.force_n.mean(0) - bias, warm * drift["drift_n"], atol=0.02)


def test_bad_input_is_said():
    with pytest.raises(ValueError, match="expected one of"):
        study.make("lathe", {}, 0)
    with pytest.raises(ValueError, match="correct the name"):
        study.make("saw", {"gremlins": "weak"}, 0)
    with pytest.raises(ValueError, match="choose one"):
        study.make("drill", {"radial_runout": "weak"}, 0)
    with pytest.raises(ValueError, match="strength"):
        study.make("saw", {"radial_runout": "huge"}, 0)


def test_a_session_cut_down_keeps_what_its_word_says():
    whole = study.make("saw", {}, seed=401).dataset
    speeds = {
        word: [each.spindle_speed_rev_s for each in made(whole).trials if each.kind == "cut"]
        for word, made in FEWER.items()
    }
    assert len(set(speeds["all"])) == 3 and len(set(speeds["one_speed"])) == 1 < len(speeds["one_speed"])
    assert len(speeds["five"]) == 5
    bare = FEWER["unstated"](whole)
    assert bare.sensor.noise_std_n is None and speeds["unstated"] == speeds["all"]
    assert {(each.kind, each.clock_start_s, each.cut_length_before_m) for each in bare.trials} == {
        ("cut", 0.0, 0.0)
    }


def test_a_session_scattered_has_cuts_larger_or_smaller_as_a_whole():
    whole = study.make("drill", {}, seed=401).dataset
    made = FEWER["scattered"](whole)
    pairs = [(a, b) for a, b in zip(made.trials, whole.trials, strict=True) if a.kind == "cut"]
    factors = np.array([np.median(a.force_n[:, 2] / b.force_n[:, 2]) for a, b in pairs])
    assert 0.006 < np.std(factors) < 0.02
    for (a, b), factor in zip(pairs, factors, strict=True):
        np.testing.assert_allclose(a.force_n, factor * b.force_n)
        np.testing.assert_allclose(a.torque_nm, factor * b.torque_nm)


@pytest.mark.parametrize("seed", [401, 402])
def test_a_session_in_two_materials_has_every_other_cut_softer_about_its_zero(seed):
    whole = study.make("saw", {}, seed=seed).dataset
    made = FEWER["materials"](whole)
    air = [each.force_n.mean(axis=0) for each in whole.trials if each.kind == "air"]
    zero = np.mean(air, axis=0) if air and whole.sensor.zeroed == "session" else np.zeros(3)
    pairs = [(a, b) for a, b in zip(made.trials, whole.trials, strict=True) if a.kind == "cut"]
    assert [a.material for a, _ in pairs[:3]] == ["harder", "softer", "harder"]
    for (a, b), factor in zip(pairs, [1.0, 0.4] * len(pairs), strict=False):
        np.testing.assert_allclose(a.force_n - zero, factor * (b.force_n - zero))
    assert made.sensor.zeroed == ("session" if np.any(zero) else "trial")


def test_what_a_stuck_chip_lets_one_tooth_take_more_the_next_one_lacks():
    def taken(stuck):
        cut = reference_cut(edge_n_m=np.zeros(3), stuck=stuck)
        return milling.passes(cut, 0.0, 0.1, 256)[2].sum(axis=1)

    more = taken(lambda number: np.where(number == 9, 2e-5, 0.0)) - taken(None)
    (deep,) = np.flatnonzero(more > 1e-9)
    assert more[deep] == pytest.approx(-more[deep + 1 :].sum(), rel=1e-2)
    assert more[deep + 1] < -0.8 * more[deep]
    assert np.abs(more[:deep]).max() < 1e-9 * more[deep]


@pytest.mark.parametrize("design", ["mill", "saw"])
def test_chips_stick_and_let_go_at_random_times(design):
    plain = study.make(design, {}, 7).dataset
    stuck = study.make(design, {"sticking_chip": "strong"}, 7).dataset
    shares = []
    for a, b in zip(plain.trials, stuck.trials, strict=True):
        if a.kind == "cut":
            more = np.abs(b.force_n - a.force_n)[:, 1]
            turns = round(float(np.ptp(a.time_s)) * a.spindle_speed_rev_s)
            most = np.array([each.max() for each in np.array_split(more, turns)])
            shares.append(np.mean(most > 0.3 * most.max()))
    assert 0.2 < np.mean(shares) < 0.8
    assert np.ptp(shares) > 0.1


def test_a_worn_gear_leaves_lines_at_one_part_of_the_spindle_at_every_speed():
    plain, worn = (study.make("mill", hidden, 7) for hidden in ({}, {"worn_gear": "strong"}))
    beside, speeds = [], []
    orders = np.arange(3.5, 4.5, 0.005)
    off = np.abs(orders - 4.0) > 0.1
    for a, b in zip(plain.dataset.trials, worn.dataset.trials, strict=True):
        if a.kind == "cut":
            speeds.append(plain.truth["trials"][a.file]["speed_rev_s"])
            more = (b.force_n - a.force_n)[:, 0] * np.hanning(len(a.time_s))
            turned = np.multiply.outer(orders[off], speeds[-1] * a.time_s)
            size = np.abs(np.exp(-2j * np.pi * turned) @ more)
            beside.append(abs(orders[off][np.argmax(size)] - 4.0))
    assert np.ptp(speeds) > 0.2 * np.mean(speeds)
    assert 0.2 < np.mean(beside) < 0.45
    assert np.ptp(beside) < 0.03
