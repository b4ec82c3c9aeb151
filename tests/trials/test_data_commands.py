"""What `mjx-cutting data ...` prints, writes and returns."""

from __future__ import annotations

import io
import json

import numpy as np
import pytest
from rich.console import Console

from mjx_cutting.trials import commands, read


@pytest.fixture
def console():
    return Console(file=io.StringIO(), width=100, color_system=None)


def said(console: Console) -> str:
    return console.file.getvalue()  # type: ignore[attr-defined]


def save_export(path, seed: int = 0) -> None:
    rng = np.random.default_rng(seed)
    rows = [f"{i / 1000:g}," + ",".join(f"{v:.3f}" for v in rng.normal(size=3)) for i in range(500)]
    path.write_text(
        "\n".join(["DynoWare,x", "Sampling rate [Hz]:,1000", "Time,Fx,Fy,Fz", "s,N,N,N", *rows]) + "\n"
    )


OPTIONS = {
    "tool_kind": "end_mill",
    "teeth": 2,
    "diameter_m": 0.025,
    "milling": "conventional",
    "spindle_speed_rev_s": 50.0,
    "feed_speed_m_s": 0.01,
    "radial_depth_m": 0.002,
    "axial_width_m": 0.003,
}


def test_list_shows_names_places_and_licences(console, tmp_path, monkeypatch):
    monkeypatch.delenv("MJX_CUTTING_DATA", raising=False)
    monkeypatch.setattr("mjx_cutting.trials.catalogue.cache_folder", lambda: tmp_path)
    assert commands.list_(console=console) == 0
    told = said(console)
    for word in ("slotting", "drilling", "none stated: use and cite, never redistribute", "Apache-2.0"):
        assert word in told
    assert "not here yet: mjx-cutting data get slotting" in told


def test_list_tells_of_a_wrong_copy(console, tmp_path, monkeypatch):
    (tmp_path / "slotting").mkdir()
    monkeypatch.setenv("MJX_CUTTING_DATA", str(tmp_path))
    commands.list_(console=console)
    assert "got no such file" in said(console)


def test_check_of_a_sound_folder(folder, console):
    assert commands.check(folder.write(), console=console) == 0
    told = said(console)
    assert "2 good, 0 left out" in told and "t0.csv" in told and "conventional" in told
    assert "licence: CC0-1.0" in told and "left out t" not in told


def test_check_names_what_is_left_out_and_doubtful(folder, console):
    folder.columns("t1.csv")["force_x_n"][0] = np.nan
    folder.columns("t0.csv")["force_z_n"][:] = 1.0
    assert commands.check(folder.write(), console=console) == 1
    told = said(console)
    assert "left out t1.csv: force_x_n: got 1 values" in told
    assert "warning t0.csv: force_z_n: got 1 in every sample" in told
    assert "good, 1 warning" in told


def test_check_of_a_broken_folder(tmp_path, console):
    with pytest.raises(ValueError, match="neither a known data set nor a folder"):
        commands.check(tmp_path / "none", console=console)


@pytest.mark.parametrize("file_format", ["csv", "parquet"])
def test_import_with_options_alone(tmp_path, console, file_format):
    save_export(tmp_path / "run1.csv")
    out = tmp_path / "out"
    status = commands.import_(
        "dynoware",
        tmp_path / "run1.csv",
        out,
        name="mine",
        file_format=file_format,
        axes="+y,+x,-z",
        console=console,
        **OPTIONS,
    )
    assert status == 0 and f"written: {out}" in said(console).replace("\n", "")
    dataset = read(out)
    assert dataset.name == "mine" and dataset.axes == ("+y", "+x", "-z")
    (trial,) = dataset.trials
    assert trial.file == f"run1.{file_format}" and trial.feed_speed_m_s == 0.01
    assert sorted(path.name for path in out.iterdir()) == ["dataset.json", f"run1.{file_format}"]


