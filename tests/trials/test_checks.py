"""Every check of a trial: the defect is named, the trial left out (or warned of), the others go on."""

from __future__ import annotations

import numpy as np
import pytest

from mjx_cutting.trials import Dataset, Sensor, ToolInfo, Trial, read
from mjx_cutting.trials.checks import aliased_hz, check_trial, feed_per_tooth_m, sift, tooth_passing_hz

TOOL = ToolInfo("slitting_saw", 20, 0.05)


def saw_trial(rate_hz: float = 500.0, duration_s: float = 4.0, **changes: object) -> Trial:
    time_s = np.arange(round(rate_hz * duration_s)) / rate_hz
    rng = np.random.default_rng(1)
    arguments: dict[str, object] = {
        "file": "t.csv",
        "kind": "cut",
        "milling": "conventional",
        "spindle_speed_rev_s": 19.0,
        "feed_speed_m_s": 0.0125,
        "radial_depth_m": 0.001,
        "axial_width_m": 0.0016,
        "time_s": time_s,
        "force_n": rng.normal(size=(len(time_s), 3)),
    }
    return Trial(**(arguments | changes))  # type: ignore[arg-type]


def left_out(folder) -> str:
    dataset = read(folder.write())
    assert [trial.file for trial in dataset.trials] == ["t0.csv"]
    (left,) = dataset.left_out
    assert left.file == "t1.csv"
    assert "expected" in left.reason and "; " in left.reason
    return left.reason


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("column", ["time_s", "force_x_n", "force_y_n", "force_z_n"])
def test_values_that_are_not_finite(folder, column, value):
    folder.columns()[column][[17, 30]] = value
    told = left_out(folder)
    assert f"{column}: got 2 values that are not finite (first at sample 17)" in told


def test_not_finite_is_told_by_the_columns_own_name_whatever_the_axes(folder):
    folder.document["axes"] = ["+y", "+x", "-z"]
    folder.columns()["force_x_n"][5] = np.nan
    assert "force_x_n: got 1 values" in left_out(folder)


def test_empty_cells_are_not_numbers(folder):
    columns = folder.columns()
    rows = [",".join(columns)] + [
        ",".join(map(repr, map(float, row))) for row in zip(*columns.values(), strict=True)
    ]
    cells = rows[40].split(",")
    rows[40] = ",".join([cells[0], "", *cells[2:]])
    folder.records["t1.csv"] = "\n".join(rows)
    assert "force_x_n: got 1 values that are not finite (first at sample 39)" in left_out(folder)


def test_time_that_stands_still_or_runs_back(folder):
    folder.columns()["time_s"][100] = folder.columns()["time_s"][99]
    assert "time_s: got 0.099 s after 0.099 s (sample 100), expected increasing time" in left_out(folder)
    folder.columns()["time_s"][100] = 0.05
    assert "got 0.05 s after 0.099 s" in left_out(folder)


@pytest.mark.parametrize("defect", ["gap", "jitter", "two rates"])
def test_uneven_sampling(folder, defect):
    time_s = folder.columns()["time_s"]
    if defect == "gap":
        time_s[500:] += 0.001
    elif defect == "jitter":
        time_s += np.random.default_rng(0).uniform(-2e-4, 2e-4, len(time_s))
    else:
        time_s[600:] = time_s[600] + np.arange(400) * 0.002
    told = left_out(folder)
    assert "time_s: got a step of" in told and "expected even sampling within 0.0001 s" in told


@pytest.mark.parametrize("rate_hz", [300.0, 600.0, 3000.0, 1024.0])
def test_rounded_time_stamps_are_even(rate_hz):
    trial = saw_trial(rate_hz, time_s=np.round(np.arange(round(rate_hz * 4)) / rate_hz, 4))
    assert check_trial(trial, TOOL, Sensor(rate_hz)).reasons == ()


def test_time_that_starts_late_is_fine():
    trial = saw_trial(time_s=np.arange(2000) / 500.0 + 3600.0)
    assert check_trial(trial, TOOL, Sensor(500.0)).reasons == ()


def test_a_rate_that_contradicts_the_manifest(folder):
    folder.columns()["time_s"][:] = np.arange(1000) / 500.0
    told = left_out(folder)
    assert "time_s: got 500 samples a second, expected sensor.sample_rate_hz = 1000" in told


def test_too_few_revolutions(folder):
    folder.entry()["spindle_speed_rev_s"] = 1.5
    folder.entry()["feed_speed_m_s"] = 0.001
    assert "got 1.50 revolutions in 0.999 s, expected at least 2" in left_out(folder)


