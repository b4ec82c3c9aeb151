"""The verbs' functions: settings worked in, resumed, refused. What they train is tested with the
experiments.
"""

import dataclasses
import json

import numpy as np
import pytest

from mjx_cutting.learning import presets, train
from mjx_cutting.learning.adapt import AdaptConfig, adapt
from mjx_cutting.learning.adapt import resolve as resolve_adapt
from mjx_cutting.learning.environment import describe, make_env
from mjx_cutting.learning.train import TrainConfig
from mjx_cutting.sim.config import EnvConfig


@pytest.fixture
def run_folder(tmp_path):
    """The settings of a run, as `train` leaves them."""
    config = TrainConfig(out=tmp_path / "run", seed=7, preset="smoke", env=EnvConfig(cut_m=0.1))
    return train.open_run(train.resolve(config), "train")


def test_preset_and_steps_are_worked_in():
    config = train.resolve(TrainConfig(preset="demo", steps=1234))
    assert config.ppo == dataclasses.replace(presets.EXPERT["demo"], steps=1234)
    assert train.resolve(config) == config


def test_resumed_run_has_its_own_settings(run_folder):
    again = train.resolve(TrainConfig(resume=run_folder, preset="full", steps=4096))
    assert again.out == run_folder
    assert again.seed == 7
    assert again.env == EnvConfig(cut_m=0.1)
    assert again.ppo == dataclasses.replace(presets.EXPERT["smoke"], steps=4096)
    assert train.shared(again)["env"]["cut_m"] == 0.1
    # a checkpoint in the folder names the same run
    assert train.resolve(TrainConfig(resume=run_folder / "checkpoints" / "00000002")).out == run_folder


def test_folder_of_another_run_is_not_overwritten(run_folder):
    (run_folder / "metrics.jsonl").write_text("{}\n")
    with pytest.raises(ValueError, match=r"holds a run already; expected a new folder; .* --resume"):
        train.train(TrainConfig(out=run_folder, preset="smoke"))


def test_resume_of_nothing_is_refused(tmp_path):
    with pytest.raises(ValueError, match="without readable settings"):
        train.train(TrainConfig(resume=tmp_path / "none"))
    (tmp_path / "config.json").write_text('{"config": ')
    with pytest.raises(ValueError, match="without readable settings"):
        train.train(TrainConfig(resume=tmp_path))


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"preset": "huge"}, "preset"),
        ({"seeds": 0}, "seeds"),
        ({"steps": 0}, "steps"),
        ({"checkpoint_every_s": -1.0}, "s"),
    ],
)
def test_settings_out_of_range_are_refused(settings, told):
    with pytest.raises(ValueError, match=f"got .*{told}"):
        TrainConfig(**settings)


def test_missing_model_and_disturbance_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"no file at .*model.json"):
        make_env(EnvConfig(), model=tmp_path / "model.json")
    (tmp_path / "model.json").write_text("{}")
    with pytest.raises(ValueError, match="expected"):
        make_env(EnvConfig(), model=tmp_path / "model.json")
    with pytest.raises(ValueError, match=r"no file at .*fit-gp"):
        make_env(EnvConfig(), gp=tmp_path / "gp.npz")


def test_adapting_needs_something_to_adapt_to(tmp_path):
    with pytest.raises(ValueError, match="neither gp nor model"):
        AdaptConfig(expert=tmp_path)
    with pytest.raises(ValueError, match="got strategy=gail"):
        AdaptConfig(expert=tmp_path, gp=tmp_path, strategy="gail")
    with pytest.raises(ValueError, match="no policy file"):
        adapt(AdaptConfig(expert=tmp_path / "none.npz", gp=tmp_path / "gp.npz"))


@pytest.mark.parametrize(
    ("strategy", "mode"),
    [("bc", "observation"), ("dagger", "observation"), ("fine_tune", "dynamics"), ("re_train", "dynamics")],
)
def test_strategy_decides_learner_and_mode(run_folder, tmp_path, strategy, mode):
    config = resolve_adapt(
        AdaptConfig(expert=run_folder, strategy=strategy, gp=tmp_path / "gp.npz", preset="smoke")
    )
    assert config.disturbance_mode == mode
    assert (config.imitation is None) == (strategy in ("fine_tune", "re_train"))
    assert (config.ppo is None) == (strategy in ("bc", "dagger"))
    assert config.env == EnvConfig(cut_m=0.1)  # the expert's
    stored = train.open_run(dataclasses.replace(config, out=tmp_path / "adapted"), "adapt")
    assert json.loads((stored / "config.json").read_text())["verb"] == "adapt"
    again = resolve_adapt(AdaptConfig(expert=tmp_path, resume=stored))
    assert train.shared(again) == train.shared(config)


def test_description_is_that_of_the_environment():
    config = EnvConfig()
    description = describe(make_env(config))
    assert len(description.observation_names) == 15
    assert description.action_names == (
        "stiffness_x",
        "stiffness_y",
        "stiffness_z",
        "feed_adjustment",
        "depth",
    )
    assert description.action_low == (50.0, 50.0, 50.0, -0.8, 0.0)
    assert description.action_high == (3000.0, 3000.0, 3000.0, 1.0, 0.002)
    assert description.action_log == (True, True, True, False, False)
    np.testing.assert_allclose(description.action_initial[:3], config.start_stiffness_s2, rtol=1e-6)
    assert description.policy_period_s == 0.02
