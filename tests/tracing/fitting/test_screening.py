"""The first look at every effect ranks the one put in first, and says what trials cannot show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting import _platform
from mjx_cutting.cutting import AbstractEffect, effect_class
from mjx_cutting.tracing.fitting.fit import base_starts, fit, reweighted
from mjx_cutting.tracing.fitting.problem import Problem, pose
from mjx_cutting.tracing.fitting.screening import Screened, screen
from mjx_cutting.tracing.records.lines import compress, trusted_band
from mjx_cutting.trials.dataset import AntiAlias, Dataset, Sensor, ToolInfo
from mjx_cutting.trials.synthetic import Conditions, Hidden, Sheet, make_trials

KINDS = [effect_class(name) for name in ("radial_runout", "unequal_pitch", "size_effect", "side_friction")]


def _screened(
    dataset: Dataset, kinds: Sequence[type[AbstractEffect]]
) -> tuple[tuple[Screened, ...], Problem]:
    """What of each of `kinds` is found beside the base model of the trials, and their fitting problem."""
    with _platform.x64():
        problem = pose(dataset, compress(dataset, trusted_band(dataset, None)))
        problem = reweighted(problem, fit(problem, (), base_starts(problem)))
        base = fit(problem, (), base_starts(problem))
        return screen(problem, (), base.x, kinds), problem


@pytest.fixture(scope="module")
def screened(mill):
    found, _ = _screened(mill(Hidden(runout_m=6e-6, runout_angle_rad=0.7)), KINDS)
    return {each.kind.name: each for each in found}


def test_what_was_put_in_explains_nearly_everything(screened):
    assert next(iter(screened)) == "radial_runout"
    assert screened["radial_runout"].share > 0.98
    assert max(each.share for name, each in screened.items() if name != "radial_runout") < 0.5


def test_survival_tells_what_the_base_model_can_imitate(screened):
    """In slots of one depth with a bias a trial, friction on the engaged area is but a constant."""
    assert screened["side_friction"].survival < 0.05
    assert screened["radial_runout"].survival > 0.8
    assert screened["size_effect"].survival < screened["unequal_pitch"].survival


def test_directions_are_unit_vectors_and_cosines_tell_effects_apart(screened):
    first, second = screened["radial_runout"].direction, screened["unequal_pitch"].direction
    assert np.linalg.norm(first) == pytest.approx(1.0)
    assert abs(first @ second) < 0.8


def _on_a_soft_arm(dataset: Dataset, mode: dict[str, float]) -> Dataset:
    """The trials as a wrist sensor on one mode of an arm has them, without the first half second."""
    along = np.array([np.cos(mode["direction_rad"]), np.sin(mode["direction_rad"]), 0.0])
    trials = []
    for trial in dataset.trials:
        count, rate_hz = len(trial.time_s), dataset.sensor.sample_rate_hz
        ratio = np.fft.rfftfreq(count, 1.0 / rate_hz) / mode["frequency_hz"]
        felt = mode["mass_ratio"] * ratio**2 / (1.0 - ratio**2 + 2j * mode["damping"] * ratio)
        more = np.fft.irfft(felt * np.fft.rfft(trial.force_n @ along), count)
        late = slice(round(0.5 * rate_hz), count)
        force = trial.force_n + more[:, None] * along
        trials.append(replace(trial, force_n=force[late], time_s=trial.time_s[late] - trial.time_s[late][0]))
    return replace(dataset, trials=tuple(trials))


def _check_mode(dataset: Dataset, mode: dict[str, float], name: str = "robot_mode") -> None:
    kind = effect_class(name)
    (found,), problem = _screened(dataset, [kind])
    read = kind.build(found.x[-kind.size(problem.tool) :], problem.tool)
    assert found.share > 0.98
    for parameter, true in mode.items():
        assert float(getattr(read, parameter)) == pytest.approx(true, rel=0.05), parameter


SHEET = Sheet((7.6e8, 2.3e8, 1.1e8), (2.1e4, 1.9e4, 4e3))


@pytest.mark.slow
def test_a_mode_is_found_on_its_own_side_of_the_few_lines_that_show_it():
    """Tooth passing stands at 32, 45 and 64 Hz: a mode at 52 Hz meets those lines better than any near it."""
    cuts = [
        Conditions(speed, speed * 32 * chip, 1.5e-3, 1e-3, "conventional")
        for speed, chip in ((1.0, 8e-6), (1.0, 4.5e-5), (1.4, 4.5e-5), (2.0, 8e-6), (2.0, 2e-5))
    ]
    made = make_trials(
        ToolInfo("slitting_saw", 32, 0.05),
        SHEET,
        cuts,
        Sensor(1000.0, (0.2, 0.2, 0.2), anti_alias=AntiAlias(order=4, hz=400.0)),
        duration_s=5.0,
    )
    mode = {"mass_ratio": 0.55, "frequency_hz": 41.0, "damping": 0.045, "direction_rad": 0.5}
    _check_mode(_on_a_soft_arm(made, mode), mode)


def _sawn() -> Dataset:
    """Tooth passing stands at 98, 127 and 170 Hz."""
    cuts = [
        Conditions(speed, speed * 24 * chip, depth, 1.2e-3, "conventional")
        for speed in (4.1, 5.3, 7.1)
        for depth in (1e-3, 2e-3)
        for chip in (1e-5, 2.5e-5, 6e-5)
    ]
    sensor = Sensor(500.0, (0.3, 0.3, 0.6), anti_alias=AntiAlias(order=4, hz=200.0))
    return make_trials(ToolInfo("slitting_saw", 24, 0.063), SHEET, cuts, sensor, duration_s=5.0)


@pytest.mark.slow
def test_a_heavy_tool_on_a_mode_beside_tooth_passing_is_found():
    """At one of three speeds tooth passing is five times what it was: a small start never gets there."""
    mode = {"mass_ratio": 0.52, "frequency_hz": 133.6, "damping": 0.0445, "direction_rad": 1.1}
    _check_mode(_on_a_soft_arm(_sawn(), mode), mode)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mass_ratio", "frequency_hz", "damping"), [(0.88, 79.0, 0.022), (0.72, 96.0, 0.038)]
)
def test_constants_that_a_sheet_swinging_drew_far_off_are_read_on_the_other_axes(
    mass_ratio: float, frequency_hz: float, damping: float
) -> None:
    mode = {"mass_ratio": mass_ratio, "frequency_hz": frequency_hz, "damping": damping}
    _check_mode(_on_a_soft_arm(_sawn(), mode | {"direction_rad": np.pi / 2}), mode, "clamp_mode")


def _on_a_sheet_that_swings(dataset: Dataset, mode: dict[str, float], begins_m: Sequence[float]) -> Dataset:
    """The trials on a sheet whose mode moves along the path, each begun at a place of its own; without the
    first half second. Semi-implicit Euler, ten steps a sample."""
    trials = []
    for trial, begin in zip(dataset.trials, begins_m, strict=True):
        count, rate_hz = len(trial.time_s), dataset.sensor.sample_rate_hz
        fine = np.arange(10 * (count - 1) + 1) / (10.0 * rate_hz)
        place = begin + trial.feed_speed_m_s * fine
        omega = 2 * np.pi * mode["frequency_hz"] * (1.0 + mode["gradient_1_m"] * place)
        force = np.interp(fine, trial.time_s, trial.force_n[:, 1])
        speed, way, swung = 0.0, float(force.mean() / omega[0] ** 2), np.empty(len(fine))
        for step, (push, w) in enumerate(zip(force.tolist(), omega.tolist(), strict=True)):
            swung[step] = push - 2.0 * mode["damping"] * w * speed - w * w * way
            speed += swung[step] / (10.0 * rate_hz)
            way += speed / (10.0 * rate_hz)
        late = slice(round(0.5 * rate_hz), count)
        felt = trial.force_n - mode["mass_ratio"] * swung[::10, None] * np.array([0.0, 1.0, 0.0])
        position = np.column_stack([place[::10], np.zeros((count, 2))])[late]
        time = trial.time_s[late] - trial.time_s[late][0]
        trials.append(replace(trial, force_n=felt[late], time_s=time, position_m=position))
    return replace(dataset, trials=tuple(trials))


@pytest.mark.slow
def test_a_sheet_is_found_whose_mode_nearly_doubles_along_it():
    """Trials begin at places of their own with the mode at 100 to 175 Hz, tooth passing at 86 or 114 Hz."""
    cuts = [
        Conditions(speed, speed * 2 * chip, depth, 2e-3, "conventional")
        for speed, chip, depth in (
            (57.0, 8e-5, 8e-3), (57.0, 8e-5, 3e-3), (43.0, 8e-5, 3e-3), (43.0, 4e-5, 3e-3),
            (43.0, 4e-5, 8e-3), (57.0, 4e-5, 8e-3), (43.0, 8e-5, 8e-3),
        )
    ]  # fmt: skip
    sensor = Sensor(2500.0, (0.3, 0.8, 0.5), anti_alias=AntiAlias(order=4, hz=900.0))
    made = make_trials(ToolInfo("end_mill", 2, 0.012), SHEET, cuts, sensor, duration_s=2.5)
    mode = {"mass_ratio": 0.068, "frequency_hz": 95.0, "gradient_1_m": 6.5, "damping": 0.035}
    begins_m = (0.074, 0.088, 0.011, 0.101, 0.124, 0.009, 0.079)
    _check_mode(_on_a_sheet_that_swings(made, mode, begins_m), mode, "clamp_mode")


def test_a_gullet_is_found_that_overflows_in_some_of_the_trials(hiding):
    """Most starts hold more than any tooth cuts, so that nothing happens there and no step leads on."""
    kind = effect_class("clogging")
    (found,), problem = _screened(hiding({"clogging": {"gain": 1.2, "capacity_m2": 1.276e-6}}), [kind])
    read = kind.build(found.x[-3:], problem.tool)
    assert found.share > 0.99
    assert float(read.capacity_m2) == pytest.approx(1.276e-6, rel=0.05)
    assert float(read.gain) == pytest.approx(1.2, rel=0.1)
