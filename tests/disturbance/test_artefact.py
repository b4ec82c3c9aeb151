"""The artefact: a round trip, and every way a file can be wrong."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

import mjx_cutting.disturbance as disturbance
from mjx_cutting.disturbance.gp import DisturbanceGP


def _gp():
    rng = np.random.default_rng(0)
    m = 9
    return DisturbanceGP(
        axes=("x", "z"),
        frequency_hz=2.5,
        length=np.array([0.5, 0.6]),
        amplitude_n=np.array([1.0, 2.0]),
        trial_length=np.array([0.5, 0.6]),
        trial_amplitude_n=np.array([0.1, 0.2]),
        noise_std_n=np.array([0.3, 0.4]),
        common_std_n=np.array([0.9, 1.9]),
        trial_std_n=np.array([0.1, 0.2]),
        harmonics=4,
        weights_mean_n=rng.normal(size=(2, m)),
        weights_factor_n=np.stack([np.eye(m)] * 2),
        weights_trial_factor_n=np.stack([2 * np.eye(m)] * 2),
        trial_means_n=rng.normal(size=(3, 2, m)),
        standard_errors={"frequency_hz": 1e-3, "period_s": np.inf, "length_relative": np.array([0.1, 0.2])},
        log_likelihood=-12.5,
        trial_effects=True,
        trials=3,
        samples=300,
        start_s=0.0,
        span_s=1.0,
        sample_rate_hz=100.0,
        scan_hz=np.arange(5.0),
        scan_log_likelihood=np.arange(5.0),
        warnings=("look out",),
        diagnostics={"left_lag1": [0.1, float("nan")]},
        provenance={"dataset": "made here", "seed": np.int64(3)},
    )


def test_round_trip(tmp_path):
    gp = _gp()
    path = gp.save(tmp_path / "deep" / "disturbance.npz")
    again = disturbance.load(path)
    for each in dataclasses.fields(gp):
        before, after = getattr(gp, each.name), getattr(again, each.name)
        if isinstance(before, np.ndarray):
            np.testing.assert_array_equal(after, before)
    assert again.axes == ("x", "z") and again.warnings == ("look out",)
    assert again.diagnostics == {"left_lag1": [0.1, None]}  # JSON has no nan
    assert again.provenance == {"dataset": "made here", "seed": 3}
    np.testing.assert_array_equal(again.posterior().mean, gp.posterior().mean)
    with np.load(path, allow_pickle=False) as file:
        meta = json.loads(str(file["meta"]))
    assert meta["format"] == "mjx-cutting-disturbance/1"
    assert meta["units"]["amplitude_n"] == "N" and "feed" in meta["frame"]


def test_pruned_posterior_keeps_the_covariance():
    gp = _gp()
    gp.weights_mean_n[:, [3, 4, 7, 8]] = 0.0
    factor = gp.weights_factor_n
    factor[:, [3, 4, 7, 8]] = 0.0
    gp.weights_trial_factor_n[:, [3, 4, 7, 8]] = 0.0
    posterior = gp.posterior()
    assert posterior.harmonics == 2
    kept = [0, 1, 2, 5, 6]
    C = np.asarray(posterior.factor[0])
    np.testing.assert_allclose(C @ C.T, (factor[0] @ factor[0].T)[np.ix_(kept, kept)], atol=1e-6)
    assert not np.asarray(posterior.factor[1]).any()  # y was not fitted


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"not a zip", "is not a disturbance file"),
        ({"meta": np.asarray("{}")}, "has format None"),
        ({"meta": np.asarray('{"format": "other/1"}')}, "'other/1'"),
        ({"meta": np.asarray("[1]")}, "has format"),
        ({"x": np.zeros(3)}, "is not a disturbance file"),
        ({"meta": np.asarray('{"format": "mjx-cutting-disturbance/1"}')}, "lacks"),
    ],
)
def test_damaged_files_are_named(tmp_path, content, message):
    path = tmp_path / "d.npz"
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        np.savez(path, **content)
    with pytest.raises(ValueError, match=message):
        disturbance.load(path)


def test_a_cut_off_file_and_a_missing_one(tmp_path):
    path = _gp().save(tmp_path / "d.npz")
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(ValueError, match="is not a disturbance file"):
        disturbance.load(path)
    with pytest.raises(FileNotFoundError, match="fit-gp"):
        disturbance.load(tmp_path / "none.npz")


def test_an_unwritable_place_leaves_nothing(tmp_path):
    with pytest.raises(ValueError, match=r"\.npz"):
        _gp().save(tmp_path / "d.json")
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OSError):
        _gp().save(tmp_path / "file" / "d.npz")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file"]
