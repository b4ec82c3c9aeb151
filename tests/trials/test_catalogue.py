"""Known data sets: found by variable, by cache or by download, with their hashes; a folder is a dataset as
well.
"""

from __future__ import annotations

import re
import shutil

import pytest

from mjx_cutting.trials import catalogue, resolve
from mjx_cutting.trials.catalogue import CATALOGUE, cache_folder, fetch, locate
from mjx_cutting.trials.download import DownloadError


@pytest.fixture(autouse=True)
def impatient(monkeypatch):
    monkeypatch.setattr("pooch.core.time.sleep", lambda _: None)
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")


def test_every_source_is_pinned_by_full_commit_and_hash():
    assert set(CATALOGUE) == {"slotting", "drilling"}
    for name, data in CATALOGUE.items():
        assert data.name == name
        assert re.fullmatch(
            r"https://raw\.githubusercontent\.com/[\w-]+/\w+/[0-9a-f]{40}/[\w%/]+", data.base_url
        )
        assert data.base_url.split("/")[5].startswith({"slotting": "3fda341", "drilling": "a8bb334"}[name])
        assert data.licence and data.source_url.startswith("https://github.com/")
        for file in data.files:
            assert re.fullmatch(r"[0-9a-f]{64}", file.sha256) and file.size_bytes > 100_000
    assert "never redistribute" in CATALOGUE["slotting"].licence


def test_an_unknown_name(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=r"milling: got neither .* slotting, drilling"):
        resolve("milling")
    with pytest.raises(ValueError, match="milling: got an unknown data set"):
        fetch("milling")


def test_a_folder(folder):
    path = folder.write()
    assert resolve(path).name == resolve(str(path)).name == "sound"


def test_a_known_name_wins_over_a_folder_of_that_name(folder, tmp_path, monkeypatch):
    folder.path = tmp_path / "slotting"
    folder.write()
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("MJX_CUTTING_DATA", raising=False)
    with pytest.raises(DownloadError):
        resolve("slotting", cache=tmp_path / "cache", base_url="http://127.0.0.1:9")
    assert resolve("./slotting").name == "sound"


@pytest.mark.parametrize("variable", [None, "", "/nowhere/at/all"])
def test_neither_variable_nor_cache_nor_network(tmp_path, monkeypatch, variable):
    if variable is None:
        monkeypatch.delenv("MJX_CUTTING_DATA", raising=False)
    else:
        monkeypatch.setenv("MJX_CUTTING_DATA", variable)
    assert locate("drilling", cache=tmp_path) is None
    with pytest.raises(DownloadError) as caught:
        fetch("drilling", cache=tmp_path, base_url="http://127.0.0.1:9", retries=0)
    told = str(caught.value)
    assert "no connection" in told and "drilling/dbhole.mat and set MJX_CUTTING_DATA" in told
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_a_wrong_copy_below_the_variable_is_refused(tmp_path, monkeypatch):
    (tmp_path / "drilling").mkdir()
    monkeypatch.setenv("MJX_CUTTING_DATA", str(tmp_path))
    with pytest.raises(ValueError, match=r"dbhole\.mat: got no such file"):
        resolve("drilling")
    (tmp_path / "drilling" / "dbhole.mat").write_bytes(b"x")
    with pytest.raises(
        ValueError, match=r"dbhole\.mat: got SHA-256 2d711642b726b044\.\.\., expected 67ac5e8e"
    ):
        resolve("drilling")


def test_the_cache_is_the_users_and_moves_with_the_package(tmp_path, monkeypatch):
    monkeypatch.delenv("MJX_CUTTING_CACHE", raising=False)
    assert cache_folder().parts[-2:] == ("mjx-cutting", "data")
    monkeypatch.setenv("MJX_CUTTING_CACHE", str(tmp_path))
    assert cache_folder() == tmp_path / "data"
    shown = []
    monkeypatch.setattr(catalogue, "is_cached", lambda folder, files: shown.append(folder))
    monkeypatch.delenv("MJX_CUTTING_DATA", raising=False)
    locate("drilling")
    assert shown == [tmp_path / "data" / "drilling"]


@pytest.mark.measured
@pytest.mark.parametrize("name", ["slotting", "drilling"])
def test_the_pinned_hashes_are_those_of_the_data(measured_data, monkeypatch, tmp_path, name):
    monkeypatch.setenv("MJX_CUTTING_DATA", str(measured_data))
    assert fetch(name) == measured_data / name
    monkeypatch.delenv("MJX_CUTTING_DATA")
    shutil.copytree(measured_data / name, tmp_path / name)
    assert fetch(name, cache=tmp_path, base_url="http://127.0.0.1:9") == tmp_path / name, (
        "a whole cache needs no network"
    )
    assert sum(file.size_bytes for file in CATALOGUE[name].files) == sum(
        (measured_data / name / file.name).stat().st_size for file in CATALOGUE[name].files
    )
    assert resolve(name, cache=tmp_path).name == name
