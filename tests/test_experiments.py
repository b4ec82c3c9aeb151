"""Every experiment at toy size, through its command line."""

import dataclasses
import json
import time

import numpy as np
import pytest

from experiments import (
    adapt,
    departures,
    expert,
    fine_tuning,
    headlines,
    judging,
    launch,
    paper,
    paper_figures,
    surrogate,
    traced,
)
from experiments.invocations import Invocations
from experiments.published import SHEETS, TABLE
from mjx_cutting.evaluation import rollouts
from mjx_cutting.learning import checkpoint
from mjx_cutting.learning.environment import make_env
from mjx_cutting.learning.expert import initial_policy
from mjx_cutting.learning.settings import PPOConfig
from mjx_cutting.sim.config import EnvConfig


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_expert_experiment_measures_before_and_after(tmp_path):
    out = tmp_path / "out"
    arguments = ["--preset", "smoke", "--out", str(out), "--quiet", "--rollouts", "3", "--seed", "4"]
    assert launch.launch(expert.run, expert.PRESETS, arguments) == 0
    told = json.loads((out / "expert.json").read_text())
    assert set(told["strategies"]) == {"baseline", "untrained", "expert"}
    assert told["strategies"]["baseline"]["all"]["episodes"] == 3
    assert told["strategies"]["baseline"]["all"]["completed"] == 1.0
    assert told["steps"] == 512
    assert json.loads((out / "config.json").read_text())["seed"] == 4
    policy = checkpoint.load_policy(out / "expert")
    assert policy.description.action_names[-1] == "depth"
    assert json.loads(policy.provenance)["steps"] == 512
    tuned = tmp_path / "tuned"
    arguments = ["--preset", "smoke", "--expert", str(out / "expert"), "--out", str(tuned), "--quiet"]
    assert launch.launch(fine_tuning.run, fine_tuning.PRESETS, arguments) == 0
    told = json.loads((tuned / "fine_tuning.json").read_text())
    assert set(told["policies"]) == {"expert", "paper, seed 0"}
    assert {table["all"]["episodes"] for table in told["policies"].values()} == {4}
    assert told["policies"]["paper, seed 0"]["all"] != told["policies"]["expert"]["all"]
    assert launch.launch(fine_tuning.run, fine_tuning.PRESETS, [*arguments, "--variants", "bold"]) == 2
    apart = tmp_path / "apart"
    arguments = ["--preset", "smoke", "--expert", str(out / "expert"), "--out", str(apart)]
    assert launch.launch(departures.run, departures.PRESETS, arguments) == 0
    told = json.loads((apart / "departures.json").read_text())
    assert set(told["set_points"]) == {"expert", *departures.HELD}
    means, deep = (told["set_points"][name] for name in ("expert's means", "1 mm deep"))
    assert deep["set_points"] == {**means["set_points"], "depth": 0.001} and deep["reward"] != means["reward"]
    assert set(told["disturbance"]["1"]) == {
        "expert", "bc, seed 0", "dagger, seed 0", "bc, 2 episodes", "dagger, 2 episodes",
    }  # fmt: skip
    assert all(row["distance"] >= 0.0 for row in told["disturbance"]["1"].values())