def test_options_go_before_the_side_files_defaults_but_not_before_its_trials(tmp_path, console):
    source = tmp_path / "r"
    source.mkdir()
    save_export(source / "a.csv")
    save_export(source / "b.csv", 1)
    side = {
        "tool": {"kind": "end_mill", "teeth": 3, "diameter_m": 0.02},
        "defaults": {
            "milling": "climb",
            "spindle_speed_rev_s": 40.0,
            "radial_depth_m": 0.001,
            "axial_width_m": 0.001,
        },
        "trials": [
            {"file": "a.csv", "feed_speed_m_s": 0.02},
            {"file": "b.csv", "feed_speed_m_s": 0.03, "milling": "climb"},
        ],
    }
    (source / "conditions.json").write_text(json.dumps(side))
    commands.import_(
        "dynoware",
        source,
        tmp_path / "out",
        teeth=4,
        milling="conventional",
        feed_speed_m_s=1.0,
        console=console,
    )
    dataset = read(tmp_path / "out")
    assert dataset.tool.teeth == 4 and dataset.tool.diameter_m == 0.02
    assert [(t.feed_speed_m_s, t.milling) for t in dataset.trials] == [
        (0.02, "conventional"),
        (0.03, "climb"),
    ]


def test_import_without_conditions(tmp_path, console):
    save_export(tmp_path / "a.csv")
    with pytest.raises(ValueError, match="got no conditions"):
        commands.import_("dynoware", tmp_path, tmp_path / "out", console=console)
    assert not (tmp_path / "out").exists()


def test_import_into_a_folder_in_use(tmp_path, console):
    save_export(tmp_path / "a.csv")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "keep").write_text("me")
    with pytest.raises(FileExistsError):
        commands.import_("dynoware", tmp_path / "a.csv", tmp_path / "out", console=console, **OPTIONS)
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["keep"]


@pytest.mark.parametrize(
    ("kind", "changes", "words"),
    [
        ("matlab", {}, "kind: got 'matlab'"),
        ("drilling", {}, "no such file or folder"),
        ("slotting", {}, "no such file or folder"),
        ("dynoware", {}, "no such file or folder"),
        ("dynoware", {"file_format": "xlsx"}, "no such file or folder"),
    ],
)
def test_bad_requests(tmp_path, console, kind, changes, words):
    with pytest.raises(ValueError, match=words):
        commands.import_(kind, tmp_path / "none", tmp_path / "out", console=console, **OPTIONS, **changes)
    assert not (tmp_path / "out").exists()


def test_a_file_format_that_is_none(tmp_path, console):
    save_export(tmp_path / "a.csv")
    with pytest.raises(ValueError, match="file_format: got 'xlsx'"):
        commands.import_(
            "dynoware", tmp_path / "a.csv", tmp_path / "out", file_format="xlsx", console=console, **OPTIONS
        )  # type: ignore[arg-type]


def test_a_mat_file_that_is_none(tmp_path, console):
    (tmp_path / "dbhole.mat").write_bytes(b"MATLAB 5.0 no longer" * 20)
    with pytest.raises(ValueError, match="cannot be read as MATLAB"):
        commands.import_("drilling", tmp_path, tmp_path / "out", console=console)
    import scipy.io

    scipy.io.savemat(tmp_path / "dbhole.mat", {"x": np.zeros(3)})
    with pytest.raises(ValueError, match="no entry named d<drill>h<hole>"):
        commands.import_("drilling", tmp_path / "dbhole.mat", tmp_path / "out", console=console)


def test_the_users_own_drilling_records_in_the_same_form(tmp_path, console):
    import scipy.io

    rng = np.random.default_rng(0)
    holes = {f"d1h{h}": np.vstack([np.zeros((3, 2)), 100 * h + rng.normal(size=(300, 2))]) for h in (1, 2)}
    scipy.io.savemat(tmp_path / "dbhole.mat", holes | {"d1h3": np.zeros((5, 3))})
    commands.import_("drilling", tmp_path, tmp_path / "out", console=console)
    dataset = read(tmp_path / "out")
    assert [trial.samples for trial in dataset.trials] == [300, 300]
    assert "left out d1h3.csv: entry d1h3: got shape (5, 3)" in said(console)


@pytest.mark.measured
def test_get_writes_the_public_set_as_a_folder(tmp_path, measured_data, monkeypatch, console):
    monkeypatch.setenv("MJX_CUTTING_DATA", str(measured_data))
    assert commands.get("slotting", tmp_path / "out", file_format="parquet", console=console) == 0
    assert "never redistribute" in said(console).replace("\n", " ")
    assert len(read(tmp_path / "out").trials) == 5
    assert commands.get("drilling", console=console) == 0


@pytest.mark.measured
def test_import_of_a_copy_of_the_public_files(tmp_path, measured_data, console):
    assert commands.import_("drilling", measured_data / "drilling", tmp_path / "out", console=console) == 0
    assert "333 good, 1 left out" in said(console) and "left out d14h45.csv" in said(console)
    assert len(read(tmp_path / "out").trials) == 333
