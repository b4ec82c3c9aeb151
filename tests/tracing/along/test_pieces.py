"""Trials in pieces: what a piece is, and that pieces are held out and counted by trial."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.study.designs import plan
from benchmarks.study.generator import recorded
from mjx_cutting import _platform
from mjx_cutting.tracing.along.pieces import in_pieces
from mjx_cutting.tracing.fitting.fit import fit_base
from mjx_cutting.tracing.fitting.heldout import folds, held_out
from mjx_cutting.tracing.fitting.problem import pose
from mjx_cutting.tracing.records.course import along_path
from mjx_cutting.tracing.records.lines import compress, trusted_band
from mjx_cutting.tracing.trace import trace
from mjx_cutting.trials.dataset import Dataset


@pytest.fixture(scope="module")
def session(saw):
    with _platform.x64():
        dataset = saw()
        lines = compress(dataset, trusted_band(dataset, None))
        pieces = in_pieces(dataset, lines)
        assert pieces is not None
        return dataset, lines, pieces


def test_a_trial_is_the_sum_of_its_pieces(session):
    dataset, _, pieces = session
    count = len(pieces.trials) // len(dataset.trials)
    assert count > 1
    for index, trial in enumerate(dataset.trials):
        own = pieces.trials[index * count : (index + 1) * count]
        assert np.array_equal(np.concatenate([each.force_n for each in own]), trial.force_n)
        assert np.allclose(np.concatenate([along_path(each) for each in own]), along_path(trial))
        starts = [each.cut_length_before_m - trial.cut_length_before_m for each in own]
        assert np.allclose(starts, [along_path(each)[0] for each in own])


def test_pieces_stand_at_their_own_places(session):
    dataset, lines, pieces = session
    with _platform.x64():
        cut = compress(pieces, lines.band_hz, like=lines)
        whole, parts = pose(dataset, lines), pose(pieces, cut)
    count = parts.trials // whole.trials
    middles = np.asarray(parts.cut.position_m).reshape(-1, count)
    assert np.allclose(middles.mean(axis=1), whole.cut.position_m, rtol=1e-3)
    assert np.all(np.diff(middles, axis=1) > 0.9 * np.asarray(parts.path_m).reshape(-1, count)[:, 1:])
    assert np.allclose(cut.speed_rev_s.reshape(-1, count), lines.speed_rev_s[:, None], rtol=1e-6)


def test_pieces_are_held_out_with_their_trial(session):
    dataset, lines, pieces = session
    with _platform.x64():
        cut = compress(pieces, lines.band_hz, like=lines)
        problem, base = fit_base(pose(pieces, cut))
        fold = folds(pieces, 0)
        found = held_out(problem, cut, (), base.x, fold)
    assert len(fold) == len(dataset.trials) == len(found.error_n2)
    assert np.allclose(found.energy_n2, lines.energy_n2, rtol=0.02)
    assert 0.0 < found.nrmse < 0.05


@pytest.mark.slow
def test_a_sheet_held_at_both_ends_is_softest_between_them():
    """Down from 220 to 171 Hz after 15 mm and nearly all the way back: means of whole trials show a mode that
    hardly moves."""
    session = plan("mill", 404, ("clamp_mode",))
    mode = {
        "mass_ratio": 0.3,
        "frequency_hz": 220.0,
        "gradient_1_m": -30.0,
        "damping": 0.025,
        "curvature_1_m2": 1e3,
    }
    session, trials = recorded(session, {"clamp_mode": mode}, 404)
    dataset = Dataset(
        name="sheet", source="-", licence="-", tool=session.tool, sensor=session.sensor, trials=trials
    )
    found = trace(dataset, effects=["clamp_mode", "robot_mode", "sensor_resonance", "flank_wear"])
    (named,) = found.verdict["effects"]
    assert named["name"] == "clamp_mode"
    values = found.model.effects[0].values()
    for name, true in mode.items():
        assert float(values[name]) == pytest.approx(true, rel=0.06), name
    assert found.final.nrmse < 0.3 * found.search.base.nrmse