def test_two_revolutions_are_enough():
    trial = saw_trial(500.0, duration_s=2 / 19.0 + 0.004)
    assert check_trial(trial, TOOL, Sensor(500.0)).reasons == ()


def test_too_few_samples(folder):
    folder.records["t1.csv"] = {name: values[:5] for name, values in folder.columns().items()}
    assert "got 5 samples, expected at least 8" in left_out(folder)


@pytest.mark.parametrize("column", ["force_x_n", "force_y_n", "force_z_n"])
@pytest.mark.parametrize("sign", [1, -1])
def test_saturation(folder, column, sign):
    values = folder.columns()[column]
    limit = 0.8 * np.abs(values).max()
    values[:] = np.minimum(values, limit) if sign > 0 else np.maximum(values, -limit)
    told = left_out(folder)
    assert (
        f"{column}: got saturation" in told
        and f"at exactly {sign * limit:g}" in told
        and "larger range" in told
    )


def test_a_channel_that_hangs(folder):
    folder.columns()["force_y_n"][600:900] = 0.0
    told = left_out(folder)
    assert "force_y_n: got 0 in 300 samples in a row (from 0.6 s) while another channel went on" in told


def test_a_channel_that_hangs_in_the_air_is_no_matter(folder):
    folder.entry()["kind"] = "air"
    folder.columns()["force_y_n"][600:900] = 0.0
    assert read(folder.write()).left_out == ()


@pytest.mark.parametrize(
    ("feed_m_s", "shown"), [(126.0, "3e+06 um"), (0.126, "3e+03 um"), (1e-8, "0.000238 um")]
)
def test_an_implausible_feed_per_tooth(folder, feed_m_s, shown):
    folder.entry()["feed_speed_m_s"] = feed_m_s
    told = left_out(folder)
    assert f"feed per tooth: got {shown}" in told and "mm/min divided by 60000" in told


def test_a_depth_beyond_the_diameter(folder):
    folder.entry()["radial_depth_m"] = 1.0
    assert "radial_depth_m: got 1 m, expected at most the diameter 0.025 m" in left_out(folder)


def test_a_width_in_millimetres(folder):
    folder.entry()["axial_width_m"] = 3.0
    assert "axial_width_m: got 3 m" in left_out(folder)


def test_all_reasons_are_told_at_once(folder):
    folder.entry()["radial_depth_m"] = 1.0
    folder.columns()["time_s"][500:] += 0.003
    told = left_out(folder)
    assert "radial_depth_m" in told and "even sampling" in told


def test_a_slot_with_another_depth_is_warned_of(folder):
    folder.entry()["milling"] = "slot"
    dataset = read(folder.write())
    assert len(dataset.trials) == 2
    assert any("t1.csv: radial_depth_m: got 0.001 m for a slot" in warning for warning in dataset.warnings)


def test_rpm_given_as_revolutions_a_second_is_warned_of():
    verdict = check_trial(saw_trial(spindle_speed_rev_s=1140.0, feed_speed_m_s=0.0125), TOOL, Sensor(500.0))
    assert any(
        "a cutting speed of 179 m/s" in warning and "divide rpm by 60" in warning
        for warning in verdict.warnings
    )


def test_a_dead_channel_is_warned_of(folder):
    folder.columns()["force_z_n"][:] = 0.0
    dataset = read(folder.write())
    assert dataset.warnings == (
        "t1.csv: force_z_n: got 0 in every sample, expected a force that varies; check the cable and the "
        "channel.",
    )


@pytest.mark.parametrize(
    ("frequency_hz", "rate_hz", "seen_hz"),
    [(380, 500, 120), (500, 500, 0), (505, 500, 5), (200, 500, 200), (990, 500, 10)],
)
def test_where_a_line_is_seen(frequency_hz, rate_hz, seen_hz):
    assert aliased_hz(frequency_hz, rate_hz) == pytest.approx(seen_hz)


@pytest.mark.parametrize(
    ("speed_rev_s", "shown"),
    [
        (25.0, "tooth passing: got 500 Hz sampled at 500 Hz, which appears at 0 Hz"),
        (25.2, "tooth passing: got 504 Hz sampled at 500 Hz, which appears at 4 Hz"),
        (12.6, "harmonic 2 of tooth passing: got 504 Hz sampled at 500 Hz, which appears at 4 Hz"),
    ],
)
def test_tooth_passing_aliased_to_near_dc_is_warned_of(speed_rev_s, shown):
    verdict = check_trial(saw_trial(spindle_speed_rev_s=speed_rev_s), TOOL, Sensor(500.0))
    assert verdict.reasons == ()
    (warning,) = verdict.warnings
    assert shown in warning and "Change the speed" in warning


