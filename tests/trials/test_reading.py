"""Reading a folder: columns, files that cannot be read, axes, speed. Each fault is named and the other trials
go on.
"""

from __future__ import annotations

import time

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from mjx_cutting.trials import read


def reason(dataset, file: str = "t1.csv") -> str:
    assert [trial.file for trial in dataset.trials] == ["t0.csv"]
    (left,) = dataset.left_out
    assert left.file == file
    assert "got" in left.reason and "expected" in left.reason and ";" in left.reason
    return left.reason


def test_values_arrive_exactly(folder, mill_record):
    dataset = read(folder.write())
    given = mill_record(0)
    trial = dataset.trials[0]
    np.testing.assert_array_equal(trial.time_s, given["time_s"])
    for index, axis in enumerate("xyz"):
        np.testing.assert_array_equal(trial.force_n[:, index], given[f"force_{axis}_n"])
    assert trial.position_m is None and trial.spindle_angle_rad is None and trial.torque_nm is None


def test_axes_put_columns_into_process_axes(folder, mill_record):
    folder.document["axes"] = ["+y", "+x", "-z"]
    dataset = read(folder.write())
    given = mill_record(0)
    force = dataset.trials[0].force_n
    np.testing.assert_array_equal(force[:, 1], given["force_x_n"])
    np.testing.assert_array_equal(force[:, 0], given["force_y_n"])
    np.testing.assert_array_equal(force[:, 2], -given["force_z_n"])
    assert dataset.axes == ("+y", "+x", "-z")


def test_optional_columns(folder):
    columns = folder.columns("t0.csv")
    t = columns["time_s"]
    columns |= {
        "position_x_m": 0.01 * t,
        "position_y_m": 0.02 * t,
        "position_z_m": 0.03 * t,
        "spindle_angle_rad": 2 * np.pi * 21 * t,
        "spindle_speed_rev_s": np.full_like(t, 21.1),
        "feed_speed_m_s": np.full_like(t, 0.0022),
    }
    dataset = read(folder.write())
    trial = dataset.trials[0]
    np.testing.assert_array_equal(trial.position_m, np.stack([0.01 * t, 0.02 * t, 0.03 * t], axis=-1))
    np.testing.assert_array_equal(trial.spindle_angle_rad, 2 * np.pi * 21 * t)
    np.testing.assert_array_equal(trial.spindle_speed_measured_rev_s, np.full_like(t, 21.1))
    np.testing.assert_array_equal(trial.feed_speed_measured_m_s, np.full_like(t, 0.0022))
    assert trial.spindle_speed_rev_s == 21.0
    assert dataset.warnings == ()


def test_unknown_columns_are_named_and_ignored_even_when_they_hold_text(folder):
    columns = folder.columns("t0.csv")
    lines = ["note," + ",".join(columns) + ",temperature_c"]
    lines += [
        f"ok {i}," + ",".join(map(repr, map(float, row))) + ",20"
        for i, row in enumerate(zip(*columns.values(), strict=True))
    ]
    folder.records["t0.csv"] = "\n".join(lines)
    dataset = read(folder.write())
    assert len(dataset.trials) == 2
    assert dataset.warnings == ("t0.csv: unknown columns note, temperature_c, ignored.",)
    np.testing.assert_array_equal(dataset.trials[0].force_n[:, 0], columns["force_x_n"])


def test_columns_in_another_order_with_spaces_quotes_and_a_byte_order_mark(folder):
    columns = folder.columns("t0.csv")
    names = ["force_z_n", "time_s", "force_x_n", "force_y_n"]
    head = '\ufeff"force_z_n", time_s ,force_x_n,force_y_n\r\n'
    rows = "\r\n".join(",".join(repr(float(columns[n][i])) for n in names) for i in range(1000))
    folder.records["t0.csv"] = None
    path = folder.write()
    (path / "t0.csv").write_bytes((head + rows).encode())
    trial = read(path).trials[0]
    np.testing.assert_array_equal(trial.force_n[:, 2], columns["force_z_n"])
    np.testing.assert_array_equal(trial.time_s, columns["time_s"])


