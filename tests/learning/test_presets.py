"""Every preset at toy size: its schedules, networks and loops run, whatever its full size is."""

import dataclasses

import numpy as np
import pytest

from mjx_cutting.learning import presets
from mjx_cutting.learning.expert import initial_policy, train_policy
from mjx_cutting.learning.imitation.training import imitate
from mjx_cutting.learning.progress import METRICS, read_lines

TOY = {"steps": 128, "envs": 8, "unroll_length": 8, "minibatches": 2, "epochs": 1}
SIZES = [presets.EXPERT, presets.FINE_TUNE]


@pytest.fixture(scope="module")
def expert(point_env):
    return initial_policy(point_env(), presets.EXPERT["smoke"])


@pytest.mark.slow
@pytest.mark.parametrize(
    "config",
    # presets that differ in sizes alone are one
    sorted({dataclasses.replace(sizes[name], **TOY) for sizes in SIZES for name in presets.NAMES}, key=str),
    ids=lambda c: f"hidden{c.hidden}-value{c.value_hidden}-lr{c.learning_rate_final}-noise{c.noise_scale}",
)
def test_ppo_of_every_preset(config, point_env, tmp_path):
    (policy,) = train_policy(point_env(), config, tmp_path, quiet=True)
    assert policy.hidden == config.hidden
    lines = read_lines(tmp_path / METRICS)
    assert [line["steps"] for line in lines] == [64, 128]
    assert all(np.isfinite(line["total_loss"]) for line in lines)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["demo", "cpu"])
def test_imitation_of_every_preset(name, expert, point_env, tmp_path):
    config = dataclasses.replace(presets.IMITATION[name], rounds=3, expert_rounds=2)
    imitate(point_env(disturbance=1.0), expert, config, tmp_path, strategy="dagger", quiet=True)
    lines = read_lines(tmp_path / METRICS)
    assert [line["beta"] for line in lines] == [1, 0.5, 0]
    assert lines[-1]["steps"] == 3 * 16 * config.envs


def test_the_presets_are_those_of_the_paper():
    assert presets.EXPERT["full"].steps == 16_000_000
    for name in ("cpu", "full"):
        assert presets.IMITATION[name] == presets.IMITATION["full"]
        imitation = presets.IMITATION[name]
        assert (imitation.rounds, imitation.envs, imitation.batch) == (50, 1, 64)
        assert (imitation.learning_rate, imitation.expert_rounds) == (1e-3, 45)
        assert presets.FINE_TUNE[name].learning_rate == 1e-3


def test_fine_tuning_on_another_number_of_sheets_is_refused(expert, point_env, tmp_path):
    env = point_env()
    env.config.materials = ("foam", "mica", "plastic")
    with pytest.raises(ValueError, match=r"trained with 1 sheets .* with 3; .* materials=\('aluminium',\)"):
        train_policy(env, presets.FINE_TUNE["smoke"], tmp_path, start=expert, quiet=True)
