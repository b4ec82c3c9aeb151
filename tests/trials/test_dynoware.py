"""DynoWare exports: their dialects, their faults, and where the conditions come from."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mjx_cutting.trials.importers.conditions import conditions_from_name
from mjx_cutting.trials.importers.dynoware import import_dynoware, read_dynoware

SIDE = """
name = "mine"
source = "my machine"
licence = "private"
axes = ["+y", "+x", "-z"]

[tool]
kind = "end_mill"
teeth = 4
diameter_m = 0.010

[defaults]
milling = "climb"
spindle_speed_rev_s = 50.0
radial_depth_m = 0.002
axial_width_m = 0.003
material = "steel"

[[trials]]
file = "a.csv"
feed_speed_m_s = 0.010

[[trials]]
file = "b.csv"
feed_speed_m_s = 0.020
milling = "conventional"
"""


def export(
    path: Path,
    *,
    mark: str = ",",
    decimal: str = ".",
    units: str = "s,N,N,N",
    names: str = "Time,Fx,Fy,Fz",
    rate_hz: float = 1000.0,
    samples: int = 500,
    seed: int = 0,
    start_s: float = 3.0,
) -> np.ndarray:
    """Writes an export and returns its force columns [T, 3]."""
    force = np.round(np.random.default_rng(seed).normal(size=(samples, 3)) * 100, 3)
    time_s = start_s + np.arange(samples) / rate_hz
    head = [
        "DynoWare,Version 2.5.1.2",
        r"Path:,C:\data" + "\\",
        "Date:, ",
        "Time:, ",
        f"Sampling rate [Hz]:,{rate_hz:g}",
        "Cycle No:,1",
        names,
        units,
    ]
    rows = [",".join(f"{v:.10g}" for v in (t, *f)) for t, f in zip(time_s, force, strict=True)]
    text = "\n".join([*head, *rows]) + "\n"
    if mark != ",":
        text = text.replace(",", mark)
    if decimal != ".":
        lines = text.split("\n")
        text = "\n".join(lines[:8] + [line.replace(".", decimal) for line in lines[8:]])
    path.write_text(text)
    return force


def recordings(folder: Path) -> Path:
    folder.mkdir()
    export(folder / "a.csv", seed=1)
    export(folder / "b.csv", seed=2)
    (folder / "conditions.toml").write_text(SIDE)
    return folder


@pytest.mark.parametrize(("mark", "decimal"), [(",", "."), ("\t", "."), ("\t", ","), (";", ","), (";", ".")])
def test_dialects(tmp_path, mark, decimal):
    force = export(tmp_path / "a.txt", mark=mark, decimal=decimal)
    record = read_dynoware(tmp_path / "a.txt")
    assert record.sample_rate_hz == 1000.0
    assert record.header["DynoWare"] == "Version 2.5.1.2"
    np.testing.assert_array_equal(record.time_s, np.round(np.arange(500) / 1000, 9))
    for index, name in enumerate(("Fx", "Fy", "Fz")):
        np.testing.assert_array_equal(record.columns[name], force[:, index])


def test_units_become_si(tmp_path):
    force = export(tmp_path / "a.csv", units="s,kN,N,Ncm", names="Time,Fx,Fy,Mz")
    columns = read_dynoware(tmp_path / "a.csv").columns
    np.testing.assert_allclose(columns["Fx"], 1000 * force[:, 0])
    np.testing.assert_allclose(columns["Mz"], 0.01 * force[:, 2])
    export(tmp_path / "ms.csv", units="ms,N,N,N", rate_hz=1.0)
    assert read_dynoware(tmp_path / "ms.csv").time_s[1] == 0.001


def test_rate_from_the_time_column_where_the_header_has_none(tmp_path):
    export(tmp_path / "a.csv")
    text = (tmp_path / "a.csv").read_text().replace("Sampling rate [Hz]:,1000", "Sampling rate [Hz]:,?")
    (tmp_path / "a.csv").write_text(text)
    assert read_dynoware(tmp_path / "a.csv").sample_rate_hz == pytest.approx(1000.0)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda text: "nothing\n" * 100, ["no line of names beginning with Time"]),
        (lambda text: text.split("\n3,")[0] + "\n", ["without samples"]),
        (lambda text: text.replace("s,N,N,N", "s,lbf,N,N"), ["column Fx in 'lbf'", "newtons"]),
        (lambda text: text + "1,2\n", ["not 4 numbers each"]),
        (lambda text: text + "4.0,x,1,1\n", ["not 4 numbers each", "x"]),
    ],
)
def test_broken_exports_are_told(tmp_path, spoil, words):
    export(tmp_path / "a.csv")
    (tmp_path / "a.csv").write_text(spoil((tmp_path / "a.csv").read_text()))
    with pytest.raises(ValueError) as caught:
        read_dynoware(tmp_path / "a.csv")
    for word in words:
        assert word in str(caught.value)


def test_a_folder_with_its_side_file(tmp_path):
    folder = recordings(tmp_path / "r")
    force = export(folder / "a.csv", seed=1)
    dataset = import_dynoware(folder)
    assert (dataset.name, dataset.source, dataset.licence) == ("mine", "my machine", "private")
    assert dataset.tool.teeth == 4 and dataset.sensor.sample_rate_hz == 1000.0
    assert [(t.file, t.milling, t.feed_speed_m_s) for t in dataset.trials] == [
        ("a.csv", "climb", 0.010),
        ("b.csv", "conventional", 0.020),
    ]
    np.testing.assert_array_equal(
        dataset.trials[0].force_n, np.stack([force[:, 1], force[:, 0], -force[:, 2]], axis=-1)
    )
    assert dataset.trials[0].time_s[0] == 0.0
    assert dataset.left_out == () and dataset.warnings == ()


def test_json_serves_as_well_and_may_lie_elsewhere(tmp_path):
    import tomllib

    folder = recordings(tmp_path / "r")
    (folder / "conditions.toml").unlink()
    (tmp_path / "c.json").write_text(json.dumps(tomllib.loads(SIDE)))
    assert len(import_dynoware(folder, conditions=tmp_path / "c.json").trials) == 2
    assert import_dynoware(folder, conditions=tomllib.loads(SIDE)).name == "mine"


def test_one_bad_recording_is_left_out(tmp_path):
    folder = recordings(tmp_path / "r")
    (folder / "b.csv").write_text("not an export\n")
    dataset = import_dynoware(folder)
    assert [trial.file for trial in dataset.trials] == ["a.csv"]
    assert dataset.left_out[0].file == "b.csv" and "no line of names" in dataset.left_out[0].reason
    (folder / "b.csv").unlink()
    assert "cannot be read" in import_dynoware(folder).left_out[0].reason


def test_checks_apply_to_what_is_imported(tmp_path):
    folder = recordings(tmp_path / "r")
    export(folder / "b.csv", samples=30)
    dataset = import_dynoware(folder)
    assert "revolutions" in dataset.left_out[0].reason


def test_other_column_names_are_named_in_the_side_file(tmp_path):
    folder = recordings(tmp_path / "r")
    for file in ("a.csv", "b.csv"):
        export(folder / file, names="Time,F1,F2,F3")
    with pytest.raises(ValueError, match="expected also Fx, Fy, Fz"):
        import_dynoware(folder)
    (folder / "conditions.toml").write_text('columns = ["F3", "F1", "F2"]\n' + SIDE)
    force = export(folder / "a.csv", names="Time,F1,F2,F3")
    np.testing.assert_array_equal(import_dynoware(folder).trials[0].force_n[:, 1], force[:, 2])


def test_a_drill_takes_thrust_and_torque(tmp_path):
    folder = tmp_path / "r"
    folder.mkdir()
    force = export(folder / "a.csv", names="Time,Fx,Fz,Mz", units="s,N,N,Nm")
    side = {
        "tool": {"kind": "drill", "teeth": 2, "diameter_m": 0.006},
        "defaults": {"spindle_speed_rev_s": 20.0, "feed_speed_m_s": 0.002},
    }
    (trial,) = import_dynoware(folder / "a.csv", conditions=side).trials
    np.testing.assert_array_equal(trial.force_n[:, 2], force[:, 1])
    np.testing.assert_array_equal(trial.torque_nm, force[:, 2])


def test_no_conditions(tmp_path):
    export(tmp_path / "a.csv")
    with pytest.raises(ValueError, match=r"got no conditions, expected conditions\.toml or conditions\.json"):
        import_dynoware(tmp_path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("tool = ", ["cannot be parsed"]),
        ("x = 1\n", ["tool: got nothing"]),
        (SIDE.replace("teeth = 4", 'teeth = "four"'), ["conditions.toml", "tool.teeth", "four"]),
        (SIDE.replace('file = "a.csv"', 'kind = "cut"'), ["without a file name"]),
        ("columns = 5\n" + SIDE, ["columns: got 5"]),
        ('columns = ["Fx"]\n' + SIDE, ["columns: got ['Fx']", "3 names"]),
    ],
)
def test_broken_side_files_are_told(tmp_path, text, words):
    folder = recordings(tmp_path / "r")
    (folder / "conditions.toml").write_text(text)
    with pytest.raises(ValueError) as caught:
        import_dynoware(folder)
    for word in words:
        assert word in str(caught.value)


def test_no_such_recording_and_an_empty_folder(tmp_path):
    side = {"tool": {"kind": "end_mill", "teeth": 2, "diameter_m": 0.01}}
    with pytest.raises(ValueError, match="no such file or folder"):
        import_dynoware(tmp_path / "none", conditions=side)
    with pytest.raises(ValueError, match="expected recordings"):
        import_dynoware(tmp_path, conditions=side)


def test_conditions_from_a_name():
    found = conditions_from_name("6-n6000f300ap3ae25.csv")
    assert found == {
        "spindle_speed_rev_s": 100.0,
        "feed_speed_m_s": 0.005,
        "axial_width_m": 0.003,
        "radial_depth_m": 0.025,
    }
    assert conditions_from_name("N8000F1250.5AP0.5AE2") == pytest.approx(
        {
            "spindle_speed_rev_s": 8000 / 60,
            "feed_speed_m_s": 1250.5 / 60000,
            "axial_width_m": 5e-4,
            "radial_depth_m": 2e-3,
        }
    )
    assert conditions_from_name("trial_1.csv") == {}


def test_names_fill_in_and_the_side_file_wins(tmp_path):
    export(tmp_path / "x-n6000f300ap3ae25.csv")
    side = {
        "tool": {"kind": "end_mill", "teeth": 2, "diameter_m": 0.025},
        "defaults": {"milling": "slot", "axial_width_m": 0.004},
    }
    (trial,) = import_dynoware(tmp_path, conditions=side).trials
    assert (trial.spindle_speed_rev_s, trial.feed_speed_m_s, trial.axial_width_m) == (100.0, 0.005, 0.004)
