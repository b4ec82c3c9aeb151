"""dataset.json: what breaks it names the key path; what breaks one entry leaves out that trial; unknown keys
are ignored.
"""

from __future__ import annotations

import copy
import json
import math
from typing import Any

import pytest

from mjx_cutting.trials import AntiAlias, read
from mjx_cutting.trials.manifest import parse_manifest


def changed(document: dict, path: str, value: object) -> dict:
    """A copy with the value at a dotted path set, or the key removed where value is ..."""
    document = copy.deepcopy(document)
    *parents, last = path.split(".")
    table = document
    for parent in parents:
        table = table[parent]
    if value is ...:
        del table[last]
    else:
        table[last] = value
    return document


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("format", ..., ["format: got nothing", "mjx-cutting-trials/1"]),
        ("format", "mjx-cutting-trials/2", ["format: got", "/2", "mjx-cutting-trials/1", "convert"]),
        ("tool", ..., ["tool: got nothing", "object"]),
        ("tool", [], ["tool: got []", "object"]),
        ("tool.kind", ..., ["tool.kind: got nothing", "end_mill"]),
        ("tool.kind", "saw", ["tool.kind", "saw", "slitting_saw"]),
        ("tool.teeth", ..., ["tool.teeth: got nothing", "whole number"]),
        ("tool.teeth", 2.5, ["tool.teeth: got 2.5", "whole number"]),
        ("tool.teeth", "2", ['tool.teeth: got "2"', "whole number"]),
        ("tool.teeth", True, ["tool.teeth: got true"]),
        ("tool.teeth", 0, ["tool.teeth: got 0", "at least 1"]),
        ("tool.diameter_m", ..., ["tool.diameter_m: got nothing"]),
        ("tool.diameter_m", "25 mm", ["tool.diameter_m", "25 mm", "without quotes"]),
        ("tool.diameter_m", 0, ["tool.diameter_m: got 0", "greater than 0"]),
        ("tool.diameter_m", 25.0, ["tool.diameter_m: got 25.0", "metres", "1000"]),
        ("tool.diameter_m", math.nan, ["tool.diameter_m", "NaN"]),
        ("tool.helix_rad", 45.0, ["tool.helix_rad: got 45.0", "pi/180"]),
        ("sensor", ..., ["sensor: got nothing", "object"]),
        ("sensor.sample_rate_hz", ..., ["sensor.sample_rate_hz: got nothing"]),
        ("sensor.sample_rate_hz", -500, ["sensor.sample_rate_hz: got -500", "greater than 0"]),
        ("sensor.noise_std_n", [0.1, 0.1], ["sensor.noise_std_n", "three numbers"]),
        ("sensor.noise_std_n", [0.1, "a", 0.1], ["sensor.noise_std_n", "three numbers"]),
        ("sensor.zeroed", "daily", ["sensor.zeroed", "daily", "session"]),
        ("sensor.units", "kg", ["sensor.units", "kg", "arbitrary"]),
        ("sensor.anti_alias", 200.0, ["sensor.anti_alias: got 200.0", "object"]),
        ("sensor.anti_alias.kind", "bessel", ["sensor.anti_alias.kind", "bessel", "butterworth"]),
        ("sensor.anti_alias.order", 0, ["sensor.anti_alias.order: got 0"]),
        ("sensor.anti_alias.hz", ..., ["sensor.anti_alias.hz: got nothing"]),
        ("sensor.anti_alias.zero_phase", "no", ["sensor.anti_alias.zero_phase", "true or false"]),
        ("axes", "xyz", ["axes", "xyz", "null"]),
        ("axes", ["+x", "+y", "+y"], ["axes", "+y", "once"]),
        ("trials", ..., ["trials: got nothing", "at least one"]),
        ("trials", [], ["trials: got []", "at least one"]),
        ("trials", {}, ["trials: got {}"]),
        ("trials", [3], ["trials[0]: got 3"]),
        ("trials", [{"kind": "cut"}], ["trials[0].file: got nothing"]),
        ("trials", [{"file": 5}], ["trials[0].file: got 5"]),
        ("name", 5, ["name: got 5", "quotes"]),
    ],
)
def test_a_broken_document_is_an_error_that_names_the_key(folder, path, value, words):
    folder.document = changed(folder.document, path, value)
    with pytest.raises(ValueError) as caught:
        read(folder.write())
    for word in ["dataset.json", "expected", *words]:
        assert word in str(caught.value)