@pytest.mark.parametrize("speed_rev_s", [19.0, 10.0, 22.0])
def test_tooth_passing_elsewhere_is_not(speed_rev_s):
    assert check_trial(saw_trial(spindle_speed_rev_s=speed_rev_s), TOOL, Sensor(500.0)).warnings == ()


def test_aliasing_is_no_matter_behind_a_filter_in_air_or_in_turning():
    from mjx_cutting.trials import AntiAlias

    filtered = Sensor(500.0, anti_alias=AntiAlias("butterworth", 4, 100.0))
    weakly = Sensor(500.0, anti_alias=AntiAlias("butterworth", 1, 240.0))
    at_dc = saw_trial(spindle_speed_rev_s=25.0)
    assert check_trial(at_dc, TOOL, filtered).warnings == ()
    assert check_trial(at_dc, TOOL, weakly).warnings != ()
    assert check_trial(saw_trial(spindle_speed_rev_s=25.0, kind="air"), TOOL, Sensor(500.0)).warnings == ()
    lathe = ToolInfo("turning", 1, 0.05)
    turned = saw_trial(spindle_speed_rev_s=25.0, milling=None, feed_speed_m_s=0.002)
    assert check_trial(turned, lathe, Sensor(500.0)).warnings == ()


def test_a_short_record_cannot_average_a_slow_alias():
    """20 Hz over 0.08 s is less than two cycles, so it is near DC there and not in a long record."""
    slow = {"spindle_speed_rev_s": 26.0}
    assert check_trial(saw_trial(duration_s=4.0, **slow), TOOL, Sensor(500.0)).warnings == ()
    assert (
        "appears at 20 Hz" in check_trial(saw_trial(duration_s=0.08, **slow), TOOL, Sensor(500.0)).warnings[0]
    )


@pytest.mark.parametrize(("column", "factor"), [("spindle_speed_rev_s", 60.0), ("spindle_angle_rad", 1 / 60)])
def test_a_measured_speed_that_contradicts_the_nominal_is_warned_of(folder, column, factor):
    columns = folder.columns()
    time_s = columns["time_s"]
    sound = np.full_like(time_s, 21.0) if column == "spindle_speed_rev_s" else 2 * np.pi * 21.0 * time_s
    columns[column] = sound
    assert read(folder.write()).warnings == ()
    columns[column] = sound * factor
    (warning,) = read(folder.write()).warnings
    assert f"t1.csv: column {column}: got" in warning and "nominal 21" in warning


def test_a_wrapped_angle_is_fine(folder):
    columns = folder.columns()
    columns["spindle_angle_rad"] = np.mod(2 * np.pi * 21.0 * columns["time_s"], 2 * np.pi)
    assert read(folder.write()).warnings == ()


def test_a_mill_made_in_memory_needs_its_milling():
    verdict = check_trial(saw_trial(milling=None), TOOL, Sensor(500.0))
    assert "milling: got null" in verdict.reasons[0]


def test_conditions_of_a_cut_made_in_memory():
    verdict = check_trial(saw_trial(radial_depth_m=0.0, feed_speed_m_s=0.0), TOOL, Sensor(500.0))
    assert [reason.split(":")[0] for reason in verdict.reasons] == ["feed_speed_m_s", "radial_depth_m"]
    assert (
        check_trial(
            saw_trial(radial_depth_m=0.0, feed_speed_m_s=0.0, kind="air"), TOOL, Sensor(500.0)
        ).reasons
        == ()
    )


def test_sift_checks_trials_made_in_memory():
    good, bad = saw_trial(), saw_trial(file="bad.csv", radial_depth_m=0.06)
    dataset = sift(
        Dataset(name="d", tool=TOOL, sensor=Sensor(500.0), trials=(good, bad), warnings=("as before",))
    )
    assert dataset.trials == (good,)
    assert dataset.left_out[0].file == "bad.csv"
    assert dataset.warnings == ("as before",)
    with pytest.raises(ValueError, match="no good trial"):
        sift(Dataset(name="d", tool=TOOL, sensor=Sensor(500.0), trials=(bad,)))


def test_chip_and_passing():
    trial = saw_trial()
    assert tooth_passing_hz(trial, TOOL) == 380.0
    assert feed_per_tooth_m(trial, TOOL) == pytest.approx(32.9e-6, rel=1e-3)
