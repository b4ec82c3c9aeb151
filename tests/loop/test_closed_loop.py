"""The closed-loop experiment's hidden sets, results and figure, without going round."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from experiments import closed_loop
from mjx_cutting.deploy.virtual_cell.hidden import load, to_dict
from mjx_cutting.loop import rounds


@pytest.mark.parametrize("name", closed_loop.HIDDEN)
def test_hidden_sets_are_effects_of_the_cell(name: str, tmp_path: Path) -> None:
    path = tmp_path / "hidden.toml"
    path.write_text(closed_loop.toml(closed_loop.HIDDEN[name]))
    assert set(to_dict(load(path))) == set(closed_loop.HIDDEN[name])


def test_presets_are_settings_of_the_loop() -> None:
    assert len(closed_loop.PRESETS["full"].materials) == 5 and len(closed_loop.PRESETS["full"].hidden) >= 3
    for preset in closed_loop.PRESETS.values():
        rounds.RoundsConfig(
            rounds=preset.rounds, trials=preset.trials, cuts=preset.cuts, candidates=preset.candidates
        )


def test_goes_on_where_it_stopped_and_draws(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def go_round(config: rounds.RoundsConfig) -> Path:
        asked.append((config.material, load(config.effects).radial_runout.offset_m))  # type: ignore[arg-type]
        assert config.out is not None
        config.out.mkdir(parents=True)
        rewards = {name: -1.0 + 0.1 * k for k, name in enumerate(rounds.STRATEGIES)}
        round_ = {
            "round": 1, "heldout_nrmse_before": 0.3, "heldout_nrmse_after": 0.1, "named": ["radial_runout"],
            "verdict": "explained", "reward": rewards, "rewards": {k: [v] for k, v in rewards.items()},
            "scores": {},
        }  # fmt: skip
        (config.out / "rounds.json").write_text(json.dumps({"rounds": [round_]}))
        return config.out

    monkeypatch.setattr(rounds, "run", go_round)
    config = closed_loop.ClosedLoopConfig(
        out=tmp_path / "out", results=tmp_path / "results", expert=tmp_path / "expert",
        materials=("plastic", "mica"), hidden=("runout", "many"), quiet=True,
    )  # fmt: skip
    for _ in range(2):
        closed_loop.run(config)
    assert [material for material, _ in asked] == ["plastic", "plastic", "mica", "mica"]
    assert asked[0][1] == closed_loop.HIDDEN["runout"]["radial_runout"]["offset_m"]
    told = json.loads((tmp_path / "results" / "closed_loop.json").read_text())
    assert {"command", "versions", "machine", "wall_s", "cells"} <= set(told)
    assert len(told["cells"]) == 4
    cell = told["cells"][0]
    assert {"material", "hidden", "heldout_nrmse_before", "heldout_nrmse_after", "named", "reward"} <= set(
        cell
    )
    assert set(cell["reward"]) == set(rounds.STRATEGIES) and "scores" not in cell["rounds"][0]
    assert (tmp_path / "results" / "closed_loop.png").stat().st_size > 10_000
    with pytest.raises(ValueError, match="expected names of runout"):
        closed_loop.run(closed_loop.ClosedLoopConfig(hidden=("nothing",)))