def test_not_json_names_the_line(folder):
    path = folder.write()
    (path / "dataset.json").write_text('{\n "format": oops }')
    with pytest.raises(ValueError, match=r"not JSON \(line 2, column 12") as caught:
        read(path)
    assert "mend that line" in str(caught.value)


def test_not_utf8_and_not_an_object(folder):
    path = folder.write()
    (path / "dataset.json").write_bytes(b'{"name": "\xff"}')
    with pytest.raises(ValueError, match="not UTF-8"):
        read(path)
    (path / "dataset.json").write_text("[1, 2]")
    with pytest.raises(ValueError, match=r"got \[1, 2\] at the top"):
        read(path)


def test_a_byte_order_mark_is_no_fault(folder):
    path = folder.write()
    text = (path / "dataset.json").read_text()
    (path / "dataset.json").write_text(text, encoding="utf-8-sig")
    assert len(read(path).trials) == 2


@pytest.mark.parametrize("state", ["missing", "file", "empty"])
def test_no_dataset_there(tmp_path, state):
    path = tmp_path / "d"
    if state == "file":
        path.write_text("x")
    if state == "empty":
        path.mkdir()
    expected = {"missing": "does not exist", "file": "is not a folder", "empty": "has no dataset.json"}[state]
    with pytest.raises(ValueError, match=expected):
        read(path)


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("kind", ..., ["trials[1].kind: got nothing", "air"]),
        ("kind", "probe", ["trials[1].kind", "probe"]),
        ("milling", ..., ["trials[1].milling: got nothing", "climb"]),
        ("milling", "up", ["trials[1].milling", "up", "climb"]),
        ("spindle_speed_rev_s", ..., ["trials[1].spindle_speed_rev_s: got nothing"]),
        ("spindle_speed_rev_s", 0, ["trials[1].spindle_speed_rev_s: got 0", "greater than 0"]),
        ("spindle_speed_rev_s", -21.0, ["trials[1].spindle_speed_rev_s: got -21", "greater than 0"]),
        ("spindle_speed_rev_s", "fast", ["trials[1].spindle_speed_rev_s", "fast"]),
        ("feed_speed_m_s", ..., ["trials[1].feed_speed_m_s: got nothing"]),
        ("feed_speed_m_s", 0.0, ["trials[1].feed_speed_m_s: got 0", "greater than 0"]),
        ("feed_speed_m_s", -0.01, ["trials[1].feed_speed_m_s: got -0.01"]),
        ("radial_depth_m", ..., ["trials[1].radial_depth_m: got nothing"]),
        ("radial_depth_m", None, ["trials[1].radial_depth_m: got null"]),
        ("axial_width_m", 0, ["trials[1].axial_width_m: got 0"]),
        ("material", 5, ["trials[1].material: got 5", "quotes"]),
        ("cut_length_before_m", -1, ["trials[1].cut_length_before_m: got -1"]),
        ("clock_start_s", "noon", ["trials[1].clock_start_s", "noon"]),
    ],
)
def test_a_broken_entry_leaves_out_that_trial_alone(folder, key, value, words):
    if value is ...:
        del folder.entry()[key]
    else:
        folder.entry()[key] = value
    dataset = read(folder.write())
    assert [trial.file for trial in dataset.trials] == ["t0.csv"]
    (left,) = dataset.left_out
    assert left.file == "t1.csv"
    for word in ["expected", *words]:
        assert word in left.reason


