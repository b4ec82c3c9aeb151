"""Diagnostics on data whose answer is known: calibrated, white, coloured, one trial; and the figures."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

import mjx_cutting.disturbance as disturbance
from mjx_cutting import _platform
from mjx_cutting.disturbance import diagnostics, figures, laplace, search
from mjx_cutting.disturbance.kernel import shortest_length
from mjx_cutting.disturbance.likelihood import Hyper
from mjx_cutting.disturbance.statistics import reduce

OPTIONS = {"frequency_range_hz": (0.8, 5.0)}


@pytest.fixture(scope="module")
def periodic_fit(simulate):
    drawn = simulate(5, trials=6, stamps=500, rate_hz=100.0, axes=2)
    return drawn, disturbance.fit(drawn.time_s, drawn.residual_n, **OPTIONS)


def test_calibrated_and_periodic(periodic_fit):
    _, gp = periodic_fit
    report = gp.diagnostics
    heldout = report["heldout"]
    assert report["verdict"] == "periodic" and not gp.warnings
    assert heldout["folds"] == 6 and heldout["how"] == "trials left out"
    assert 0.6 < heldout["coverage_1_sigma"] < 0.76 and 0.92 < heldout["coverage_2_sigma"] < 0.98
    assert heldout["nlpd_nats_per_sample"] < heldout["nlpd_of_white_noise"] - 0.1
    assert sum(heldout["pit_counts"]) == 6 * 500 * 2
    assert min(heldout["pit_counts"]) > 0.6 * 300
    explained = report["explained"]
    assert explained["with_own"]["all"] > explained["common"]["all"] > 0.2
    assert explained["periodic_share"]["all"] > 0.4
    assert np.max(np.abs(report["left_autocorrelation"])) < 0.1
    assert min(report["ljung_box"]["left"]["p"]) > 1e-4 > max(report["ljung_box"]["data"]["p"])
    assert len(report["spectrum"]["frequency_hz"]) == len(report["spectrum"]["left"][1])


def test_what_is_not_periodic_is_said_not_to_be():
    rng = np.random.default_rng(0)
    walk = rng.normal(size=(6, 500, 2))
    for i in range(1, 500):
        walk[:, i] += 0.9 * walk[:, i - 1]
    time = np.arange(500) * 0.01
    for residual, coloured in ((rng.normal(size=(6, 500, 2)), False), (walk, True)):
        gp = disturbance.fit(time, residual, **OPTIONS)
        assert gp.diagnostics["verdict"] == "not periodic"
        assert any("not periodic" in w for w in gp.warnings)
        assert any("not independent noise" in w for w in gp.warnings) == coloured
        assert gp.diagnostics["explained"]["periodic_share"]["all"] < 0.05


def test_one_trial_holds_out_its_last_third(simulate):
    drawn = simulate(6, trials=1, stamps=500, rate_hz=100.0, axes=2, trial_amplitude=0.0)
    gp = disturbance.fit(drawn.time_s, drawn.residual_n, **OPTIONS)
    heldout = gp.diagnostics["heldout"]
    assert heldout["folds"] == 1 and "last third" in heldout["how"]
    assert 0.9 < heldout["coverage_2_sigma"] < 0.99
    assert gp.diagnostics["explained"]["periodic_share"]["all"] > 0.3


def test_autocorrelation_and_ljung_box_by_hand():
    rng = np.random.default_rng(1)
    white = rng.normal(size=(3, 2000, 1))
    assert np.max(np.abs(diagnostics.autocorrelation(white))) < 0.06
    box = diagnostics.ljung_box(white)
    assert box["degrees_of_freedom"] == 60 and box["p"][0] > 1e-3
    moving = white[:, 1:] + 0.5 * white[:, :-1]
    np.testing.assert_allclose(diagnostics.autocorrelation(moving)[:2, 0], [0.4, 0.0], atol=0.05)
    assert diagnostics.ljung_box(moving)["p"][0] < 1e-10
    gap = moving.copy()
    gap[1, 1500:] = np.nan
    np.testing.assert_allclose(diagnostics.autocorrelation(gap)[0, 0], 0.4, atol=0.06)


def test_joint_density_is_the_dense_one():
    rng = np.random.default_rng(2)
    B, r = rng.normal(size=(30, 5)), rng.normal(size=30)
    dense = stats.multivariate_normal(np.zeros(30), B @ B.T + 0.49 * np.eye(30)).logpdf(r)
    assert diagnostics._joint(r, B, 0.7) == pytest.approx(dense, rel=1e-10)


def test_coloured_noise_inflates_the_error():
    assert laplace.inflation(0.0) == 1.0 and laplace.inflation(-0.3) == 1.0
    assert laplace.inflation(0.6) == pytest.approx(2.0)


def test_laplace_is_the_curvature_of_the_dense_likelihood(periodic_fit, dense_log_likelihood):
    drawn, gp = periodic_fit
    reduced = reduce(drawn.time_s[::2], drawn.residual_n[:4, ::2, :1])
    scale = reduced.scale
    one = np.ones(1)

    def minus(log_noise):
        noise = np.exp(log_noise) * one
        hyper = Hyper(gp.frequency_hz, gp.length[:1], gp.amplitude_n[:1] / scale, gp.trial_length[:1],
                      gp.trial_amplitude_n[:1] / scale, noise)  # fmt: skip
        return -dense_log_likelihood(hyper, reduced)

    at, h = np.log(gp.noise_std_n[0] / scale[0]), 1e-3
    curvature = (minus(at + h) - 2 * minus(at) + minus(at - h)) / h**2

    def unbound(length):  # the search's variable is the length above its least value
        return np.sqrt(length**2 - shortest_length(32) ** 2)

    with _platform.x64():
        x = search.encode(
            unbound(gp.length[:1]), gp.amplitude_n[:1] / scale, np.exp(at) * one,
            (unbound(gp.trial_length[:1]), gp.trial_amplitude_n[:1] / scale),
        )  # fmt: skip
        found = search.Found(None, 0.0, x, gp.frequency_hz, 0.1, True, 1, 1)
        H, _ = laplace.hessian(found, reduced, 32)
    assert H[-1, -1] == pytest.approx(curvature, rel=1e-3)


def test_figures_are_labelled_and_written(periodic_fit, tmp_path):
    drawn, gp = periodic_fit
    written = figures.save_all(gp, drawn.time_s, drawn.residual_n, tmp_path)
    assert sorted(p.name for p in written) == ["bands.png", "calibration.png", "scan.png", "spectrum.png"]
    assert all(p.read_bytes()[:4] == b"\x89PNG" for p in written)
    panels = figures.bands(gp, drawn.time_s, drawn.residual_n).axes
    assert len(panels) == 4 and panels[0].get_ylabel() == "residual x (N)"
    assert panels[1].get_xlim()[1] > drawn.time_s[-1]  # extrapolation is shown
    plain = disturbance.fit(drawn.time_s, drawn.residual_n, **OPTIONS, diagnose=False)
    with pytest.raises(ValueError, match="without diagnostics"):
        figures.spectrum(plain)
