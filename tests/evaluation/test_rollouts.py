import jax
import numpy as np
import pytest

from mjx_cutting.evaluation import controllers, figures, metrics, rollouts
from mjx_cutting.evaluation.evaluate import EvaluateConfig

FORCE = [7, 8, 9]


def test_disturbance_changes_only_the_force_entries(rolled):
    for r in rolled.values():
        difference = np.where(r.active[..., None], r.observation - r.clean, 0.0)
        others = [i for i in range(15) if i not in FORCE]
        np.testing.assert_array_equal(difference[..., others], 0.0)
        assert np.abs(difference[..., FORCE]).max() > 0.1


def test_disturbance_on_the_observation_leaves_the_dynamics_alone(rolled, env, policy):
    # The baseline does not look; its rollouts are those of an environment without a disturbance. The
    # policy on clean observations goes another way than on disturbed ones.
    assert (
        np.abs(rolled["clean"].action - rolled["policy"].action[: len(rolled["clean"].action)]).max() > 1e-3
    )
    np.testing.assert_array_equal(rolled["clean"].clean[0], rolled["policy"].clean[0])


def test_every_controller_faces_the_same_episodes(rolled):
    first = rolled["baseline"]
    for r in rolled.values():
        np.testing.assert_array_equal(r.material, first.material)
        np.testing.assert_array_equal(r.observation[0], first.observation[0])


def test_actions_are_those_of_the_controller_on_what_it_saw(rolled, policy):
    apply = jax.jit(lambda o: policy.apply(o))
    np.testing.assert_allclose(rolled["policy"].action, apply(rolled["policy"].observation), atol=1e-6)
    np.testing.assert_allclose(rolled["clean"].action, apply(rolled["clean"].clean), atol=1e-6)
    first = rolled["low_pass"]
    np.testing.assert_allclose(first.action[0], apply(first.observation[0]), atol=1e-5)
    assert np.abs(first.action - apply(first.observation)).max() > 1e-3


def test_episodes_end_by_completing_the_path(rolled, env):
    measures = metrics.episodes(rolled["baseline"])
    np.testing.assert_array_equal(measures["completed"], 1.0)
    np.testing.assert_array_equal(measures["failed"], 0.0)
    # 25 mm at the nominal 12.5 mm/s
    np.testing.assert_allclose(measures["time_s"], 2.0, atol=0.1)
    terms = sum(measures[name] for name in metrics.TERMS)
    np.testing.assert_allclose(measures["reward"], terms, atol=1e-5)
    assert np.all(measures["mrv_mm3"] >= 0)
    np.testing.assert_allclose(
        measures["load_per_mrv_n_mm3"], measures["load_n"] / measures["mrv_mm3"], rtol=1e-6
    )
    # nothing counts after the end
    assert not rolled["baseline"].active[-1].all() or len(set(measures["time_s"])) == 1


def test_same_seed_same_bits(rolled):
    for name in ("observation", "action", "reward", "active"):
        np.testing.assert_array_equal(getattr(rolled["again"], name), getattr(rolled["policy"], name))


def test_table_by_material_averages_its_episodes(rolled, env):
    measures = metrics.episodes(rolled["baseline"])
    table = metrics.by_material(measures, env.config.materials)
    assert table["all"]["episodes"] == 6
    assert sum(row["episodes"] for name, row in table.items() if name != "all") == 6
    for i, name in enumerate(env.config.materials):
        rows = measures["material"] == i
        assert (name in table) == rows.any()
        if rows.any():
            assert table[name]["load_n"] == pytest.approx(measures["load_n"][rows].mean())


def test_lag_of_a_shifted_signal():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(300, 2))
    for shift in (-7, 0, 5):
        y = np.roll(x, shift, axis=0) + 0.1 * rng.normal(size=x.shape)
        assert metrics.lag(x[20:-20], y[20:-20]) == shift


def test_clean_policy_is_its_own_reference(rolled, policy):
    own = metrics.sensitivity(rolled["clean"], policy)
    assert own["distance"] == pytest.approx(0, abs=1e-6)
    assert own["lag_s"] == 0.0
    assert own["jitter"] == pytest.approx(own["expert_jitter"])
    disturbed = metrics.sensitivity(rolled["policy"], policy)
    assert disturbed["distance"] > 1e-3


def test_moving_mean_is_centred():
    x = np.arange(10.0)[:, None]
    np.testing.assert_allclose(metrics._moving_mean(x, 3)[1:-1], x[1:-1])
    np.testing.assert_allclose(metrics._moving_mean(x, 3)[0], 0.5)


def test_figures_are_written_whole(rolled, env, policy, tmp_path):
    tables = {
        name: metrics.by_material(metrics.episodes(r), env.config.materials) for name, r in rolled.items()
    }
    rewards = {"source": {k: r.total("reward") for k, r in rolled.items()}}
    rewards["surrogate"] = {k: v - 0.1 for k, v in rewards["source"].items()}
    steps = np.arange(40) * 1000
    curve = -np.exp(-steps[:, None] / 1e4) + 0.1 * np.random.default_rng(0).normal(size=(40, 3))
    curve[5] = np.nan
    made = {
        "reward.png": figures.violins(rewards),
        "terms.png": figures.reward_terms(tables, env.config.materials),
        "time.png": figures.over_time(rolled, policy.description),
        "curve.png": figures.training_curves(
            {"expert": (steps, curve), "one": (steps, curve[:, 0])}, smooth=3
        ),
    }
    for name, figure in made.items():
        path = figures.save(figure, tmp_path / name)
        assert path.read_bytes()[:4] == b"\x89PNG"
        assert path.stat().st_size > 10_000


@pytest.mark.parametrize(
    "settings",
    [
        {"policies": ()},
        {"policies": ("a",), "rollouts": 1},
        {"policies": ("a",), "domain": "moon"},
        {"policies": ("a",), "domain": "surrogate"},
        {"policies": ("a",), "names": ("b", "c")},
    ],
)
def test_settings_out_of_range_are_refused(settings):
    with pytest.raises(ValueError, match="expected"):
        EvaluateConfig(**settings)


def test_one_rollout_at_least(env, policy):
    with pytest.raises(ValueError, match="got rollouts=0"):
        rollouts.roll_out(env, {"p": controllers.direct(policy)}, rollouts=0)
