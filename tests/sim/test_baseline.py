"""The baseline's table beside the paper's: its columns; what is committed is what the text quotes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mjx_cutting.sim import baseline
from mjx_cutting.sim.materials import PAPER_BASELINE

ROOT = Path(__file__).resolve().parents[2]


def row(**changes):
    values = {"time_s": 19.4, "deviation_mm": 4.58, "load_n": 9.03, "mrv_mm3": 165.5, "reward": -1.0}
    more = {"completed": 1.0, "mrv_low_mm3": 100.0, "mrv_high_mm3": 200.0, "episodes": 4}
    return baseline.Row(**{**values, **more, **changes})


def test_each_figure_stands_beside_the_papers():
    told = baseline.comparison({"foam": row()}, seed=5)
    foam, ratio = told["sheets"]["foam"], {"time_s": 1.0, "deviation_mm": 2.0, "load_n": 1.0, "mrv_mm3": 0.5}
    assert foam["paper"] == {"time_s": 19.4, "deviation_mm": 2.29, "load_n": 9.03, "mrv_mm3": 331.0}
    assert foam["ours_over_paper"] == pytest.approx(ratio)
    assert told["seed"] == 5 and told["provenance"]["versions"]["jax"]
    shown = baseline.table({"foam": row()})
    assert "| foam | 19.4 (19.4) | 4.58 (2.29) | 9.03 (9.03) | 165.5 (331) |" in shown


def test_the_text_quotes_the_committed_rows():
    told = json.loads((ROOT / "experiments" / "results" / "sim_baseline.json").read_text())
    rows = {name: baseline.Row(**sheet["ours"]) for name, sheet in told["sheets"].items()}
    assert set(rows) == set(PAPER_BASELINE)
    assert baseline.table(rows) in (ROOT / "docs" / "simulation.md").read_text()
    assert all(row.completed == 1.0 and row.episodes >= 50 for row in rows.values())
