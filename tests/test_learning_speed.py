"""How the benchmark of learning speed reads a curve, and what it says without the peer."""

import importlib.util
import sys
from pathlib import Path

import pytest

PLACE = Path(__file__).parent.parent / "benchmarks" / "learning_speed.py"


@pytest.fixture(scope="module")
def speed():
    spec = importlib.util.spec_from_file_location("learning_speed", PLACE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_curve_and_when_it_is_at_a_reward(speed):
    episodes = [(0.5 * i, 100 * i, float(i)) for i in range(1, 201)]
    curve = speed.smoothed(episodes)
    assert len(curve["reward"]) == 151
    assert curve["reward"][0] == pytest.approx(25.5)
    assert curve["reward"][-1] == pytest.approx(175.5)
    assert (curve["wall_s"][-1], curve["steps"][-1]) == (100.0, 20_000)
    # the mean of 50 is at 100.5 after 125 episodes
    assert speed.reached(curve, 100.5) == {"wall_s": 62.5, "steps": 12_500}
    assert speed.reached(curve, 1e3) is None
    assert speed._thinned(list(range(1000)), 5) == [0, 250, 500, 749, 999]
    with pytest.raises(ValueError, match="more steps"):
        speed.smoothed(episodes[:1])


def test_ladder_says_where_a_curve_never_was(speed):
    quick = speed.smoothed([(i, 10 * i, float(i)) for i in range(1, 201)])
    slow = speed.smoothed([(10.0 * i, i, 0.5 * i) for i in range(1, 201)])
    rungs = speed.ladder({"quick": quick, "slow": slow}, 0.0)
    asked = [0.2 * 175.5, 0.4 * 175.5, 0.6 * 175.5, 0.8 * 175.5, 0.95 * 175.5]
    assert [rung["reward"] for rung in rungs] == pytest.approx(asked)
    assert rungs[1]["quick"]["wall_s"] == 95 and rungs[1]["slow"]["wall_s"] == 1650.0
    assert rungs[3]["slow"] is None


def test_missing_peer_is_said(speed, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "learning_peer", None)
    monkeypatch.setattr(sys, "argv", ["learning_speed.py", "--quick"])
    assert speed.main() == 2
    assert "mjx-cutting[peers]" in capsys.readouterr().err
