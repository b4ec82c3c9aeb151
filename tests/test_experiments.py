"""Every experiment at toy size, through its command line."""

import dataclasses
import json

import numpy as np
import pytest

from experiments import adapt, expert, headlines, launch, paper, surrogate
from mjx_cutting.learning import checkpoint


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
    assert told["wall_s"] > 0
    assert len(json.loads((out / "expert" / "metrics.jsonl").read_text().splitlines()[0])["episodes"]) == 2
    for name in ("reward.png", "training.png", "terms_source.png", "over_time_surrogate.png"):
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


def summary(rewards, distance, jitter=0.1):
    def strategy(name):
        table = {
            "reward": rewards[name],
            "time_s": 10.0,
            "path_deviation_mm": 1.0,
            "load_n": 5.0,
            "mrv_mm3": 50.0,
        }
        return {
            "reward_min": rewards[name],
            "by_material": {"all": {**table, "load_per_mrv_n_mm3": 0.1}},
            "sensitivity": {
                "distance": distance[name],
                "jitter": jitter,
                "expert_jitter": 0.05,
                "lag_s": 0.1,
            },
        }

    strategies = {name: strategy(name) for name in rewards}
    return {domain: {"strategies": strategies} for domain in ("source", "surrogate", headlines.MOVING)}


def test_headlines_follow_their_rules():
    names = ("baseline", "expert", "bc", "dagger", "fine_tune", "re_train", "low_pass")
    rewards = dict(zip(names, (-1.0, -0.6, -0.5, -0.5, -0.5, -2.0, -0.7), strict=True))
    distance = dict(zip(names, (1.0, 0.5, 0.2, 0.1, 0.4, 0.9, 0.6), strict=True))
    told = headlines.judged(summary(rewards, distance))
    assert told["final_rewards"]["judgement"] == "reproduced"
    assert told["imitation_tracks"]["judgement"] == "reproduced"
    assert told["higher_minima"]["judgement"] == "reproduced"
    assert told["robot_table"]["judgement"] == "not comparable"
    assert told["less_load"]["judgement"] == "not reproduced"  # equal load is not less
    swapped = {**distance, "bc": 0.1, "dagger": 0.2}
    told = headlines.judged(summary(rewards, swapped))
    assert told["imitation_tracks"]["judgement"] == "not reproduced"
    assert told["imitation_tracks"]["ours"]["bc"] == 0.1