def test_a_file_listed_twice_is_used_once(folder):
    folder.document["trials"].append(dict(folder.entry(1)))
    dataset = read(folder.write())
    assert [trial.file for trial in dataset.trials] == ["t0.csv", "t1.csv"]
    assert "again" in dataset.left_out[0].reason and "trials[2].file" in dataset.left_out[0].reason


def test_everything_declared_arrives(folder):
    dataset = read(folder.write())
    assert (dataset.name, dataset.source, dataset.licence) == ("sound", "made by a test", "CC0-1.0")
    assert (dataset.tool.kind, dataset.tool.teeth, dataset.tool.diameter_m, dataset.tool.helix_rad) == (
        "end_mill",
        2,
        0.025,
        0.5,
    )
    assert dataset.sensor.noise_std_n == (0.1, 0.2, 0.3)
    assert dataset.sensor.zeroed == "session"
    assert dataset.sensor.anti_alias == AntiAlias("butterworth", 4, 200.0, False)
    trial = dataset.trials[0]
    assert (trial.kind, trial.milling, trial.material, trial.tool_id) == (
        "cut",
        "conventional",
        "aluminium",
        "a",
    )
    assert (trial.spindle_speed_rev_s, trial.feed_speed_m_s) == (21.0, 0.0021)
    assert (trial.radial_depth_m, trial.axial_width_m) == (0.001, 0.003)
    assert (trial.cut_length_before_m, trial.clock_start_s) == (0.25, 60.0)
    assert dataset.warnings == () and dataset.left_out == ()


@pytest.mark.parametrize("absent", [True, False])
def test_defaults_where_optional_keys_are_absent_or_null(folder, absent):
    def drop(table: dict, *keys: str) -> None:
        for key in keys:
            if absent:
                del table[key]
            else:
                table[key] = None

    drop(folder.document, "name", "source", "licence", "axes")
    drop(folder.document["tool"], "helix_rad")
    drop(folder.document["sensor"], "noise_std_n", "zeroed", "units", "anti_alias")
    for entry in folder.document["trials"]:
        drop(entry, "material", "tool_id", "cut_length_before_m", "clock_start_s")
    dataset = read(folder.write())
    assert (dataset.name, dataset.source, dataset.licence, dataset.axes) == ("sound", None, None, None)
    assert dataset.tool.helix_rad == 0.0
    sensor = dataset.sensor
    assert (sensor.noise_std_n, sensor.zeroed, sensor.units, sensor.anti_alias) == (None, "trial", "SI", None)
    trial = dataset.trials[0]
    assert (trial.material, trial.tool_id, trial.cut_length_before_m, trial.clock_start_s) == (
        None,
        None,
        0.0,
        0.0,
    )
    assert dataset.warnings == ()


def test_unknown_keys_are_named_and_ignored(folder):
    folder.document["colour"] = "red"
    folder.document["tool"]["coating"] = "TiN"
    folder.document["sensor"]["maker"] = "x"
    folder.document["sensor"]["anti_alias"]["ripple"] = 1
    folder.entry(0)["operator"] = "y"
    dataset = read(folder.write())
    assert len(dataset.trials) == 2
    told = "\n".join(dataset.warnings)
    for path in ("colour", "tool.coating", "sensor.maker", "sensor.anti_alias.ripple", "trials[0].operator"):
        assert f"{path}: unknown key, ignored" in told
    assert len(dataset.warnings) == 5


def test_history_given_for_some_trials_is_warned_of(folder):
    del folder.entry(1)["cut_length_before_m"]
    dataset = read(folder.write())
    (warning,) = dataset.warnings
    assert "cut_length_before_m is missing for t1.csv" in warning


def test_a_filter_above_half_the_rate_is_warned_of(folder):
    folder.document["sensor"]["anti_alias"]["hz"] = 600.0
    dataset = read(folder.write())
    assert any("sensor.anti_alias.hz: got 600 Hz" in warning for warning in dataset.warnings)


