"""What the report's figures are drawn from, the trials it proposes and the caveats it states."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting.tracing.report import advice, wording
from mjx_cutting.tracing.report.figures import revolution, spectrum, subject, telling, trials
from mjx_cutting.tracing.report.parameters import estimates
from mjx_cutting.tracing.told import Tracing

Make = Callable[..., Tracing]
SPEED_REV_S, ONCE_N = 25.0, 40.0


def test_a_line_of_known_amplitude_reads_so_in_spectrum_and_covariate(make_tracing: Make) -> None:
    tracing = make_tracing()
    used = list(subject.subjects(tracing))
    order = spectrum.order_grid(tracing, used)
    left = tracing.before[0].residual_n[:, 0]
    amplitude = spectrum.order_spectrum(left, tracing.before[0].time_s, SPEED_REV_S, order)
    assert order[np.argmax(amplitude)] == pytest.approx(1.0, abs=0.02)
    assert amplitude.max() == pytest.approx(ONCE_N, rel=0.01)
    assert 0.0 < spectrum.between_lines(order, amplitude) < 0.1 * ONCE_N
    found = subject.line_amplitude(used[0].after.angle_rad, used[0].after.measured_n[:, :2], 1)
    assert found == pytest.approx(ONCE_N, rel=0.01)


def test_folding_keeps_what_repeats() -> None:
    angle = np.linspace(0.0, 40.0 * np.pi, 5000)
    degrees, levels = revolution.folded(angle, 3.0 * np.sin(angle))
    assert np.all(np.diff(degrees) > 0) and degrees[0] > 0 and degrees[-1] < 360
    np.testing.assert_allclose(levels[:, 1], 3.0 * np.sin(np.radians(degrees)), atol=0.05)
    few, levels = revolution.folded(np.array([0.1, 0.2, 3.0]), np.array([1.0, 2.0, 5.0]))
    assert len(few) == len(levels) and np.isfinite(levels).all()


def test_a_models_curve_is_drawn_between_its_samples() -> None:
    angle = np.arange(500) * 2.0 * np.pi / 12.7
    degrees, force = revolution.repeated(
        angle, np.stack([2.0 + 3.0 * np.sin(5.0 * angle), angle * 0.0], 1), 5
    )
    np.testing.assert_allclose(force[:, 0], 2.0 + 3.0 * np.sin(5.0 * np.radians(degrees)), atol=1e-9)
    np.testing.assert_allclose(force[:, 1], 0.0, atol=1e-9)


def test_too_few_angles_are_joined_and_not_guessed_between() -> None:
    angle = np.arange(500) * 2.0 * np.pi / 10.0 + 0.1
    degrees, force = revolution.repeated(angle, np.sin(angle)[:, None], 8)
    assert len(degrees) == 10
    np.testing.assert_allclose(force[:, 0], np.sin(0.1 + np.arange(10) * 2.0 * np.pi / 10.0), atol=1e-9)


def test_of_a_model_that_changes_along_the_trial_the_median_turn_is_drawn() -> None:
    """For three fifths of the trial the tool is in the sheet, before that it cuts air."""
    angle = np.linspace(0.0, 80.0 * np.pi, 8000)
    force = np.where(angle > 32.0 * np.pi, 3.0 * np.sin(2.0 * angle), 0.0)[:, None]
    degrees, drawn = revolution.repeated(angle, force, 5)
    wave = 3.0 * np.sin(2.0 * np.radians(degrees))
    assert np.abs(drawn[:, 0]).max() < 3.0 and np.mean(np.abs(drawn[:, 0] - wave)) < 0.3
    np.testing.assert_allclose(drawn[:, 0], revolution.folded(angle, force[:, 0])[1][:, 1])


def test_lowest_middle_and_highest_feed_are_shown(make_tracing: Make) -> None:
    shown = revolution.shown(make_tracing(trials=9))
    assert [each.number for each in shown] == [1, 5, 9]


def test_noise_floors_of_the_trials_make_the_floor_of_all(make_tracing: Make) -> None:
    tracing = make_tracing()
    energy = tracing.lines.energy_n2.sum(axis=1)
    whole = np.sqrt(np.sum(trials.floors(tracing) ** 2 * energy) / energy.sum())
    assert whole == pytest.approx(tracing.verdict["noise_floor_nrmse"], rel=1e-9)


def test_the_covariate_is_the_feed_else_what_differs(make_tracing: Make) -> None:
    tracing = make_tracing()
    chosen = telling.covariate(tracing, subject.subjects(tracing))
    assert chosen is not None and chosen[:2] == ("feed per tooth", "mm")
    np.testing.assert_allclose(chosen[2], np.linspace(0.04, 0.2, 5))
    same = make_tracing(same_feed=True)
    assert telling.covariate(same, subject.subjects(same)) is None
    deeper = [replace(t, radial_depth_m=0.001 * (i + 1)) for i, t in enumerate(same.dataset.trials)]
    same = replace(same, dataset=replace(same.dataset, trials=tuple(deeper)))
    chosen = telling.covariate(same, subject.subjects(same))
    assert chosen is not None and chosen[:2] == ("radial depth", "mm")


def test_parameters_come_with_the_jackknife_of_their_folds(make_tracing: Make) -> None:
    found = {each.label: each for each in estimates(make_tracing())}
    runout = found["radial runout: offset_m"]
    assert runout.strength and runout.base is None and not runout.held
    assert found["radial runout: angle_rad"].held
    shear = found["K_tc"]
    spread = np.sqrt(4 / 5 * np.sum((shear.by_fold - 8e8) ** 2))
    assert shear.high - shear.value == pytest.approx(2.7764451 * spread, rel=1e-6)
    assert shear.base == pytest.approx(8e8)


def test_the_next_trial_answers_what_is_open(make_tracing: Make) -> None:
    ambiguous = advice.proposals(make_tracing("ambiguous"))
    assert ambiguous[0].trial == "a feed range of 10:1"
    assert "radial runout from unequal pitch" in ambiguous[0].settles
    partly = advice.proposals(make_tracing("partly explained"))
    assert partly[0].trial.startswith("an air cut")
    assert len({each.trial for each in partly}) == len(partly) <= 5


def test_with_air_cuts_no_air_cut_is_asked_for(make_tracing: Make) -> None:
    tracing = make_tracing()
    air = replace(tracing.dataset.trials[0], file="air.csv", kind="air")
    tracing = replace(tracing, dataset=replace(tracing.dataset, trials=(*tracing.dataset.trials, air)))
    assert not any("air cut" in each.trial for each in advice.proposals(tracing))
    assert "The noise floor is taken from the air cuts." in advice.caveats(tracing)


def test_caveats_name_band_trials_phase_and_bias(make_tracing: Make) -> None:
    said = " ".join(advice.caveats(make_tracing()))
    for part in (
        "0 to 250 Hz",
        "5 cut trials are few",
        "5 to 1",
        "phase of every trial was fitted",
        "zeroed before",
    ):
        assert part in said
    whole = " ".join(advice.caveats(make_tracing(band_hz=(0.0, 1000.0))))
    assert "Everything up to half the sampling rate, 1000 Hz" in whole
    assert 0.0 <= advice.outside_band(make_tracing(band_hz=(0.0, 1000.0))) < 1e-6


def test_an_effect_is_told_in_its_authors_words() -> None:
    assert wording.gloss("radial_runout").startswith("the axis of the teeth is not the axis of rotation")
    assert wording.gloss("no_such_effect") == ""
    assert [wording.bare(name) for name in ("offset_m", "K_n_m2", "frequency_hz", "damping")] == [
        "offset", "K", "frequency", "damping",
    ]  # fmt: skip
