"""The whole loop at toy size, from measured trials where they are at hand."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mjx_cutting.deploy.runtime import PolicyRuntime
from mjx_cutting.loop import demo


@pytest.mark.slow
@pytest.mark.measured
def test_the_loop_ends_in_a_report(measured_data, tmp_path):
    config = demo.DemoConfig(
        out=tmp_path / "run", preset="smoke", rollouts=2, effects=("radial_runout",), quiet=True
    )
    report = demo.run(config)
    page = report.read_text()
    assert page.count("data:image/png") >= 6
    assert "radial_runout" in (tmp_path / "run" / "trace" / "verdict.json").read_text()
    resolved = json.loads((tmp_path / "run" / "config.json").read_text())
    assert resolved["config"]["preset"] == "smoke"
    runtime = PolicyRuntime.load(tmp_path / "run" / "policy.npz")
    action = runtime(np.zeros(runtime.artefact.observation_size))
    assert action.shape == (5,)
    assert np.all(np.abs(action) <= 1.0)


def test_without_measured_trials_calculated_ones_are_used_and_said_so(monkeypatch):
    import mjx_cutting.trials

    def none(name):
        raise OSError("no network")

    monkeypatch.setattr(mjx_cutting.trials, "resolve", none)
    dataset, why = demo.trials(seed=0)
    assert why == "no network"
    assert dataset.name == "trials made by calculation"
    assert len(dataset.trials) == 5


@pytest.mark.parametrize("bad", [{"preset": "huge"}, {"rollouts": 1}])
def test_settings_out_of_range_are_refused(bad):
    with pytest.raises(ValueError, match="expected"):
        demo.DemoConfig(**bad)
