"""MCAP recordings with WrenchStamped and PoseStamped messages, written by the public writer."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from mjx_cutting.trials import commands
from mjx_cutting.trials.importers.mcap import import_mcap

HEADER = """std_msgs/Header header
"""
STAMP = """================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
VECTOR = """================================================================================
MSG: geometry_msgs/{name}
float64 x
float64 y
float64 z
"""
WRENCH = (
    HEADER
    + "geometry_msgs/Wrench wrench\n"
    + STAMP
    + "=" * 80
    + "\nMSG: geometry_msgs/Wrench\ngeometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n"
    + VECTOR.format(name="Vector3")
)
POSE = (
    HEADER
    + "geometry_msgs/Pose pose\n"
    + STAMP
    + "=" * 80
    + "\nMSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"
    + VECTOR.format(name="Point")
    + VECTOR.format(name="Quaternion")
    + "float64 w\n"
)
SIDE = {
    "tool": {"kind": "slitting_saw", "teeth": 20, "diameter_m": 0.05},
    "sensor": {"sample_rate_hz": 500.0},
    "defaults": {
        "milling": "conventional",
        "spindle_speed_rev_s": 19.0,
        "feed_speed_m_s": 0.0125,
        "radial_depth_m": 0.001,
        "axial_width_m": 0.0016,
    },
}
START_S = 1_700_000_000


def force_at(t: np.ndarray) -> np.ndarray:
    return np.stack([10 * np.sin(2 * np.pi * t), 20 + 5 * t, -3 * np.cos(2 * np.pi * 2 * t)], axis=-1)


def record(
    path: Path,
    *,
    seconds: float = 2.0,
    rate_hz: float = 500.0,
    jitter_s: float = 0.0,
    drop: slice | None = None,
    pose_seconds: float | None = None,
    topics: tuple[str, ...] = ("/ft/wrench",),
) -> None:
    from mcap_ros2.writer import Writer

    rng = np.random.default_rng(0)
    times = np.arange(round(seconds * rate_hz)) / rate_hz
    times = times + np.concatenate([[0.0], rng.uniform(-jitter_s, jitter_s, len(times) - 2), [0.0]])
    if drop is not None:
        times = np.delete(times, drop)
    with path.open("wb") as file:
        writer = Writer(file)
        wrench = writer.register_msgdef("geometry_msgs/msg/WrenchStamped", WRENCH)
        pose = writer.register_msgdef("geometry_msgs/msg/PoseStamped", POSE)
        for t, force in zip(times, force_at(times), strict=True):
            for topic in topics:
                message = {
                    "header": header(t),
                    "wrench": {"force": xyz(force), "torque": {"x": 0.0, "y": 0.0, "z": 1 + t}},
                }
                writer.write_message(topic, wrench, message, log_time=round((START_S + t) * 1e9))
        for t in np.arange(0.0, pose_seconds or 0.0, 0.01):
            upright = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
            position = {"position": xyz((0.1, 0.0125 * t, 0.0)), "orientation": upright}
            writer.write_message("/pose", pose, {"header": header(t), "pose": position}, log_time=0)
        writer.finish()


def header(t: float) -> dict:
    nanoseconds = round(t * 1e9)
    stamp = {"sec": START_S + nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}
    return {"stamp": stamp, "frame_id": "tool"}


def xyz(values) -> dict:
    return dict(zip("xyz", map(float, values), strict=True))


def test_force_and_position_arrive_on_an_even_grid(tmp_path):
    record(tmp_path / "run.mcap", pose_seconds=2.2)
    dataset = import_mcap(tmp_path / "run.mcap", conditions=SIDE)
    (trial,) = dataset.trials
    assert trial.file == "run.parquet" and trial.samples == 1000
    np.testing.assert_allclose(trial.time_s, np.arange(1000) / 500.0, atol=1e-12)
    np.testing.assert_allclose(trial.force_n, force_at(trial.time_s), atol=1e-5)
    np.testing.assert_allclose(trial.position_m[:, 1], 0.0125 * trial.time_s, atol=1e-6)
    assert dataset.warnings == ()


