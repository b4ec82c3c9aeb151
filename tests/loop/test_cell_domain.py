"""The virtual cell as a domain of the evaluation."""

import jax
import numpy as np
import pytest

from mjx_cutting.deploy.export import build
from mjx_cutting.deploy.export_check import Lockstep
from mjx_cutting.deploy.runtime import PolicyRuntime
from mjx_cutting.deploy.virtual_cell import Cell
from mjx_cutting.deploy.virtual_cell.hidden import from_dict
from mjx_cutting.evaluation import controllers, metrics
from mjx_cutting.evaluation.evaluate import EvaluateConfig, run_domains, write_results
from mjx_cutting.learning import networks
from mjx_cutting.learning.environment import describe, make_env
from mjx_cutting.learning.policy import Policy
from mjx_cutting.loop.cell_cut import cell_config, reward
from mjx_cutting.loop.cell_domain import DECLARED, cell_domain
from mjx_cutting.sim.config import EnvConfig

ENV = EnvConfig(approach_m=0.005, cut_m=0.01, max_episode_s=4.0, materials=("mica", "plastic"))
FORCE = (7, 8, 9)


@pytest.fixture(scope="module")
def policy():
    net = networks.make_networks(15, 5, (8,), (8,), "tanh")
    layers = networks.to_layers(net.policy_network.init(jax.random.PRNGKey(0)))
    scale = {"mean": np.zeros(15, np.float32), "std": np.ones(15, np.float32)}
    return Policy(
        **scale, layers=layers, value_layers=None, activation="tanh", description=describe(make_env(ENV))
    )


@pytest.fixture(scope="module")
def served(policy):
    acting = {"policy": controllers.direct(policy), "low_pass": controllers.low_passed(policy, FORCE)}
    return cell_domain(cuts=3, seed=5)(ENV, acting)


def test_amounts_and_reward_are_those_of_the_cut_itself(served, policy):
    rolled = served["policy"]
    assert list(rolled.material) == [0, 1, 0]
    measures = metrics.episodes(rolled)
    for i in range(2):
        cell = Cell(cell_config(ENV, ENV.materials[i], 5 + i), from_dict(DECLARED))
        score = Lockstep(cell, PolicyRuntime(build(policy))).fly(longest_s=ENV.max_episode_s).score
        assert score["completed"]
        assert measures["reward"][i] == pytest.approx(reward(ENV, score), rel=1e-5)
        assert measures["mrv_mm3"][i] == pytest.approx(score["mrv_mm3"], rel=1e-5)
        assert measures["load_n"][i] == pytest.approx(score["load_n"], rel=1e-5)
        assert measures["completed"][i] == 1.0 and measures["failed"][i] == 0.0
        # the server's run-up, in which the policy does not act, counts as time
        assert measures["time_s"][i] == pytest.approx(score["time_s"], rel=1e-5)
        assert 0.1 < score["time_s"] - 0.02 * rolled.active[:, i].sum() < 0.6


def test_actions_are_the_controller_s_on_what_the_cell_sent(served, policy):
    rolled = served["policy"]
    on = rolled.active[:, 0]
    seen = rolled.observation[on, 0].astype(np.float32)
    np.testing.assert_allclose(rolled.action[on, 0], policy.apply(seen), atol=1e-5)
    controller = controllers.low_passed(policy, FORCE)
    filtered = served["low_pass"]
    seen = filtered.observation[filtered.active[:, 0], 0].astype(np.float32)
    memory, wished = controller.begin(seen[0]), []
    for observation in seen:
        memory, action = controller.act(memory, observation)
        wished.append(action)
    np.testing.assert_allclose(filtered.action[: len(seen), 0], wished, atol=1e-4)
    assert np.abs(filtered.action[: len(seen), 0] - policy.apply(seen)).max() > 1e-3


def test_set_points_change_phase_at_the_first_contact(served, policy):
    rolled = served["policy"]
    told = metrics.set_points(rolled, policy.description)
    touched = np.maximum.accumulate(rolled.metrics["contact_s"] > 0, axis=0)
    depth = rolled.observation[..., 11] * 1e-3 * 1e3
    assert told["cutting_depth_mm"] == pytest.approx(depth[touched & rolled.active].mean())
    assert told["approach_depth_mm"] == pytest.approx(depth[~touched & rolled.active].mean())
    stiffness = np.exp(rolled.observation[..., 14] * 6.0)[touched & rolled.active]
    assert told["cutting_stiffness_normal_s2"] == pytest.approx(np.exp(np.log(stiffness).mean()))
    assert metrics.sensitivity(rolled, policy).keys() == {"jitter"}


def test_cell_stands_beside_the_other_domains_in_the_results(served, policy, tmp_path):
    config = EvaluateConfig(policies=(tmp_path,), domain="cell", env=ENV, low_pass=True)
    asked = {}

    def cell(env, acting):
        asked.update(acting)
        return dict.fromkeys(acting, served["policy"])

    found = run_domains(config, {"policy": policy}, cell)
    assert set(found) == {"cell"}
    assert set(asked) == {"baseline", "policy", "low_pass"}
    summary = write_results(tmp_path, found, {"policy": policy}, ENV.materials)
    assert summary["cell"]["strategies"]["baseline"]["by_material"]["mica"]["episodes"] == 2
    assert (tmp_path / "over_time_cell.png").stat().st_size > 10_000
    with pytest.raises(ValueError, match="without a cell"):
        run_domains(config, {"policy": policy})


def test_effects_come_from_the_file(tmp_path):
    (tmp_path / "effects.toml").write_text("[nonsense]\nx = 1\n")
    with pytest.raises(ValueError, match="nonsense"):
        cell_domain(tmp_path / "effects.toml")
