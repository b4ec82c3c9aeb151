"""The measured public sets: what their importers make of them, against the numbers published for them."""

from __future__ import annotations

import numpy as np
import pytest

from mjx_cutting.trials import read, resolve, write
from mjx_cutting.trials.importers.drilling import HOLE_DEPTH_M, import_drilling
from mjx_cutting.trials.importers.slotting import AXES, FEEDS_MM_MIN, import_slotting

pytestmark = pytest.mark.measured


@pytest.fixture(scope="module")
def slotting(measured_data):
    return import_slotting(measured_data / "slotting")


@pytest.fixture(scope="module")
def drilling(measured_data):
    return import_drilling(measured_data / "drilling")


def test_slotting_conditions(slotting):
    assert len(slotting.trials) == 5 and slotting.left_out == () and slotting.warnings == ()
    tool = slotting.tool
    assert (tool.kind, tool.teeth, tool.diameter_m) == ("end_mill", 2, 0.025)
    assert np.rad2deg(tool.helix_rad) == pytest.approx(45.0)
    sensor = slotting.sensor
    assert (sensor.sample_rate_hz, sensor.zeroed, sensor.anti_alias, sensor.units) == (
        1e4,
        "trial",
        None,
        "SI",
    )
    assert "never redistribute" in slotting.licence and "3fda341" in slotting.source
    for feed, trial in zip(FEEDS_MM_MIN, slotting.trials, strict=True):
        assert trial.feed_speed_m_s == pytest.approx(feed / 60_000)
        assert (trial.spindle_speed_rev_s, trial.milling, trial.kind) == (100.0, "slot", "cut")
        assert (trial.radial_depth_m, trial.axial_width_m) == (0.025, 0.003)
        assert trial.samples == 10_001 and trial.time_s[0] == 0.0
        assert trial.time_s[-1] == pytest.approx(1.0)
        assert trial.force_n.shape == (10_001, 3)


def test_slotting_signs_and_axes(slotting, measured_data):
    """On the tool, mean Fx and Fz are negative and mean Fy positive in a full slot, all growing with feed."""
    means = np.array([trial.force_n.mean(axis=0) for trial in slotting.trials])
    assert (means[:, 0] < 0).all() and (means[:, 1] > 0).all() and (means[:, 2] < 0).all()
    assert (np.diff(np.abs(means[:, :2]), axis=0) > 0).all()
    assert slotting.axes == AXES
    raw = np.loadtxt(measured_data / "slotting" / "6-n6000f300ap3ae25.csv", delimiter=",", skiprows=20)
    np.testing.assert_array_equal(
        slotting.trials[0].force_n, np.stack([raw[:, 2], raw[:, 1], -raw[:, 3]], axis=-1)
    )


def test_slotting_mean_forces_give_the_published_coefficients(slotting):
    """Mean-force fit over the five feeds: K_tc 958.9, K_te 15.76, K_rc 250.9, K_re 19.43, K_ac 146.4, K_ae
    18.2.
    """
    width_mm, teeth = 3.0, 2
    chip_mm = np.array(
        [trial.feed_speed_m_s / (teeth * trial.spindle_speed_rev_s) * 1e3 for trial in slotting.trials]
    )
    means = np.array([trial.force_n.mean(axis=0) for trial in slotting.trials])
    line = np.stack([chip_mm, np.ones_like(chip_mm)], axis=-1)
    (slope, intercept), *_ = np.linalg.lstsq(line, means, rcond=None)
    quarter, turn = teeth * width_mm / 4, teeth * width_mm / np.pi
    assert slope[1] / quarter == pytest.approx(958.9, abs=0.5)
    assert intercept[1] / turn == pytest.approx(15.76, abs=0.05)
    assert -slope[0] / quarter == pytest.approx(250.9, abs=0.5)
    assert -intercept[0] / turn == pytest.approx(19.43, abs=0.05)
    assert -slope[2] / turn == pytest.approx(146.4, abs=0.5)
    assert -intercept[2] / (teeth * width_mm / 2) == pytest.approx(18.2, abs=0.1)


