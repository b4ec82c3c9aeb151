"""Writing: what goes out comes back the same, and nothing is half written."""

from __future__ import annotations

import json
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mjx_cutting.trials import AntiAlias, Dataset, Sensor, ToolInfo, Trial, read, write
from mjx_cutting.trials.records import read_columns, write_columns

AXES = [None, ("+y", "+x", "-z"), ("-z", "+x", "+y"), ("-x", "-y", "+z")]


def dataset_of(suffix: str, axes=None, *, drill: bool = False) -> Dataset:
    rng = np.random.default_rng(3)
    samples = 600
    t = np.arange(samples) / 1000 + 7.0
    trials = []
    for index in range(3):
        force = rng.normal(size=(samples, 3)) * 10.0 ** rng.integers(-3, 4, size=(samples, 3))
        if drill:
            force[:, :2] = np.nan
        trials.append(
            Trial(
                file=f"sub/t{index}.{suffix}",
                kind="air" if index == 2 else "cut",
                milling=None if drill else "climb",
                spindle_speed_rev_s=20.1,
                feed_speed_m_s=1 / 300,
                radial_depth_m=0.001 / 3,
                axial_width_m=0.002,
                material=None if index else "Aluminium 6061, größer",
                tool_id="b",
                cut_length_before_m=0.1 * index,
                clock_start_s=-3.5 + index,
                time_s=t,
                force_n=force,
                torque_nm=rng.normal(size=samples) if drill else None,
                position_m=rng.normal(size=(samples, 3)) if index == 0 else None,
                spindle_angle_rad=2 * np.pi * 20.1 * t if index == 1 else None,
                spindle_speed_measured_rev_s=20.1 + 0.01 * rng.normal(size=samples) if index == 1 else None,
                feed_speed_measured_m_s=rng.normal(size=samples) if index == 0 else None,
            )
        )
    return Dataset(
        name="round trip",
        source="a test",
        licence=None,
        tool=ToolInfo("drill" if drill else "slitting_saw", 20, 0.05, 0.1),
        sensor=Sensor(
            1000.0, (0.1, 0.2, 0.3), "session", "arbitrary", AntiAlias("butterworth", 3, 150.0, True)
        ),
        axes=axes,
        trials=tuple(trials),
    )


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
@pytest.mark.parametrize("axes", AXES)
@pytest.mark.parametrize("drill", [False, True])
def test_round_trip_is_exact(tmp_path, suffix, axes, drill):
    if drill and axes is not None and axes[2][1] != "z":
        axes = ("+x", "+y", "-z")
    given_ = dataset_of(suffix, axes, drill=drill)
    assert write(given_, tmp_path / "out") == tmp_path / "out"
    back = read(tmp_path / "out")
    for name in ("name", "source", "licence", "tool", "sensor", "axes", "left_out"):
        assert getattr(back, name) == getattr(given_, name), name
    for one, other in zip(given_.trials, back.trials, strict=True):
        for field in fields(Trial):
            before, after = getattr(one, field.name), getattr(other, field.name)
            if isinstance(before, np.ndarray):
                np.testing.assert_array_equal(after, before, err_msg=field.name)
            else:
                assert after == before, field.name


def test_the_written_columns_are_the_sensors_own(tmp_path):
    made = dataset_of("csv", ("+y", "+x", "-z"))
    write(made, tmp_path / "out")
    columns, unknown = read_columns(tmp_path / "out" / "sub" / "t0.csv", ())
    np.testing.assert_array_equal(columns["force_x_n"], made.trials[0].force_n[:, 1])
    np.testing.assert_array_equal(columns["force_z_n"], -made.trials[0].force_n[:, 2])
    assert unknown == []
    document = json.loads((tmp_path / "out" / "dataset.json").read_text(encoding="utf-8"))
    assert document["axes"] == ["+y", "+x", "-z"]
    # Noise is given by column in the file and by process axis in memory.
    assert document["sensor"]["noise_std_n"] == [0.2, 0.1, 0.3]


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(values=st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=20))
def test_csv_keeps_every_float64(tmp_path, values):
    path = tmp_path / "c.csv"
    write_columns(path, {"time_s": np.array(values)})
    columns, _ = read_columns(path, ("time_s",))
    np.testing.assert_array_equal(columns["time_s"], values)


def test_nothing_is_written_where_something_is(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("keep")
    with pytest.raises(FileExistsError):
        write(dataset_of("csv"), tmp_path / "out")
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["mine.txt"]


def test_a_failure_half_way_leaves_nothing(tmp_path, monkeypatch):
    import mjx_cutting.trials.writing as writing

    count = 0

    def full_disk(path, columns):
        nonlocal count
        count += 1
        if count == 3:
            raise OSError(28, "No space left on device", str(path))
        write_columns(path, columns)

    monkeypatch.setattr(writing, "write_columns", full_disk)
    with pytest.raises(OSError, match="No space left"):
        write(dataset_of("csv"), tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["t.txt", "../t.csv", "/tmp/t.csv"])
def test_file_names_that_do_not_fit(tmp_path, name):
    made = dataset_of("csv")
    with pytest.raises(ValueError, match="rename the trial"):
        write(replace(made, trials=(replace(made.trials[0], file=name),)), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_dataset_without_trials_is_not_written(tmp_path):
    with pytest.raises(ValueError, match="without trials"):
        write(replace(dataset_of("csv"), trials=()), tmp_path / "out")
