"""A session is described by the environment that the policy was trained in, or by a file."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from mjx_cutting.deploy import sessions
from mjx_cutting.deploy.artefact import Artefact
from mjx_cutting.learning.policy import Policy
from mjx_cutting.sim.config import EnvConfig
from mjx_cutting.trials.parts import check_session


def test_the_training_environment_describes_the_session(served: Artefact) -> None:
    env = json.loads(json.dumps(EnvConfig(nominal_feed_m_s=0.02, teeth=24).to_dict()))
    trained = dataclasses.replace(served, provenance={"env": env})
    session = check_session(sessions.of(trained, "mica"))
    assert session["tool"] == {"kind": "slitting_saw", "teeth": 24, "diameter_m": 0.05}
    assert session["sensor"]["sample_rate_hz"] == 500.0
    assert session["sensor"]["noise_std_n"] == [0.1, 0.1, 0.18]  # one a column, the columns are base axes
    assert session["sensor"]["anti_alias"]["hz"] == 120.0
    assert session["trial"]["material"] == "mica" and session["trial"]["spindle_speed_rev_s"] == 19.0
    assert sessions.nominal_feed_m_s(trained, 1.0) == 0.02
    unfiltered = dataclasses.replace(served, provenance={"env": {**env, "force_lowpass_hz": 0.0}})
    assert check_session(sessions.of(unfiltered))["sensor"]["anti_alias"] is None


def test_a_policy_that_does_not_say_needs_a_file(served: Artefact, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"--session session\.json"):
        sessions.of(served)
    assert sessions.nominal_feed_m_s(served, 0.0125) == 0.0125
    (tmp_path / "list.json").write_text("[]")
    with pytest.raises(ValueError, match="expected an object"):
        sessions.read(tmp_path / "list.json")
    with pytest.raises(ValueError, match="no readable JSON"):
        sessions.read(tmp_path / "nothing.json")


def test_export_of_a_run_names_its_environment(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, policy: Policy
) -> None:
    from mjx_cutting.deploy import export

    env = EnvConfig().to_dict()
    monkeypatch.setattr(export, "load_policy", lambda run: policy)
    monkeypatch.setattr(export, "stored_config", lambda run: {"env": env})
    artefact = export.build_run(tmp_path, pairs=1)
    artefact.save(tmp_path / "policy.npz")
    check_session(sessions.of(Artefact.load(tmp_path / "policy.npz")))
