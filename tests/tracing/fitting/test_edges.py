"""Steps that an unfiltered sensor samples as they are do not stand in the records as noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjx_cutting import _platform
from mjx_cutting.tracing.fitting.edges import without_edges
from mjx_cutting.tracing.fitting.fit import fit_base
from mjx_cutting.tracing.fitting.prediction import energy, predictions
from mjx_cutting.tracing.fitting.problem import pose, shared_bias
from mjx_cutting.tracing.records.lines import compress
from mjx_cutting.tracing.trace import trace
from mjx_cutting.trials.dataset import AntiAlias, Dataset, Sensor, ToolInfo, Trial

RATE_HZ, TEETH, NOISE_N = 2000.0, 4, 0.2
BAND = (0.0, 0.5 * RATE_HZ)


def _straight_teeth(
    wear: float = 0.0,
    smoothed_s: float = 0.0,
    broken: bool = False,
    speeds: tuple[float, float] = (23.3, 26.1),
    off: float = 0.003,
) -> Dataset:
    """Half-immersed cuts of straight teeth, sampled as they are or as a slow sensor has them; the edge force
    grows by a share from trial to trial; one tooth may be missing; speeds are off by up to a share."""
    generator, trials = np.random.default_rng(1), []
    for index, (speed, chip) in enumerate(zip(2 * speeds, (5e-5, 3e-5, 9e-5, 7e-5), strict=True)):
        time = np.arange(4000) / RATE_HZ
        own, phase = speed * (1.0 + off * generator.uniform(-1.0, 1.0)), generator.uniform(0.0, 6.28)
        inner = np.linspace(-smoothed_s, 0.0, 24 if smoothed_s else 1)
        force = np.mean(
            [_force(2 * np.pi * own * (time + d) + phase, chip, wear * index, broken) for d in inner], axis=0
        )
        force += NOISE_N * generator.normal(size=force.shape) + generator.normal(size=3)
        trials.append(
            Trial(
                file=f"t{index}.csv",
                kind="cut",
                milling="conventional",
                time_s=time,
                force_n=force,
                spindle_speed_rev_s=speed,
                feed_speed_m_s=chip * TEETH * own,
                radial_depth_m=0.008,
                axial_width_m=2e-3,
                material="any",
            )
        )
    return Dataset(
        name="steps",
        source="test",
        licence="CC0-1.0",
        tool=ToolInfo("end_mill", TEETH, 0.016),
        sensor=Sensor(RATE_HZ),
        trials=tuple(trials),
    )


def _force(angle: np.ndarray, chip_m: float, wear: float, broken: bool) -> np.ndarray:
    """[T, 3] mechanistic force of teeth in the arc from 0 to a quarter of a turn, N; behind a missing one the
    next has twice the chip."""
    total = np.zeros((len(angle), 3))
    for tooth in range(1 if broken else 0, TEETH):
        at = np.mod(angle - 2.0 * np.pi * tooth / TEETH, 2.0 * np.pi)
        inside = (at > 0.0) & (at < 0.5 * np.pi)
        chip = chip_m * np.sin(at) * (2.0 if broken and tooth == 1 else 1.0)
        tangential, radial, axial = (
            inside * 2e-3 * (k * chip + e * (1.0 + wear)) for k, e in ((8e8, 2e4), (2.4e8, 1.6e4), (1e8, 4e3))
        )
        total[:, 0] += -tangential * np.cos(at) - radial * np.sin(at)
        total[:, 1] += tangential * np.sin(at) - radial * np.cos(at)
        total[:, 2] -= axial
    return total


def _between(dataset: Dataset) -> float:
    """Share of the force that no line holds."""
    lines = compress(dataset, BAND)
    return float(np.sqrt(lines.rest_n2.sum() / lines.energy_n2.sum()))


@pytest.mark.parametrize("wear", [0.0, 0.3])
def test_what_edges_leave_between_the_lines_is_taken_off(wear):
    """Also where the edges wear, of which the base model knows nothing."""
    dataset = _straight_teeth(wear)
    with _platform.x64():
        rest = without_edges(dataset, BAND)
        assert _between(rest) < 0.5 * _between(dataset)


@pytest.mark.parametrize("smoothed_s", [0.0, 2e-5, 7e-5])
def test_what_is_left_between_the_lines_is_noise(smoothed_s):
    """Whatever small part of the sampling interval the sensor averages over."""
    dataset = _straight_teeth(smoothed_s=smoothed_s)
    with _platform.x64():
        rest = without_edges(dataset, BAND)
        lines = compress(rest, BAND)
    noise = NOISE_N * np.sqrt(3.0 * lines.samples.sum() / lines.energy_n2.sum())
    assert _between(rest) < 1.5 * noise < 0.5 * _between(dataset)


def test_edges_that_fold_onto_lines_are_taken_off_as_well():
    """Of just so many samples a turn nothing stands between the lines; the base model is wrong of these."""
    dataset = _straight_teeth(speeds=(RATE_HZ / 80.0, RATE_HZ / 100.0), off=0.0)
    with _platform.x64():
        rest = without_edges(dataset, BAND)
        assert _between(rest) > 0.9 * _between(dataset)
        assert _missed(rest) < 0.8 * _missed(dataset)


def _missed(dataset: Dataset) -> float:
    """Energy that the base model leaves, N^2."""
    lines = compress(dataset, BAND)
    problem, base = fit_base(pose(dataset, lines))
    shown = predictions(dataset, lines, problem, base.model, shared_bias(problem, base.x))
    return energy([each.residual_n for each in shown])


@pytest.mark.slow
def test_teeth_that_are_not_alike_have_edges_of_their_own():
    """Edges as of teeth all alike leave more than noise beside the broken tooth that is found."""
    dataset = _straight_teeth(broken=True)
    found = trace(dataset, effects=["broken_tooth"])
    with _platform.x64():
        alike = without_edges(dataset, BAND)
        assert _between(found.dataset) < 0.5 * _between(alike) < 0.5 * _between(dataset)


def test_a_sensor_that_takes_them_away_is_left_alone():
    slow, stated = _straight_teeth(smoothed_s=2e-3), _straight_teeth()
    filtered = replace(stated, sensor=replace(stated.sensor, anti_alias=AntiAlias(order=4, hz=500.0)))
    with _platform.x64():
        assert without_edges(slow, BAND) is slow
        assert without_edges(filtered, BAND) is filtered


def test_a_channel_that_was_not_connected_is_not_fitted():
    """Of one axis the constants still come out; nothing is predicted on the others."""
    made = _straight_teeth(smoothed_s=2e-4)
    trials = tuple(replace(t, force_n=t.force_n * np.array([0.0, 1.0, 0.0])) for t in made.trials)
    with _platform.x64():
        dataset = replace(made, trials=trials)
        lines = compress(dataset, BAND)
        problem, base = fit_base(pose(dataset, lines))
        shown = predictions(dataset, lines, problem, base.model)
    left = np.concatenate([each.residual_n for each in shown])
    force = np.concatenate([each.measured_n for each in shown])
    assert not left[:, [0, 2]].any()
    assert np.sqrt(np.mean(left**2) / np.mean(force**2)) < 0.1
    assert float(base.model.material.K_tc_n_m2) == pytest.approx(8e8, rel=0.1)
