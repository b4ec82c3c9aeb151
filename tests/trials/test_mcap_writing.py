"""A dataset written as MCAP is read back by the importer, force for force."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mjx_cutting.trials import commands
from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo, Trial
from mjx_cutting.trials.importers.mcap import import_mcap
from mjx_cutting.trials.mcap_writing import write_mcap


def trial(file: str, start_s: float) -> Trial:
    time_s = np.arange(1000) / 500.0
    draw = np.random.default_rng(len(file))
    return Trial(
        file=file, kind="cut", milling="conventional", spindle_speed_rev_s=19.0, feed_speed_m_s=0.0125,
        radial_depth_m=0.001, axial_width_m=0.0016, material="foam", clock_start_s=start_s, time_s=time_s,
        force_n=draw.normal(0, 10, (1000, 3)), position_m=np.outer(time_s, [0.0, -0.0125, 0.001]),
    )  # fmt: skip


@pytest.fixture
def dataset() -> Dataset:
    return Dataset(
        name="two",
        tool=ToolInfo("slitting_saw", 20, 0.05),
        sensor=Sensor(500.0, noise_std_n=(0.1, 0.2, 0.3)),
        axes=("+z", "-x", "-y"),
        trials=(trial("a.parquet", 12.5), trial("second.csv", 100.25)),
    )


def test_what_is_written_is_imported(dataset: Dataset, tmp_path: Path) -> None:
    back = import_mcap(write_mcap(dataset, tmp_path / "mcap"))
    assert [t.file for t in back.trials] == ["a.parquet", "second.parquet"]
    for was, now in zip(dataset.trials, back.trials, strict=True):
        np.testing.assert_allclose(now.force_n, was.force_n, rtol=0, atol=1e-5)
        np.testing.assert_allclose(now.position_m, was.position_m, atol=1e-9)
        assert replace(now, file=was.file, time_s=was.time_s).material == "foam"
        assert (now.clock_start_s, now.spindle_speed_rev_s) == (was.clock_start_s, was.spindle_speed_rev_s)
    assert back.sensor == dataset.sensor and back.tool == dataset.tool


def test_messages_are_what_foxglove_expects(dataset: Dataset, tmp_path: Path) -> None:
    from mcap.reader import make_reader

    write_mcap(dataset, tmp_path / "mcap")
    with (tmp_path / "mcap" / "a.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None and summary.statistics is not None
    schemas = {s.id: (s.name, s.encoding) for s in summary.schemas.values()}
    channels = {c.topic: (schemas[c.schema_id], c.message_encoding) for c in summary.channels.values()}
    assert channels == {
        "/force": (("geometry_msgs/msg/WrenchStamped", "ros2msg"), "cdr"),
        "/pose": (("geometry_msgs/msg/PoseStamped", "ros2msg"), "cdr"),
    }
    assert summary.statistics.message_count == 2000
    assert summary.statistics.message_start_time == 12_500_000_000


def test_the_verb_writes_a_folder(dataset: Dataset, tmp_path: Path) -> None:
    from mjx_cutting.trials.writing import write

    write(dataset, tmp_path / "set")
    assert commands.write_as_mcap(tmp_path / "set", tmp_path / "mcap") == 0
    assert sorted(p.name for p in (tmp_path / "mcap").iterdir()) == [
        "a.mcap",
        "conditions.json",
        "second.mcap",
    ]
