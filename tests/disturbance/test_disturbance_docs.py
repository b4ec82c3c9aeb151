"""The examples of docs/disturbance.md run as they stand."""

from __future__ import annotations

import re

import pytest


def _examples(repository):
    text = (repository / "docs" / "disturbance.md").read_text(encoding="utf-8")
    return re.findall(r"```python\n(.*?)```", text, flags=re.S)


@pytest.mark.parametrize("which", [0, 1])
def test_examples_run(repository, tmp_path, monkeypatch, which):
    monkeypatch.chdir(tmp_path)
    found = _examples(repository)
    assert len(found) == 2
    space: dict = {}
    exec(compile(found[which], f"docs/disturbance.md example {which}", "exec"), space)
    if which == 0:
        assert (tmp_path / "disturbance.npz").is_file()
        assert abs(space["gp"].frequency_hz - 2.1) < 0.01 and space["force_n"].shape == (3,)