@pytest.mark.parametrize("column", ["time_s", "force_x_n", "force_y_n", "force_z_n"])
def test_a_missing_column(folder, column):
    del folder.columns()[column]
    told = reason(read(folder.write()))
    assert f"expected also {column}" in told and "rename" in told


def test_a_drill_needs_torque(folder, drill_record):
    folder.document["tool"] |= {"kind": "drill"}
    folder.records = {"t0.csv": drill_record(0), "t1.csv": drill_record(1)}
    del folder.columns()["torque_z_nm"]
    dataset = read(folder.write())
    assert "expected also torque_z_nm" in reason(dataset)
    trial = dataset.trials[0]
    np.testing.assert_array_equal(trial.torque_nm, drill_record(0)["torque_z_nm"])
    np.testing.assert_array_equal(trial.force_n[:, 2], drill_record(0)["force_z_n"])
    assert np.isnan(trial.force_n[:, :2]).all()
    np.testing.assert_array_equal(trial.signals[:, 1], trial.torque_nm)
    assert trial.milling is None


def test_a_drill_whose_thrust_column_points_the_other_way(folder, drill_record):
    folder.document["tool"] |= {"kind": "drill"}
    folder.document["axes"] = ["+x", "+y", "-z"]
    folder.records = {"t0.csv": drill_record(0), "t1.csv": drill_record(1)}
    trial = read(folder.write()).trials[0]
    np.testing.assert_array_equal(trial.force_n[:, 2], -drill_record(0)["force_z_n"])


@pytest.mark.parametrize("mark", [";", "\t"])
def test_other_separators_are_told(folder, mark):
    columns = folder.columns()
    folder.records["t1.csv"] = mark.join(columns) + "\n" + mark.join("1,5" for _ in columns) + "\n"
    told = reason(read(folder.write()))
    assert "separate the columns by commas" in told


def test_text_among_the_numbers(folder):
    folder.records["t1.csv"] = "time_s,force_x_n,force_y_n,force_z_n\n0.0,1,2,3\n0.001,1,oops,3\n"
    assert "oops" in reason(read(folder.write()))


def test_a_ragged_row(folder):
    folder.records["t1.csv"] = "time_s,force_x_n,force_y_n,force_z_n\n0.0,1,2,3\n0.001,1,2\n"
    assert "not a table of numbers" in reason(read(folder.write()))


@pytest.mark.parametrize("text", ["", "time_s,force_x_n,force_y_n,force_z_n\n"])
def test_an_empty_file(folder, text):
    folder.records["t1.csv"] = text
    reason(read(folder.write()))


def test_a_column_twice(folder):
    folder.records["t1.csv"] = "time_s,force_x_n,force_y_n,force_z_n,force_x_n\n0.0,1,2,3,1\n"
    assert "column force_x_n twice" in reason(read(folder.write()))


def test_a_missing_file(folder):
    folder.records["t1.csv"] = None
    assert "no such file" in reason(read(folder.write()))


@pytest.mark.parametrize("name", ["../t0.csv", "/etc/passwd.csv", "a/../../t0.csv"])
def test_a_file_outside_the_folder(folder, name):
    folder.entry()["file"] = name
    assert "leaves the dataset folder" in reason(read(folder.write()), name)


def test_another_suffix(folder):
    folder.entry()["file"] = "t1.xlsx"
    assert ".csv or .parquet" in reason(read(folder.write()), "t1.xlsx")


def test_a_file_in_a_subfolder(folder):
    folder.entry(0)["file"] = "day1/t0.csv"
    path = folder.write()
    (path / "day1").mkdir()
    (path / "t0.csv").rename(path / "day1" / "t0.csv")
    assert read(path).trials[0].file == "day1/t0.csv"


