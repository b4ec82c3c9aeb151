"""The examples of docs/api run as they stand, and docs/effects.md lists what is registered."""

from __future__ import annotations

import re
import sys
import types
from collections.abc import Iterator
from pathlib import Path

import pytest

from mjx_cutting.cutting import effect_class, effect_names
from mjx_cutting.cutting.effects import registry

DOCS = Path(__file__).resolve().parent.parent / "docs"
PAGES = sorted((DOCS / "api").glob("*.md"))
NAMES = effect_names()
_BLOCK = re.compile(r"^```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)


@pytest.fixture(autouse=True)
def own_registry() -> Iterator[None]:
    """Examples register effects; the others must not meet them."""
    before = dict(registry._EFFECTS)
    yield
    registry._EFFECTS.clear()
    registry._EFFECTS.update(before)


def blocks(text: str) -> list[tuple[int, str]]:
    """(line of the first statement, code) of every python block."""
    return [(text.count("\n", 0, match.start(1)) + 1, match.group(1)) for match in _BLOCK.finditer(text)]


def test_there_are_pages_with_examples():
    assert PAGES
    assert all(blocks(page.read_text()) for page in PAGES)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_examples_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Every python block of a page, in order, in one namespace."""
    monkeypatch.chdir(tmp_path)
    module = types.ModuleType("docs_example")
    monkeypatch.setitem(sys.modules, module.__name__, module)
    for line, code in blocks(page.read_text()):
        compiled = compile("\n" * (line - 1) + code, str(page), "exec")
        exec(compiled, module.__dict__)


@pytest.mark.parametrize("name", NAMES)
def test_the_table_of_effects_is_true(name: str):
    row = next(
        (line for line in (DOCS / "effects.md").read_text().splitlines() if line.startswith(f"| `{name}` |")),
        None,
    )
    assert row is not None, f"docs/effects.md has no row for {name}"
    kind = effect_class(name)
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells[1] == kind.stage
    assert re.findall(r"`(\w+)`", cells[2]) == list(kind.parameters)
    assert cells[3] == kind.signature
    assert cells[5] == (", ".join(kind.needs) or "-")
    assert cells[6] == ("yes" if kind.steady else "no")