def test_noise_follows_its_column_into_process_axes(folder):
    folder.document["axes"] = ["+y", "-z", "+x"]
    assert read(folder.write()).sensor.noise_std_n == (0.3, 0.1, 0.2)


def test_air_trials_may_stand_still(folder):
    folder.entry(1).update(kind="air", feed_speed_m_s=0, radial_depth_m=0, axial_width_m=0.0)
    dataset = read(folder.write())
    assert [trial.kind for trial in dataset.trials] == ["cut", "air"]


def test_the_size_of_a_cut_in_air_is_nothing_where_it_is_not_given(folder):
    del folder.entry(1)["radial_depth_m"]
    folder.entry(1).update(kind="air", axial_width_m=None)
    air = read(folder.write()).trials[1]
    assert (air.radial_depth_m, air.axial_width_m) == (0.0, 0.0)


def test_drills_need_no_milling_depth_or_width_and_their_axes_keep_thrust_along_z():
    document = {
        "format": "mjx-cutting-trials/1",
        "tool": {"kind": "drill", "teeth": 2, "diameter_m": 0.006},
        "sensor": {"sample_rate_hz": 250.0},
        "trials": [{"file": "h1.csv", "kind": "cut", "spindle_speed_rev_s": 13.0, "feed_speed_m_s": 0.002}],
    }
    manifest = parse_manifest(document, name="d")
    (entry,) = manifest.entries
    assert entry.conditions["milling"] is None
    assert entry.conditions["radial_depth_m"] == entry.conditions["axial_width_m"] == 0.003
    with pytest.raises(ValueError, match=r"axes: got.*thrust.*set null"):
        parse_manifest(document | {"axes": ["+z", "+x", "+y"]}, name="d")


def test_turning_needs_depth_or_width_but_no_milling():
    document: dict[str, Any] = {
        "format": "mjx-cutting-trials/1",
        "tool": {"kind": "turning", "teeth": 1, "diameter_m": 0.05},
        "sensor": {"sample_rate_hz": 250.0},
        "trials": [{"file": "h1.csv", "kind": "cut", "spindle_speed_rev_s": 13.0, "feed_speed_m_s": 0.002}],
    }
    assert "radial_depth_m" in parse_manifest(document, name="d").left_out[0].reason
    for key in ("radial_depth_m", "axial_width_m"):
        one = document | {"trials": [document["trials"][0] | {key: 0.001}]}
        conditions = parse_manifest(one, name="d").entries[0].conditions
        assert (conditions["radial_depth_m"], conditions["axial_width_m"]) == (0.001, 0.001)
    document["trials"][0] |= {"radial_depth_m": 0.001, "axial_width_m": 0.0002}
    assert parse_manifest(document, name="d").entries[0].conditions["milling"] is None


def test_the_example_in_the_design_parses():
    text = """{ "format": "mjx-cutting-trials/1", "name": "n", "source": "s", "licence": "l",
      "tool": {"kind": "slitting_saw", "teeth": 20, "diameter_m": 0.05, "helix_rad": 0.0},
      "sensor": {"sample_rate_hz": 500.0, "noise_std_n": [0.1, 0.1, 0.2], "zeroed": "trial", "units": "SI",
                 "anti_alias": {"kind": "butterworth", "order": 4, "hz": 200.0, "zero_phase": false}},
      "axes": ["+x", "+y", "+z"],
      "trials": [ {"file": "t01.csv", "kind": "cut", "milling": "slot", "spindle_speed_rev_s": 25.0,
                   "feed_speed_m_s": 0.0125, "radial_depth_m": 0.001, "axial_width_m": 0.001,
                   "material": "aluminium", "tool_id": "a", "cut_length_before_m": 0.0,
                   "clock_start_s": 0.0} ] }"""
    manifest = parse_manifest(json.loads(text), name="d")
    assert manifest.warnings == () and manifest.left_out == ()