def test_set_points_held_all_the_way_are_asked_for_whatever_is_seen():
    config = EnvConfig()
    policy = initial_policy(make_env(config), PPOConfig(hidden=(8,), value_hidden=(8,)))
    seen = np.random.default_rng(0).normal(size=(7, 15)).astype(np.float32)
    asked = {
        "stiffness_x": 360.0, "stiffness_y": 700.0, "stiffness_z": 80.0,
        "feed_adjustment": 0.1, "depth": 0.0005,
    }  # fmt: skip
    acted = np.asarray(departures.held(policy, asked, config).policy.apply(seen))
    share = 0.5 * (acted + 1.0)
    np.testing.assert_allclose(50.0 * 60.0 ** share[:, :3], [[360.0, 700.0, 80.0]] * 7, rtol=1e-4)
    np.testing.assert_allclose(acted[:, 3:], [[0.0, -0.5]] * 7, atol=1e-5)
    active = np.array([[True], [True], [True], [False]])
    rolled = rollouts.Rollouts(
        active=active, observation=np.zeros((4, 1, 15)), clean=None, action=acted[:4, None],
        reward=np.zeros((4, 1)), metrics={"contact_s": np.array([[0.0], [0.02], [0.0], [0.02]])},
        material=np.zeros(1, int), period_s=0.02,
    )  # fmt: skip
    assert departures.cutting_means(rolled, policy) == pytest.approx(asked, rel=1e-3)
    with pytest.raises(ValueError, match="depth"):
        departures.held(policy, {**asked, "depth": 0.01}, config)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_paper_experiment_judges_every_headline_and_goes_on_where_it_stopped(tmp_path):
    out, results = tmp_path / "out", tmp_path / "results.json"
    arguments = ["--preset", "smoke", "--out", str(out), "--results", str(results), "--quiet"]
    assert launch.launch(paper.run, paper.PRESETS, arguments) == 0
    told = json.loads(results.read_text())
    assert set(told["strategies"]) == {
        "baseline",
        "expert",
        "fine_tuned",
        "re_trained",
        "bc",
        "dagger",
        "low_pass",
    }
    assert set(told["headlines"]) == {h.name for h in headlines.HEADLINES}
    judgements = {h["judgement"] for h in told["headlines"].values()}
    assert judgements <= {"reproduced", "not reproduced", "not comparable"}
    assert told["wall_s"] == pytest.approx(sum(each["wall_s"] for each in told["invocations"]), abs=0.1)
    assert set(told["strategies"]["dagger"]) == {"source", "surrogate", "surrogate_dynamics", "cell"}
    assert told["strategies"]["dagger"]["cell"]["by_material"]["all"]["episodes"] == told["episodes"]["cell"]
    for name in told["figures"]:
        assert 2_000 < (results.parent / name).stat().st_size <= paper_figures.MOST_BYTES
    assert len(json.loads((out / "expert" / "metrics.jsonl").read_text().splitlines()[0])["episodes"]) == 2
    for name in ("reward.png", "terms_source.png", "over_time_surrogate.png"):
        assert (out / name).stat().st_size > 10_000
    # the adapted policies differ from the expert; all were trained in the surrogate
    first = checkpoint.load_policy(out / "expert").layers[0][0]
    for strategy in ("bc", "dagger", "fine_tune", "re_train"):
        assert not np.array_equal(checkpoint.load_policy(out / strategy).layers[0][0], first)
    # a strategy whose training was not complete is trained again, the others are left alone
    before = {p: p.stat().st_mtime_ns for p in out.glob("*/policy.npz")}
    (out / "bc" / adapt.DONE).unlink()
    config = dataclasses.replace(paper.PRESETS["smoke"], out=out, quiet=True)
    adapt.adapt_all(config, out)
    after = {p: p.stat().st_mtime_ns for p in out.glob("*/policy.npz")}
    assert [p.parent.name for p in before if before[p] != after[p]] in ([], ["bc"])
    assert (out / "bc" / adapt.DONE).exists()


def test_unknown_preset_and_bad_values_are_refused(capsys):
    assert launch.launch(expert.run, expert.PRESETS, ["--preset", "huge"]) == 2
    assert "expected one of smoke" in capsys.readouterr().err
    with pytest.raises(SystemExit) as stop:
        launch.launch(expert.run, expert.PRESETS, ["--preset", "smoke", "--nonsense", "1"])
    assert stop.value.code == 2
    capsys.readouterr()
    with pytest.raises(SystemExit) as stop:
        launch.launch(expert.run, expert.PRESETS, ["--preset=smoke", "--ppo.steps", "0"])
    assert stop.value.code == 2
    assert "got steps=0; expected at least 1" in capsys.readouterr().err


def test_interrupt_has_its_exit_status():
    def interrupted(config):
        """Stop."""
        raise KeyboardInterrupt("stopped")

    assert launch.launch(interrupted, expert.PRESETS, ["--preset", "smoke"]) == 130


def test_declared_disturbance_has_its_period_and_magnitude():
    declared = surrogate.Disturbance(duration_s=4.7, rate_hz=100.0, trials=400)
    time_s, residual = surrogate.declared_trials(declared)
    assert residual.shape == (400, 470, 3)
    np.testing.assert_allclose(np.diff(time_s), 0.01)
    own = residual - residual.mean(axis=0)
    np.testing.assert_allclose(
        own.std(axis=(0, 1)), np.hypot(declared.trial_std_n, declared.noise_std_n), rtol=0.1
    )
    common = residual.mean(axis=0)
    np.testing.assert_allclose(common[47:], common[:-47], atol=0.2)  # one period later
    other = surrogate.declared_trials(dataclasses.replace(declared, seed=1))[1]
    assert not np.allclose(other, residual)


