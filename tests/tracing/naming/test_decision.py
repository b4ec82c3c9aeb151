"""The four tests an effect must pass before it is named."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mjx_cutting.cutting.effects import (
    ClampMode,
    CommandStair,
    Ploughing,
    RadialRunout,
    RobotMode,
    SensorLowpass,
    SensorResonance,
    SizeEffect,
    StaticCompliance,
    TorqueRipple,
    UnequalPitch,
)
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.naming.chance import CHANCE, chance, chance_over_trials, gain_over_trials
from mjx_cutting.tracing.naming.decision import decide
from mjx_cutting.tracing.naming.intervals import Interval, interval


def _heldout(error: list[float]) -> HeldOut:
    share = np.asarray(error)[:, None] * np.ones(3) / 3.0
    return HeldOut(share, np.full((len(error), 3), 1.0 / 3.0), None, np.arange(len(error)))


BEFORE = _heldout([0.10, 0.11, 0.09, 0.10, 0.10])
BETTER = _heldout([0.01, 0.012, 0.009, 0.011, 0.01])
DAMPED, UNDAMPED = Interval(0.1, 0.09, 0.11, "1"), Interval(0.005, 0.004, 0.006, "1")
RUNOUT = {"offset_m": Interval(1e-5, 0.8e-5, 1.2e-5, "m"), "angle_rad": Interval(0.3, 0.2, 0.4, "rad")}


def test_a_clear_gain_is_accepted():
    found = decide(RadialRunout, BEFORE, BETTER, 1e-9, RUNOUT)
    assert found.accepted
    assert found.reasons == ()
    assert found.gain == pytest.approx(np.sqrt(0.1) - np.sqrt(0.0104), abs=1e-12)


def test_what_chance_gives_is_refused():
    assert "chance" in decide(RadialRunout, BEFORE, BETTER, 0.02, RUNOUT).reasons[0]


def test_a_gain_too_small_is_refused():
    hardly = _heldout([0.098, 0.108, 0.089, 0.098, 0.099])
    assert "held-out" in decide(RadialRunout, BEFORE, hardly, 1e-9, RUNOUT).reasons[0]


def test_what_is_below_a_models_own_error_is_refused():
    tiny = [_heldout([4e-6] * 5), _heldout([3e-6] * 5)]
    assert "accounts for" in decide(RadialRunout, *tiny, 1e-9, RUNOUT).reasons[0]


def test_a_gain_on_one_trial_only_is_refused():
    lucky = _heldout([0.01, 0.112, 0.091, 0.101, 0.101])
    found = decide(RadialRunout, BEFORE, lucky, 1e-9, RUNOUT)
    assert "within 2 standard errors" in found.reasons[0] and found.scattered
    nothing = dict(RUNOUT, offset_m=Interval(1e-5, -0.1e-5, 2.1e-5, "m"))
    assert not decide(RadialRunout, BEFORE, lucky, 1e-9, nothing).scattered


def test_of_three_trials_a_gain_of_three_standard_errors_is_not_enough():
    """A t of two degrees of freedom asks 4.3; of five trials two standard errors are."""
    gains = [0.05, 0.02, 0.08]
    few, many = ([_heldout([0.1] * n), _heldout([0.1 - g for g in (gains * 2)[:n]])] for n in (3, 5))
    found = decide(RadialRunout, *few, 1e-9, RUNOUT)
    assert 2.0 * found.gain_standard_error < found.gain < 4.3 * found.gain_standard_error
    assert "4.3 standard errors" in found.reasons[0] and found.scattered
    assert decide(RadialRunout, *many, 1e-9, RUNOUT).accepted


def test_a_gain_in_every_trial_counts_though_one_holds_most_of_the_error():
    # as of a drift that one cold trial shows most
    before, after = _heldout([2.0, 0.02, 0.03, 0.02, 0.04]), _heldout([0.9, 0.01, 0.01, 0.01, 0.02])
    gain, error = gain_over_trials(before, after)
    assert gain < 2.0 * error
    assert decide(RadialRunout, before, after, 1e-9, RUNOUT).accepted
    uneven = _heldout([0.9, 0.018, 0.01, 0.02, 0.02])
    assert not decide(RadialRunout, before, uneven, 1e-9, RUNOUT).accepted


def test_an_interval_that_includes_nothing_is_refused():
    unsure = dict(RUNOUT, offset_m=Interval(1e-5, -0.1e-5, 2.1e-5, "m"))
    assert "no effect" in decide(RadialRunout, BEFORE, BETTER, 1e-9, unsure).reasons[0]


@pytest.mark.parametrize(("low", "named"), [(30.0, True), (17.0, False)])
def test_a_resonance_that_is_not_known_to_an_octave_is_none(low, named):
    mode = {
        "mass_ratio": Interval(0.15, 0.1, 0.2, "1"),
        "frequency_hz": Interval(34.0, low, 39.0, "Hz"),
        "damping": Interval(0.2, 0.03, 0.29, "1"),
        "direction_rad": Interval(0.0, -0.2, 0.2, "rad"),
    }
    found = decide(RobotMode, BEFORE, BETTER, 1e-9, mode)
    assert found.accepted == named
    assert named or "not known to a factor of 2" in found.reasons[0]
    # it explains as much as one that is known: which of them it is, is open
    assert found.untold == (not named)


@pytest.mark.parametrize(("strength", "untold"), [(0.2, True), (0.0, False)])
def test_what_lacks_only_its_own_mark_is_known_to_be_untold_from_another(strength, untold):
    mode = {
        "mass_ratio": Interval(strength, strength - 0.1, strength + 0.1, "1"),
        "frequency_hz": Interval(90.0, 85.0, 95.0, "Hz"),
        "gradient_1_m": Interval(3.0, -1.0, 7.0, "1/m"),
        "damping": Interval(0.03, 0.02, 0.04, "1"),
        "curvature_1_m2": Interval(20.0, -50.0, 90.0, "1/m^2"),
    }
    found = decide(ClampMode, BEFORE, BETTER, 1e-9, mode)
    assert not found.accepted and found.untold == untold
    assert not decide(ClampMode, BEFORE, BETTER, 0.5, mode).untold
    moves = {
        "gradient_1_m": Interval(3.0, 2.0, 4.0, "1/m"),
        "curvature_1_m2": Interval(40.0, 20.0, 60.0, "1/m^2"),
    }
    for name, sure in moves.items():
        told = decide(ClampMode, BEFORE, BETTER, 1e-9, mode | {name: sure})
        assert told.accepted == (strength > 0.1) and told.untold is False


@pytest.mark.parametrize(
    ("kind", "parameters"),
    [
        (SensorResonance, {"frequency_hz": Interval(6000.0, 5970, 6030, "Hz"), "damping": DAMPED}),
        (SensorResonance, {"frequency_hz": Interval(400.0, 390, 410, "Hz"), "damping": UNDAMPED}),
        (SizeEffect, {"exponent": Interval(0.599, 0.55, 0.62, "1")}),
        (SizeEffect, {"exponent": Interval(-0.2, -0.25, -0.15, "1")}),
        (StaticCompliance, {"compliance_m_n": Interval(-1.1e-5, -1.6e-5, -0.7e-5, "m/N")}),
    ],
)  # fmt: skip
def test_the_edge_of_the_physical_range_is_refused(kind, parameters):
    assert "physical range" in decide(kind, BEFORE, BETTER, 1e-9, parameters).reasons[0]
    provisional = decide(kind, BEFORE, BETTER, 1e-9, parameters, in_range=False)
    assert provisional.accepted and not provisional.physical


def test_chance_counts_the_tries_and_believes_no_model_below_its_tolerance():
    one = chance(drop=30.0, added=1, spread=1.0, floor=0.0, freedom=200, tries=1)
    assert chance(drop=30.0, added=1, spread=1.0, floor=0.0, freedom=200, tries=31) == pytest.approx(31 * one)
    assert chance(drop=30.0, added=1, spread=1.0, floor=5.0, freedom=200, tries=31) == 1.0
    assert chance(drop=-1.0, added=1, spread=1.0, floor=0.0, freedom=200, tries=1) == 1.0


def test_interval_is_a_jackknife_over_folds():
    whole, folds = 10.0, np.array([9.0, 10.0, 11.0, 10.0])
    found = interval(SizeEffect, "exponent", whole, folds)
    error = np.sqrt(3 / 4 * np.sum((folds - folds.mean()) ** 2))
    assert found.high - found.value == pytest.approx(3.182446 * error, rel=1e-5)
    assert interval(SizeEffect, "exponent", whole, folds, laplace=9.0).high > 30.0
    wider = interval(SizeEffect, "exponent", whole, folds, model_error=0.5)
    assert wider.high == pytest.approx(found.high + 0.5) and wider.low == pytest.approx(found.low - 0.5)


def test_the_models_error_widens_what_the_trials_prove_without_undoing_it():
    sure, unsure = np.array([0.09, 0.10, 0.11, 0.10]), np.array([0.0, 0.1, 0.2, 0.1])
    found = interval(SizeEffect, "exponent", 0.1, sure, model_error=0.2)
    assert 0.0 < found.low < 0.02 and found.high > 0.3
    for values, error in ((unsure, 0.2), (sure, 0.5)):
        assert interval(SizeEffect, "exponent", 0.1, values, model_error=error).low < 0.0


def test_a_trade_off_with_the_shape_does_not_undo_an_effect_that_is_there():
    sure = np.array([1.4e-6, 1.5e-6, 1.6e-6, 1.5e-6])
    apart = interval(
        Ploughing, "minimum_chip_m", 1.5e-6, sure, model_error=9e-6, scale=np.array([[1 / 9e-7]])
    )
    assert 0.0 < apart.low < 1e-7 and apart.high == Ploughing.parameters["minimum_chip_m"].high
    assert interval(Ploughing, "minimum_chip_m", 1.5e-6, sure, model_error=9e-6).low < 0.0


def test_a_ratio_is_told_on_the_scale_it_is_fitted_on():
    found = interval(Ploughing, "ratio", 3.0, np.array([2.9, 3.0, 3.1, 3.0]), model_error=6.0)
    assert found.low == Ploughing.parameters["ratio"].low
    assert 9.0 < found.high <= Ploughing.parameters["ratio"].high


def test_an_angle_that_no_trial_moves_is_unknown():
    found = interval(RadialRunout, "angle_rad", 0.0, np.zeros(4))
    assert (found.low, found.high) == pytest.approx((-np.pi, np.pi))
    anywhere = interval(RadialRunout, "angle_rad", 0.4, np.array([0.2, 0.5, -0.1, 0.9]), laplace=50.0)
    assert (anywhere.value, anywhere.low, anywhere.high) == pytest.approx((0.4, -np.pi, np.pi))
    chosen = interval(CommandStair, "period_s", 0.02, np.full(4, 0.02), on_grid=True)
    assert (chosen.value, chosen.low, chosen.high) == (0.02, 0.02, 0.02)


def test_of_several_values_the_surest_speaks_and_all_are_told():
    whole, folds = np.array([1.0, -5.0]), np.array([[1.0, -5.1], [1.1, -4.9], [0.9, -5.0]])
    found = interval(UnequalPitch, "pitch_error_rad", whole, folds)
    assert found.value == -5.0 and found.values == (1.0, -5.0)
    assert found.high - found.value == pytest.approx(found.half[1])


def _leave_one_out(parts):
    """Mean of F parts and the F means without each."""
    return parts.mean(axis=0), (parts.sum(axis=0) - parts) / (len(parts) - 1)


def test_of_many_teeth_none_of_which_stands_out_the_pattern_speaks():
    true = np.where(np.arange(80) % 2, 1e-3, -1e-3)
    whole, folds = _leave_one_out(true + 5e-4 * np.random.default_rng(0).standard_normal((5, 80)))
    found = interval(
        UnequalPitch, "pitch_error_rad", whole, folds, model_error=2e-3, scale=np.eye(80) / 1.5e-3
    )
    assert found.low * found.high > 0.0
    # an error of the model that could make the whole pattern undoes it
    undone = interval(
        UnequalPitch, "pitch_error_rad", whole, folds, model_error=2e-3, scale=np.eye(80) / 4e-2
    )
    assert undone.low < 0.0 < undone.high


def test_the_best_of_many_teeth_is_no_finding():
    rng, named = np.random.default_rng(1), 0
    for _ in range(200):
        whole, folds = _leave_one_out(1e-3 * rng.standard_normal((5, 80)))
        found = interval(
            UnequalPitch, "pitch_error_rad", whole, folds, model_error=1e-2, scale=np.eye(80) / 1e-9
        )
        named += bool(found.low * found.high > 0.0)
    assert named <= 20  # one in twenty is asked


def test_a_value_that_no_trial_moves_does_not_speak_for_the_others():
    whole, folds = np.array([9.0, 2.0]), np.array([[9.0, 1.9], [9.0 + 1e-9, 2.1], [9.0, 2.0]])
    assert interval(UnequalPitch, "pitch_error_rad", whole, folds).value == 2.0


def test_an_angle_does_not_jump_at_a_half_turn():
    found = interval(RadialRunout, "angle_rad", 3.1, np.array([3.1, -3.1, 3.12, 3.08]))
    assert found.high - found.low < 1.0


def test_gain_of_two_trials_has_no_standard_error():
    pair = [
        dataclasses.replace(each, error_n2=each.error_n2[:2], energy_n2=each.energy_n2[:2])
        for each in (BEFORE, BETTER)
    ]
    gain, error = gain_over_trials(*pair)
    assert gain > 0 and np.isnan(error)


def test_what_every_one_of_many_trials_gains_is_no_chance_however_unlike_the_gains_are():
    """Wear beside runout shows where the feed is low: nine tenths of the error there, less elsewhere."""
    share = np.array([0.94, 0.02, 0.10, 0.13, 0.02, 0.23, 0.01, 0.14, 0.03, 0.81, 0.04, 0.88])
    left = np.full(len(share), 0.01)
    after = left * (1.0 - share) / (1.0 + share)
    assert chance_over_trials(_heldout(left.tolist()), _heldout(after.tolist()), 6) < CHANCE
    share[1::3] *= -1.0
    after = left * (1.0 - share) / (1.0 + share)
    assert chance_over_trials(_heldout(left.tolist()), _heldout(after.tolist()), 6) > CHANCE


def test_what_shows_in_every_trial_is_no_chance_though_one_trial_holds_most_of_the_force():
    force = np.array([0.001, 0.003, 0.01, 0.02, 0.05, 0.2, 0.716])
    before = _heldout((0.2 * force).tolist())
    assert chance_over_trials(before, _heldout((0.01 * force).tolist()), 6) < 1e-6
    lucky = 0.2 * force * np.array([1.1, 0.95, 1.02, 1.05, 0.99, 1.03, 0.05])
    assert chance_over_trials(before, _heldout(lucky.tolist()), 6) > CHANCE


@pytest.mark.parametrize(("unlike", "most"), [(0.0, 0.015), (1.0, 0.03)])
def test_the_best_of_several_useless_candidates_is_rarely_thought_no_chance(unlike, most):
    draw, called, times = np.random.default_rng(5), 0, 1000
    for _ in range(times):
        size = np.exp(draw.normal(0.0, unlike, 9))
        before = _heldout(size.tolist())
        tries = [_heldout((size * (1.0 + draw.normal(0.0, 0.05, 9))).tolist()) for _ in range(6)]
        called += min(chance_over_trials(before, each, 6) for each in tries) < CHANCE
    assert called <= most * times


def test_what_goes_with_all_that_is_left_in_every_trial_is_no_chance_though_it_is_large_in_few():
    """A wave of the sheet that noise hides in some of eight trials: it explains itself in each."""
    noise, wave = 1.0, np.array([0.04, 0.15, 0.2, 0.4, 0.8, 1.0, 2.5, 6.0])
    before = _heldout((noise + wave).tolist())
    after = _heldout(np.full(8, noise).tolist())
    assert chance_over_trials(before, after, 4) > CHANCE
    assert chance_over_trials(before, after, 4, wave) < CHANCE


def test_what_does_not_go_with_what_is_left_is_chance():
    """Of a useless one the product with what is left is as often negative."""
    draw, called, times = np.random.default_rng(6), 0, 2000
    for _ in range(times):
        size = np.exp(draw.normal(0.0, 1.0, 8))
        tries = []
        for _ in range(4):
            added = 0.01 * size * np.exp(draw.normal(0.0, 1.0, 8))
            product = draw.normal(0.0, 0.05, 8) * np.sqrt(size * added)
            tries.append((_heldout((size + added - 2.0 * product).tolist()), added))
        before = _heldout(size.tolist())
        called += min(chance_over_trials(before, after, 4, added) for after, added in tries) < CHANCE
    assert called <= 0.015 * times


def _by_axis(error: list[list[float]]) -> HeldOut:
    return HeldOut(np.asarray(error), np.full((len(error), 3), 1.0), None, np.arange(len(error)))


@pytest.mark.parametrize(("x_after", "refused"), [(0.014, True), (0.0105, False)])
def test_an_axis_that_is_predicted_worse_pays_for_what_is_not_there(x_after, refused):
    before = _by_axis([[0.01, 0.01, 0.3]] * 4)
    after = _by_axis([[x_after, 0.01, 0.02]] * 4)
    found = decide(RadialRunout, before, after, 1e-9, RUNOUT)
    assert found.accepted is not refused
    assert any("predicts x worse" in why for why in found.reasons) is refused


def test_a_hum_of_one_energy_is_no_chance_whatever_else_the_trials_leave():
    left = np.array([0.2, 0.02, 0.9, 0.05, 0.4])
    found = chance_over_trials(_heldout(list(left)), _heldout(list(left - 0.005)), tries=4)
    assert found < 1e-6
    scattered = left - 0.005 * np.array([1.0, -2.0, 3.0, -1.0, 4.0])
    assert chance_over_trials(_heldout(list(left)), _heldout(list(scattered)), tries=4) > CHANCE


def test_a_whole_number_that_no_fold_moved_is_known():
    found = interval(TorqueRipple, "order", 7.0, np.full(5, 7.0))
    assert (found.value, found.low, found.high) == (7.0, 7.0, 7.0)
    shape = interval(TorqueRipple, "phase_rad", 0.5, np.full(5, 0.5))
    assert (shape.low, shape.high) == pytest.approx((-np.pi, np.pi))


def test_a_cutoff_that_may_be_far_off_is_told_between_positive_ends():
    """Of one line that is weakened the cutoff is hardly known; that something weakens it is."""
    folds = np.array([90.0, 240.0, 60.0, 110.0, 70.0, 95.0])
    found = interval(SensorLowpass, "cutoff_hz", np.array(108.0), folds)
    assert 5.0 <= found.low < 60.0 and 240.0 < found.high <= 2000.0
    near = interval(SensorLowpass, "cutoff_hz", np.array(108.0), 108.0 + 0.01 * (folds - 108.0))
    assert near.high - 108.0 == pytest.approx(108.0 - near.low)


def test_of_a_mode_that_may_be_anywhere_the_damping_may_run_to_an_edge():
    def decided(low_hz):
        mode = {
            "mass_ratio": Interval(0.15, 0.1, 0.2, "1"),
            "frequency_hz": Interval(80.0, low_hz, 110.0, "Hz"),
            "damping": Interval(0.005, 0.004, 0.006, "1"),
            "direction_rad": Interval(0.0, -0.2, 0.2, "rad"),
        }
        return decide(RobotMode, BEFORE, BETTER, 1e-9, mode)

    anywhere, known = decided(20.0), decided(75.0)
    assert anywhere.untold and not anywhere.accepted
    assert not known.untold and "damping runs to" in known.reasons[0]