def test_jitter_is_interpolated(tmp_path):
    record(tmp_path / "run.mcap", jitter_s=5e-4)
    (trial,) = import_mcap(tmp_path / "run.mcap", conditions=SIDE | {"axes": ["+x", "-y", "+z"]}).trials
    np.testing.assert_allclose(trial.force_n * [1, -1, 1], force_at(trial.time_s), atol=5e-3)
    assert trial.position_m is None


def test_a_drill_takes_thrust_and_torque(tmp_path):
    record(tmp_path / "run.mcap")
    side = SIDE | {"tool": {"kind": "drill", "teeth": 2, "diameter_m": 0.006}}
    side["defaults"] = {"spindle_speed_rev_s": 20.0, "feed_speed_m_s": 0.002}
    (trial,) = import_mcap(tmp_path / "run.mcap", conditions=side).trials
    np.testing.assert_allclose(trial.torque_nm, 1 + trial.time_s, atol=1e-6)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"drop": slice(300, 330)}, ["messages a second", "without losses"]),
        ({"seconds": 20.0, "drop": slice(300, 330)}, ["gap of 0.062 s", "at 0.598 s"]),
        ({"rate_hz": 400.0}, ["got 400 messages a second", "sensor.sample_rate_hz = 500"]),
        ({"topics": ()}, ["expected one of type WrenchStamped"]),
        ({"topics": ("/a", "/b")}, ["WrenchStamped on /a, /b", "expected one topic"]),
    ],
)
def test_faults_leave_the_recording_out(tmp_path, options, words):
    record(tmp_path / "run.mcap", **options)
    record(tmp_path / "sound.mcap")
    dataset = import_mcap(tmp_path, conditions=SIDE)
    assert [trial.file for trial in dataset.trials] == ["sound.parquet"]
    for word in words:
        assert word in dataset.left_out[0].reason


def test_topics_by_name(tmp_path):
    record(tmp_path / "run.mcap", topics=("/a", "/b"))
    assert len(import_mcap(tmp_path, conditions=SIDE, wrench_topic="/b").trials) == 1
    with pytest.raises(ValueError, match="expected /c of type WrenchStamped"):
        import_mcap(tmp_path, conditions=SIDE, wrench_topic="/c")


def test_poses_that_end_early_are_not_used(tmp_path):
    record(tmp_path / "run.mcap", pose_seconds=1.0)
    dataset = import_mcap(tmp_path, conditions=SIDE)
    assert dataset.trials[0].position_m is None
    assert "poses that do not cover" in dataset.warnings[0]


@pytest.mark.parametrize("content", [b"", b"not an mcap file at all, by far", None])
def test_a_broken_file(tmp_path, content):
    record(tmp_path / "run.mcap")
    whole = (tmp_path / "run.mcap").read_bytes()
    (tmp_path / "run.mcap").write_bytes(whole[: len(whole) // 2] if content is None else content)
    with pytest.raises(ValueError, match=r"run\.mcap: got (a file that cannot|an MCAP file without)"):
        import_mcap(tmp_path, conditions=SIDE)


def test_without_the_extra(tmp_path, monkeypatch):
    record(tmp_path / "run.mcap")
    monkeypatch.setitem(sys.modules, "mcap_ros2", None)
    monkeypatch.setitem(sys.modules, "mcap_ros2.decoder", None)
    with pytest.raises(ImportError, match=r"pip install 'mjx-cutting\[mcap\]'"):
        import_mcap(tmp_path, conditions=SIDE)
    with pytest.raises(ValueError, match=r"pip install 'mjx-cutting\[mcap\]'"):
        commands.import_("mcap", tmp_path, tmp_path / "out")


def test_the_command_writes_a_dataset_folder(tmp_path):
    record(tmp_path / "run.mcap")
    status = commands.import_(
        "mcap",
        tmp_path / "run.mcap",
        tmp_path / "out",
        file_format="parquet",
        tool_kind="slitting_saw",
        teeth=20,
        diameter_m=0.05,
        milling="conventional",
        spindle_speed_rev_s=19.0,
        feed_speed_m_s=0.0125,
        radial_depth_m=0.001,
        axial_width_m=0.0016,
        sample_rate_hz=500.0,
    )
    assert status == 0 and commands.check(tmp_path / "out") == 0