def test_slotting_turns_the_way_the_process_frame_says(slotting):
    """The line at tooth passing along x lags the one along y by a quarter of its period.

    One of the two teeth is always in the slot, with chip c sin th: along x it gives
    (b c/2)(-K_t sin 2th + K_r cos 2th), along y (b c/2)(-K_t cos 2th - K_r sin 2th), whose complex
    amplitudes at exp(2 i th) have the ratio 1/i. Mirrored axes would give i.
    """
    for trial in slotting.trials:
        turn = np.exp(-2j * np.pi * 200.0 * trial.time_s[:10_000])
        x, y = (turn @ trial.force_n[:10_000, axis] for axis in (0, 1))
        assert np.angle(x / y) == pytest.approx(-np.pi / 2, abs=0.4)


def test_slotting_survives_the_dataset_format(slotting, tmp_path):
    write(slotting, tmp_path / "out")
    back = read(tmp_path / "out")
    assert back.licence == slotting.licence and back.source == slotting.source and back.warnings == ()
    for one, other in zip(slotting.trials, back.trials, strict=True):
        np.testing.assert_array_equal(one.force_n, other.force_n)
        np.testing.assert_array_equal(one.time_s, other.time_s)


def test_drilling_holes(drilling):
    assert len(drilling.trials) == 333
    (stub,) = drilling.left_out
    assert stub.file == "d14h45.csv" and "broken stub" in stub.reason and "uint8" in stub.reason
    holes: dict[str, int] = {}
    for trial in drilling.trials:
        holes[trial.tool_id] = holes.get(trial.tool_id, 0) + 1
    counts = {
        1: 21,
        2: 20,
        3: 20,
        4: 16,
        5: 19,
        6: 18,
        7: 21,
        8: 19,
        9: 23,
        10: 23,
        11: 23,
        12: 21,
        13: 45,
        14: 44,
    }
    assert holes == {f"d{drill}": count for drill, count in counts.items()}
    assert sum(counts.values()) + 1 == 334


def test_drilling_conditions(drilling):
    assert drilling.sensor.units == "arbitrary" and drilling.sensor.sample_rate_hz == 250.0
    assert (drilling.tool.kind, drilling.tool.teeth) == ("drill", 2)
    assert any("250 Hz" in warning for warning in drilling.warnings)
    assert any("diameter_m" in warning for warning in drilling.warnings)
    by_file = {trial.file: trial for trial in drilling.trials}
    assert by_file["d1h1.csv"].cut_length_before_m == 0.0
    assert by_file["d3h8.csv"].cut_length_before_m == pytest.approx(7 * HOLE_DEPTH_M)
    assert pytest.approx(6.35e-3) == HOLE_DEPTH_M
    assert by_file["d1h1.csv"].spindle_speed_rev_s == pytest.approx(800 / 60)
    assert by_file["d1h1.csv"].feed_speed_m_s == pytest.approx(1.905e-3)


def test_drilling_starts_at_contact(drilling, measured_data):
    import scipy.io

    raw = scipy.io.loadmat(measured_data / "drilling" / "dbhole.mat")["d1h1"]
    trial = drilling.trials[0]
    assert (raw[:2] == 0).all() and trial.samples == len(raw) - 2
    np.testing.assert_array_equal(trial.force_n[:, 2], raw[2:, 0])
    np.testing.assert_array_equal(trial.torque_nm, raw[2:, 1])
    assert np.isnan(trial.force_n[:, :2]).all()
    for one in drilling.trials:
        assert np.any(one.signals[0] != 0) and one.time_s[0] == 0.0


def test_drilling_wear_is_in_the_record(drilling):
    """Mean thrust grows with holes drilled, for nearly every drill: the effect the set is known for."""
    slopes = []
    for drill in range(1, 15):
        trials = [trial for trial in drilling.trials if trial.tool_id == f"d{drill}"][:-1]
        length = [trial.cut_length_before_m for trial in trials]
        slopes.append(np.polyfit(length, [trial.signals[:, 0].mean() for trial in trials], 1)[0])
    assert np.mean(np.array(slopes) > 0) > 0.8


def test_drilling_survives_the_dataset_format(drilling, tmp_path):
    write(drilling, tmp_path / "out")
    back = read(tmp_path / "out")
    assert len(back.trials) == 333 and back.sensor == drilling.sensor
    np.testing.assert_array_equal(back.trials[100].torque_nm, drilling.trials[100].torque_nm)


@pytest.mark.parametrize("name", ["slotting", "drilling"])
def test_resolve_by_name(name, measured_data, monkeypatch):
    monkeypatch.setenv("MJX_CUTTING_DATA", str(measured_data))
    assert resolve(name).name == name
