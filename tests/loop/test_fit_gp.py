"""fit-gp on trials whose disturbance is known: with a model, by time, bad input, what is written."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

import mjx_cutting.disturbance as disturbance
from mjx_cutting.cutting import ForceModel, Material, Tool
from mjx_cutting.loop.fit_gp import fit_gp, whole_teeth
from mjx_cutting.trials.dataset import AntiAlias, Dataset, Sensor, ToolInfo, Trial

RATE = 400.0
SPEED = 5.0


def _dataset(trials=4, seconds=2.0, disturbed=20.0, own=0.0, anti_alias=None):
    """Trials of a four-tooth slot cut: a mean, a disturbance once a revolution, and noise."""
    rng = np.random.default_rng(0)
    t = np.arange(int(seconds * RATE)) / RATE
    made = []
    for r in range(trials):
        angle = 2 * np.pi * SPEED * t + 0.5 * r
        wave = np.stack([np.cos(angle), np.sin(angle) + 0.3 * np.sin(2 * angle), 0.2 * np.cos(angle)], -1)
        force = np.array([-100.0, 200.0, -50.0]) + disturbed * (1 + own * rng.normal()) * wave
        force = force + rng.normal(size=force.shape)
        made.append(
            Trial(
                file=f"t{r}.csv",
                kind="cut",
                milling="slot",
                spindle_speed_rev_s=SPEED,
                feed_speed_m_s=0.002,
                radial_depth_m=0.02,
                axial_width_m=0.002,
                time_s=t,
                force_n=force,
                spindle_angle_rad=np.mod(angle, 2 * np.pi),
            )
        )
    sensor = Sensor(
        sample_rate_hz=RATE, noise_std_n=(1.0, 1.0, 1.0), zeroed="trial", units="SI", anti_alias=anti_alias
    )
    return Dataset(
        name="made",
        source="a test",
        licence="CC0-1.0",
        tool=ToolInfo(kind="end_mill", teeth=4, diameter_m=0.02, helix_rad=0.0),
        sensor=sensor,
        axes=None,
        trials=tuple(made),
        left_out=(),
        warnings=("something doubtful",),
    )


MODEL = ForceModel(Tool("end_mill", 4, 0.02, 0.0), Material(8e8, 2e4, 3e8, 2e4, 1e8, 1e4))


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    out = tmp_path_factory.mktemp("fit") / "run"
    stages: list[str] = []
    fitted = fit_gp(_dataset(), None, out, diagnose=False, progress=stages.append)
    return out, fitted, stages


def test_without_a_model_the_measured_angle_is_the_clock(written):
    _, fitted, stages = written
    assert fitted.alignment.variable == "spindle_angle"
    assert fitted.gp.frequency_hz == pytest.approx(SPEED, rel=1e-3)
    assert stages[-1] == "writing" and "fitting the disturbance" in stages
    # the disturbance is in phase in all trials once they share the angle
    assert np.max(fitted.gp.trial_std_n) < 0.2 * np.max(fitted.gp.common_std_n)
    mean, _ = fitted.gp.predict(np.arange(80) / RATE)
    assert np.max(np.abs(mean[:, 0])) == pytest.approx(20.0, rel=0.05)


def test_what_is_written_loads_and_tells_its_origin(written):
    out, _, _ = written
    names = sorted(p.name for p in out.iterdir())
    assert names == ["alignment.png", "bands.png", "disturbance.json", "gp.npz", "scan.png"]
    gp = disturbance.load(out / "gp.npz")
    assert gp.provenance["dataset"] == "made" and gp.provenance["trials"] == [f"t{r}.csv" for r in range(4)]
    assert gp.provenance["dataset_warnings"] == ["something doubtful"]
    told = json.loads((out / "disturbance.json").read_text())
    assert told["alignment"]["variable"] == "spindle_angle" and told["period_s"] == gp.period_s
    assert gp.posterior().frequency_hz == pytest.approx(SPEED, rel=1e-3)


def test_with_a_model_the_fitted_angle_is_the_clock_and_the_record_is_thinned():
    made = _dataset(anti_alias=AntiAlias(kind="butterworth", order=4, hz=50.0, zero_phase=True))
    fitted = fit_gp(made, MODEL, diagnose=False, trial_effects=False)
    report = fitted.report
    assert report["thinned_by"] == 4 and fitted.time_s[1] == pytest.approx(4 / RATE)
    assert fitted.alignment.variable == "spindle_angle" and "prediction" in fitted.alignment.reason
    assert len(report["teeth_shifted"]) == 4
    assert 0 < report["energy_share"] < 1
    ratio = fitted.gp.frequency_hz / SPEED
    assert ratio == pytest.approx(1.0, rel=0.01)


def test_by_time_the_warp_is_reported_with_the_period_before_it():
    fitted = fit_gp(
        _dataset(trials=3),
        None,
        clock="time",
        warp=True,
        warp_radius_s=0.02,
        diagnose=False,
        trial_effects=False,
    )
    report = fitted.report
    assert fitted.alignment.variable == "time"
    assert report["alignment"]["warp_max_s"] <= 0.02 + 1e-9
    assert report["fitted_period_before_warp_s"] == pytest.approx(1 / SPEED, rel=0.01)
    assert fitted.gp.period_s == pytest.approx(1 / SPEED, rel=0.01)


@pytest.mark.parametrize(
    ("change", "options", "message"),
    [
        (lambda d: dataclasses.replace(d, trials=()), {}, "no cut trial"),
        (lambda d: d, {"clock": "phase"}, "'phase'"),
        (lambda d: d, {"clock": "angle", "warp": True, "with_model": True}, "clock 'time'"),
        (lambda d: d, {"frequency_range_hz": (2.0, 300.0)}, "alias"),
        (lambda d: d, {"frequency_range_hz": (0.2, 3.0)}, "fits less than 2 times"),
    ],
)
def test_bad_input_is_named_and_nothing_is_written(tmp_path, change, options, message):
    options = dict(options)
    model = MODEL if options.pop("with_model", False) else None
    with pytest.raises(ValueError, match=message):
        fit_gp(change(_dataset(trials=2)), model, tmp_path / "run", **options)
    assert not (tmp_path / "run").exists()


def test_residuals_that_differ_by_whole_teeth_are_turned_together():
    t = np.arange(4000) / 1000.0
    angle = 2 * np.pi * 3.0 * t
    teeth, true = 3, [0, 2, 1]
    alike = [np.stack([np.cos(teeth * angle)], -1)] * 3
    angles = [angle - 2 * np.pi * k / teeth for k in true]
    left = [np.cos(angle)[:, None] * 5.0] * 3
    shifts = np.array(whole_teeth(angles, alike, left, teeth))
    turned = (shifts - np.array(true)) % teeth
    assert len(set(turned)) == 1
    apart = [np.cos(angle)[:, None]] * 3  # a prediction that tells its teeth apart
    assert whole_teeth(angles, apart, left, teeth) == [0, 0, 0]
    assert whole_teeth(angles, alike, left, 1) == [0, 0, 0]