def test_time_is_summed_over_the_commands(tmp_path, monkeypatch):
    monkeypatch.setattr("experiments.invocations.EVERY_S", 0.01)
    with Invocations(tmp_path, lambda: 100.0) as first:
        time.sleep(0.3)  # killed from here on, it would still be counted
        beaten = json.loads(first.path.read_text())[-1]["wall_s"]
    assert beaten >= 0.1
    with Invocations(tmp_path, lambda: 1e6) as second:
        assert 100.1 < second.wall_s < 110
        assert len(second.all) == 3
        assert set(second.all[1]) == {"began_utc", "wall_s"}
    (tmp_path / "new").mkdir()
    with Invocations(tmp_path / "new") as other:
        assert other.wall_s < 10


def test_traced_strategies_get_what_their_names_say(tmp_path, monkeypatch):
    asked = {}

    def record(config, folder, expert, effects, sheet):
        (folder / "trace").mkdir(parents=True)
        (folder / traced.TOLD).write_text(json.dumps({"named": named}))
        return folder

    def adapted(config, strategy, expert, gp, folder, resume):
        asked[folder.name] = (strategy, expert.name, gp and gp.name, config.model and config.model.name)
        folder.mkdir()
        return folder

    monkeypatch.setattr(traced, "record_and_trace", record)
    monkeypatch.setattr(adapt, "adapt_expert", adapted)
    expert_run, config = tmp_path / "expert", adapt.PRESETS["smoke"]
    for named, folder in ((["radial_runout"], tmp_path / "a"), ([], tmp_path / "b")):
        asked.clear()
        folders, told = traced.adapt_traced(config, folder, expert_run, None)
        assert told["named"] == named
        assert tuple(folders) == (traced.STRATEGIES if named else ("gp_only",))
        assert asked["gp_only"] == ("dagger", "expert", "gp_before.npz", None)
        if named:
            assert asked["effect_only"] == ("fine_tune", "expert", None, "model.json")
            assert asked["effect_and_gp"] == ("dagger", "effect_only", "gp_after.npz", "model.json")
    asked.clear()
    traced.adapt_traced(config, tmp_path / "a", expert_run, None)
    assert asked == {}  # complete stages are left alone


def summary(rewards, distance, jitter=0.1):
    points = {
        "approach_feed_adjustment": 0.1,
        "cutting_feed_adjustment": 0.9,
        "approach_stiffness_normal_s2": 400.0,
        "cutting_stiffness_normal_s2": 100.0,
        "depth_spread_mm": 0.05,
    }

    def strategy(name):
        row = {
            "reward": rewards[name],
            "time_s": 10.0,
            "path_deviation_mm": 1.0,
            "load_n": 5.0,
            "mrv_mm3": 50.0,
            "load_per_mrv_n_mm3": 0.1,
        }
        return {
            "reward_min": rewards[name],
            "reward_std": 0.2,
            "by_material": {each: dict(row) for each in ("all", *SHEETS)},
            "sensitivity": {
                "distance": distance[name],
                "jitter": jitter,
                "expert_jitter": 0.05,
                "lag_s": 0.1,
            },
            "set_points": dict(points),
        }

    strategies = {name: strategy(name) for name in rewards}
    tests = {f"{a} - fine_tune": {"p_value": 0.5} for a in ("bc", "dagger")}
    return {
        domain: {"strategies": strategies, "welch_reward": tests}
        for domain in ("source", "surrogate", judging.MOVING)
    }


NAMES = ("baseline", "expert", "bc", "dagger", "fine_tune", "re_train", "low_pass")
REWARDS = dict(zip(NAMES, (-1.0, -0.6, -0.5, -0.45, -0.55, -2.0, -0.7), strict=True))
DISTANCE = dict(zip(NAMES, (1.0, 0.5, 0.2, 0.1, 0.4, 0.9, 0.6), strict=True))