def test_parquet_of_any_number_type(folder, mill_record):
    columns = mill_record(5)
    path = folder.write()
    table = pa.table(
        {name: values.astype(np.float32) if name != "time_s" else values for name, values in columns.items()}
    )
    pq.write_table(table.append_column("note", pa.array(["x"] * 1000)), path / "t1.parquet")
    folder.entry()["file"] = "t1.parquet"
    dataset = read(folder.write())
    np.testing.assert_array_equal(
        dataset.trials[1].force_n[:, 0], columns["force_x_n"].astype(np.float32).astype(float)
    )
    assert dataset.warnings == ("t1.parquet: unknown columns note, ignored.",)


def test_parquet_without_its_footer(folder, mill_record):
    path = folder.write()
    pq.write_table(pa.table(mill_record(1)), path / "t1.parquet")
    whole = (path / "t1.parquet").read_bytes()
    (path / "t1.parquet").write_bytes(whole[: len(whole) // 2])
    folder.entry()["file"] = "t1.parquet"
    assert "not whole Parquet" in reason(read(folder.write()), "t1.parquet")


def test_parquet_with_text_in_a_force_column(folder):
    path = folder.write()
    table = {"time_s": [0.0], "force_x_n": ["a"], "force_y_n": [0.0], "force_z_n": [0.0]}
    pq.write_table(pa.table(table), path / "t1.parquet")
    folder.entry()["file"] = "t1.parquet"
    assert "column force_x_n of type string" in reason(read(folder.write()), "t1.parquet")


def test_an_axis_without_position_stands_still_and_a_broken_optional_column_is_not_used(folder):
    columns = folder.columns("t0.csv")
    columns["position_y_m"] = columns["time_s"]
    columns["spindle_angle_rad"] = np.where(columns["time_s"] > 0.5, np.nan, 1.0)
    dataset = read(folder.write())
    trial = dataset.trials[0]
    assert trial.spindle_angle_rad is None
    np.testing.assert_array_equal(trial.position_m[:, 1], trial.time_s)
    assert not trial.position_m[:, [0, 2]].any()
    told = "\n".join(dataset.warnings)
    assert "position_x_m, position_z_m missing; taken as not moving" in told
    assert "column spindle_angle_rad: got values that are not finite" in told


def test_a_position_along_the_feed_alone_is_what_most_cuts_have(folder):
    columns = folder.columns("t0.csv")
    columns["position_x_m"] = 0.01 * columns["time_s"]
    dataset = read(folder.write())
    np.testing.assert_array_equal(dataset.trials[0].position_m[:, 0], 0.01 * dataset.trials[0].time_s)
    assert not any("position" in each for each in dataset.warnings)


def test_no_good_trial_left_is_an_error_that_lists_them(folder):
    for file in folder.records:
        folder.columns(file)["force_x_n"][3] = np.nan
    with pytest.raises(ValueError, match="no good trial") as caught:
        read(folder.write())
    for word in ("t0.csv", "t1.csv", "force_x_n", "not finite"):
        assert word in str(caught.value)


def test_trials_keep_their_order(make_folder):
    folder = make_folder(trials=9)
    folder.document["trials"].reverse()
    assert [trial.file for trial in read(folder.write()).trials] == [f"t{i}.csv" for i in range(8, -1, -1)]


def test_a_million_samples_read_in_seconds(make_folder, mill_record):
    """20 trials of 50,000 samples; a hundred of them have to take a few seconds."""
    folder = make_folder(trials=20)
    columns = mill_record(0, samples=50_000)
    folder.records = dict.fromkeys(folder.records, None)
    path = folder.write()
    pa_table = pa.table(columns)
    import pyarrow.csv as pc

    pc.write_csv(pa_table, path / "t0.csv")
    for index in range(1, 20):
        (path / f"t{index}.csv").write_bytes((path / "t0.csv").read_bytes())
    start = time.perf_counter()
    dataset = read(path)
    took_s = time.perf_counter() - start
    assert sum(trial.samples for trial in dataset.trials) == 1_000_000
    assert took_s < 10.0, "a hundred trials would take more than 50 s even on a busy machine"
