"""The examples in docs/dataset.md run as they stand, and its tables know every key and column."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import pytest

from mjx_cutting.trials.keys import Keys
from mjx_cutting.trials.manifest import HISTORY, parse_manifest
from mjx_cutting.trials.records import KNOWN


@pytest.fixture(scope="module")
def text(repository: Path) -> str:
    return (repository / "docs" / "dataset.md").read_text(encoding="utf-8")


def test_the_python_examples_run(text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", text, re.S)
    assert len(blocks) == 2
    exec(compile("\n".join(blocks), "docs/dataset.md", "exec"), {})
    assert (tmp_path / "my-dataset-2" / "air.parquet").is_file()


def test_the_manifest_example_is_sound(text):
    block = next(b for b in re.findall(r"(?:^    .*\n)+", text, re.M) if "mjx-cutting-trials/1" in b)
    manifest = parse_manifest(json.loads(block), name="d")
    assert manifest.warnings == () and manifest.left_out == () and len(manifest.entries) == 1


def test_the_side_file_example_is_sound(text, tmp_path):
    from mjx_cutting.trials.importers.conditions import plan_import

    (table,) = re.findall(r"```toml\n(.*?)```", text, re.S)
    plan = plan_import(
        tmp_path, patterns=("*.csv",), conditions=tomllib.loads(table), name=None, sample_rate_hz=1000.0
    )
    assert [entry.file for entry in plan.manifest.entries] == ["a.csv", "b.csv"]
    assert plan.manifest.left_out == () and plan.manifest.warnings == ()


def test_every_key_and_column_is_documented(text, monkeypatch):
    asked: set[str] = set()
    absent = Keys.absent

    def spy(self: Keys, key: str) -> bool:
        asked.add(key)
        return absent(self, key)

    monkeypatch.setattr(Keys, "absent", spy)
    block = next(b for b in re.findall(r"(?:^    .*\n)+", text, re.M) if "mjx-cutting-trials/1" in b)
    parse_manifest(json.loads(block), name="d")
    assert asked >= {"format", "trials", "zero_phase", *HISTORY}
    undocumented = [
        key for key in asked - {"tool", "sensor", "trials"} if not re.search(rf"[`.]{key}`", text)
    ]
    assert undocumented == []
    assert [name for name in KNOWN if f"`{name}`" not in text] == []
