"""A sensor mounted another way round is noticed, and the key that would say so is given."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from mjx_cutting import _platform
from mjx_cutting.cutting import effect_class
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.fitting.fit import fit_base
from mjx_cutting.tracing.fitting.problem import pose
from mjx_cutting.tracing.records.lines import compress, trusted_band
from mjx_cutting.tracing.telling import axes
from mjx_cutting.tracing.telling.axes import Reading, better_reading, most_left
from mjx_cutting.trials.dataset import columns_to_process
from mjx_cutting.trials.synthetic import Hidden


def _reading(dataset, left=1.0):
    with _platform.x64():
        lines = compress(dataset, trusted_band(dataset, None))
        return better_reading(dataset, lines, fit_base(pose(dataset, lines))[0], left)


@pytest.mark.parametrize("declared", [None, ("-z", "+x", "+y")])
def test_forces_on_the_sheet_along_other_axes_are_noticed(mill, declared):
    dataset = mill()
    turned = [
        replace(trial, force_n=columns_to_process(trial.force_n, ("+y", "-x", "+z")))
        for trial in dataset.trials
    ]
    found = _reading(replace(dataset, trials=tuple(turned), axes=declared))
    assert found is not None and found.error < 0.01 < 0.1 < found.now
    assert _reading(replace(dataset, trials=tuple(turned), axes=declared), left=0.05) is None
    columns = np.eye(3) if declared is None else columns_to_process(np.eye(3), declared).T
    for trial, other in zip(dataset.trials, turned, strict=True):
        file = other.force_n @ columns
        again = columns_to_process(file, found.axes)
        np.testing.assert_allclose(again[:, :2], trial.force_n[:, :2])


def _turned(dataset, columns):
    """The data set as a sensor recorded it of which the columns are `columns`, which nobody says."""
    of = columns_to_process(np.eye(3), columns).T
    trials = tuple(replace(trial, force_n=trial.force_n @ of) for trial in dataset.trials)
    return replace(dataset, trials=trials, axes=None)


def test_where_nothing_is_said_of_the_axes_the_trials_are_traced_as_they_fit(mill):
    found = trace(_turned(mill(), ("+y", "-x", "+z")), effects=("radial_runout",))
    assert found.verdict["effects"] == [] and found.verdict["verdict"] == "nothing missing"
    assert found.verdict["after"]["heldout_nrmse"] < 1.15 * found.verdict["noise_floor_nrmse"]
    assert found.dataset.axes == ("+y", "-x", "+z")
    assert any("read as ['+y', '-x', '+z']" in each for each in found.caveats)
    assert "read as ['+y', '-x', '+z']" in found.verdict["remaining"]["description"]


def test_a_strong_effect_shows_which_reading_is_right_where_the_base_model_does_not(mill):
    dataset = _turned(mill(Hidden(resonance_hz=420.0, resonance_damping=0.05)), ("-y", "+x", "+z"))
    assert _reading(dataset) is None
    found = trace(dataset, effects=("sensor_resonance", "size_effect"))
    assert found.verdict["verdict"] == "explained" and found.dataset.axes == ("-y", "+x", "+z")
    (named,) = found.verdict["effects"]
    assert named["parameters"]["frequency_hz"]["value"] == pytest.approx(420.0, rel=0.01)
    assert any("explained far better" in each for each in found.caveats)


def test_what_the_data_set_says_of_its_axes_is_doubted_where_another_reading_explains_everything(mill):
    dataset = replace(_turned(mill(), ("+y", "-x", "+z")), axes=("+x", "+y", "+z"))
    found = trace(dataset, effects=())
    assert found.dataset.axes == ("+y", "-x", "+z") and found.verdict["verdict"] == "nothing missing"
    assert any("not, as dataset.json says, as ['+x', '+y', '+z']" in each for each in found.caveats)


def test_what_the_data_set_says_of_its_axes_is_kept_where_another_reading_leaves_much(mill):
    dataset = _turned(mill(Hidden(runout_m=1e-6)), ("+y", "-x", "+z"))
    found = trace(replace(dataset, axes=("+x", "+y", "+z")), effects=())
    assert found.dataset.axes == ("+x", "+y", "+z") and found.verdict["verdict"] == "unexplained"
    assert found.reading is not None and found.reading.axes[:2] == ("+y", "-x")


@pytest.mark.parametrize(
    ("said", "error", "explained", "left"),
    [
        (None, 0.03, False, 0.25),
        (None, 0.06, False, 0.0),
        (None, 0.06, True, 0.25),
        (("+x", "+y", "+z"), 0.06, True, 0.25),
        (("+x", "+y", "+z"), 0.03, False, 0.1),
        (("+y", "+x", "+z"), 0.03, False, 0.0),
    ],
    ids=["nothing said", "hardly better", "nothing said, explained", "explained", "signs", "axes"],
)
def test_what_the_data_set_says_of_its_axes_is_doubted_sooner_for_a_sign(said, error, explained, left):
    assert most_left(said, Reading(("-x", "+y", "+z"), error, 0.1), explained) == left


@pytest.mark.parametrize(("share", "read"), [(0.8, ("+x", "-y", "+z")), (0.4, None)])
def test_a_reading_is_looked_at_in_which_one_effect_of_two_leaves_clearly_less(
    mill, monkeypatch, share, read
):
    """All readings leave .12 alone, and an effect of the others takes a third of the energy."""
    wrong = ((0, 1, 2), (1.0, -1.0, 1.0))
    explained = {wrong: share}
    kinds = [SimpleNamespace(kind=effect_class("radial_runout"), share=0.3)]

    def fitted(problem, lines, way):
        return axes._Way(way, way, np.zeros(1), 0.12)

    def screened(way, effects, x, kinds):
        return [SimpleNamespace(kind=kinds[0], share=explained.get(way, 1.0 / 3.0))]

    monkeypatch.setattr(axes, "_fitted", fitted)
    monkeypatch.setattr(axes, "screen", screened)
    found = axes.reading_with_an_effect(mill(), None, SimpleNamespace(motion=None), kinds, left=0.11)
    assert (None if found is None else found.axes) == read


def test_no_reading_is_looked_at_beside_effects_that_explain_next_to_nothing(mill, monkeypatch):
    """As is, the forces fit best, and the effect that tells most takes a twentieth of what is left."""
    kinds = [SimpleNamespace(kind=effect_class("torque_ripple"), share=0.05)]
    fitted = lambda problem, lines, way: axes._Way(way, way, np.zeros(1), 0.12)  # noqa: E731
    monkeypatch.setattr(axes, "_fitted", fitted)
    monkeypatch.setattr(axes, "screen", lambda *_: pytest.fail("looked at an effect that tells nothing"))
    assert axes.reading_with_an_effect(mill(), None, SimpleNamespace(motion=None), kinds, 0.11) is None


def test_forces_that_fit_as_they_are_are_left_alone(mill):
    assert _reading(mill(Hidden(runout_m=2e-5))) is None


@pytest.mark.slow
def test_a_wrong_sign_that_two_effects_nearly_explain_is_found_beneath_noise(hiding):
    """Noise is most of what either reading leaves."""
    cutoff_hz, noise_n = 260.0, 8.0
    clean = hiding({"sensor_lowpass": {"cutoff_hz": cutoff_hz, "order": 1.0}})
    noise = np.random.default_rng(0)
    trials = tuple(
        replace(
            trial,
            force_n=(trial.force_n + noise_n * noise.normal(size=trial.force_n.shape)) * [1.0, -1.0, 1.0],
        )
        for trial in clean.trials
    )
    found = trace(
        replace(clean, trials=trials, axes=None, sensor=replace(clean.sensor, noise_std_n=None)),
        effects=("sensor_lowpass", "robot_mode", "time_offset"),
    )
    (named,) = found.verdict["effects"]
    assert (found.verdict["verdict"], named["name"]) == ("explained", "sensor_lowpass")
    assert found.dataset.axes[1] == "-y"
    assert named["parameters"]["cutoff_hz"]["value"] == pytest.approx(cutoff_hz, rel=0.05)