def test_headlines_follow_their_rules():
    told = headlines.judged(summary(REWARDS, DISTANCE))
    assert len(told) == len(headlines.HEADLINES)  # no two of one name
    reproduced = {name for name, headline in told.items() if headline["judgement"] == "reproduced"}
    assert reproduced == {
        "final_rewards", "imitation_tracks", "fine_tuned_lags", "rewards_differ_little", "higher_minima",
        "dagger_deviates_most", "approach", "after_impact", "depth_is_constant", "low_pass_is_no_cure",
        "fine_tuned_beats_expert", "imitation_equals_fine_tuning", "re_trained_is_worst",
    }  # fmt: skip
    assert told["robot_table"]["judgement"] == "not comparable"
    assert told["re_training_dips"]["missing"] == "this run has no re_train"
    assert told["less_load"]["judgement"] == "not reproduced"  # equal load is not less
    swapped = {**DISTANCE, "bc": 0.1, "dagger": 0.2}
    told = headlines.judged(summary(REWARDS, swapped))
    assert told["imitation_tracks"]["judgement"] == "not reproduced"
    assert told["imitation_tracks"]["ours"]["bc"] == 0.1


def test_orderings_of_the_robot_must_hold_on_every_sheet_of_the_cell():
    results = summary(REWARDS, DISTANCE)
    results["cell"] = json.loads(json.dumps(results["source"]))
    rows = results["cell"]["strategies"]

    def judge(name):
        return headlines.judged(results)[name]["judgement"]

    for sheet in SHEETS:
        rows["bc"]["by_material"][sheet] |= {"load_n": 4.0, "path_deviation_mm": 0.5}
        rows["dagger"]["by_material"][sheet] |= {"load_n": 4.0, "path_deviation_mm": 0.5, "time_s": 11.0}
        more = 1.0 if sheet == "aluminium" else 9.0
        rows["re_train"]["by_material"][sheet] |= {"load_n": more, "mrv_mm3": 60.0, "path_deviation_mm": 0.1}
    held = ("less_load", "dagger_is_slower", "re_trained_load", "re_trained_against_expert")
    assert all(judge(name) == "reproduced" for name in held)
    rows["bc"]["by_material"]["mica"]["load_n"] = 6.0
    rows["dagger"]["by_material"]["plastic"]["time_s"] = 9.0
    rows["re_train"]["by_material"]["aluminium"]["load_n"] = 6.0
    rows["re_train"]["by_material"]["foam"]["mrv_mm3"] = 40.0
    assert all(judge(name) == "not reproduced" for name in held)
    assert headlines.judged(results)["less_load"]["ours"]["bc_less_load_n"] == 4


@pytest.mark.parametrize(
    ("last", "depth", "judgement"),
    [(16e6, 0.8, "reproduced"), (16e6, 0.0, "not reproduced"), (4e6, 0.8, "not comparable")],
)
def test_dip_is_looked_for_where_training_was_long_enough(last, depth, judgement):
    share = np.linspace(0, 1, 300)
    curve = -3 + 2 * share - depth * np.exp(-(((share - 0.35) / 0.05) ** 2))
    rewards = np.stack([curve, curve + 0.01], axis=1)
    rewards[10, 0] = np.nan
    told = headlines.judged(summary(REWARDS, DISTANCE), {"re_train": (share * last, rewards)})
    assert told["re_training_dips"]["judgement"] == judgement


def test_published_table_is_whole():
    assert TABLE["baseline"]["foam"]["mrv_mm3"] == 331
    assert list(TABLE["re_train"]["cardboard"].values()) == [45.4, 6.83, 16.0, 80.2]
    assert all(tuple(rows) == SHEETS for rows in TABLE.values())


def test_when_an_expert_had_learned_is_read_from_its_metrics(tmp_path):
    # 0 to 100 in a straight line over 1,000 iterations of two seeds; no episode ends in every tenth
    lines = [
        {
            "steps": 128 * i,
            "wall_s": 0.5 * i,
            "episodes": [i % 10 > 0, 4],
            "episode_return": [0.1 * i, 0.1 * i],
        }
        for i in range(1, 1001)
    ]
    (tmp_path / "metrics.jsonl").write_text("\n".join(json.dumps(line) for line in lines) + "\n")
    told = paper.learned(tmp_path)
    assert told["steps"] == pytest.approx(0.95 * 64_000, rel=0.01)
    assert told["wall_s"] == pytest.approx(0.5 * told["steps"] / 64)
    assert told["reward"] == pytest.approx(94.0, abs=1.0)
