"""A residual's dependence is found where it is and not where it is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from mjx_cutting.tracing.fitting.prediction import Prediction
from mjx_cutting.tracing.telling.dependence import dependences


@pytest.fixture(scope="module")
def dataset(mill):
    return mill()


def _left(dataset, added, seed=0) -> list[Prediction]:
    """Predictions whose residual is white noise plus `added(time, angle, index)`."""
    generator = np.random.default_rng(seed)
    found = []
    for index, trial in enumerate(dataset.trials):
        angle = 2 * np.pi * trial.spindle_speed_rev_s * trial.time_s
        noise = generator.normal(size=trial.force_n.shape)
        extra = np.zeros_like(noise) + np.asarray(added(trial.time_s, angle, index)).reshape(len(angle), -1)
        found.append(
            Prediction(
                trial.file,
                trial.time_s,
                angle,
                trial.force_n,
                trial.force_n - noise - extra,
                40.0,
                np.zeros(3),
            )
        )
    return found


def _coloured(seed: int, length: int) -> np.ndarray:
    white = np.random.default_rng(100 + seed).normal(size=length)
    return np.convolve(white, np.ones(8) / 2)[:length]


def _found(dataset, added, seed=0) -> set[str]:
    tests = dependences(dataset, _left(dataset, added, seed), teeth=4, orders=12)
    return {each.covariate for each in tests if each.found}


def test_white_noise_depends_on_nothing(dataset):
    wrong = [_found(dataset, lambda t, a, i: 0 * t, seed) for seed in range(20)]
    assert wrong == [set()] * 20


def test_orders_that_aliasing_puts_at_one_frequency_are_no_dependence(dataset):
    """At this speed tooth order 12 is sampled where order 11 is: their difference can be anything."""
    rate_hz = 1.0 / float(np.diff(dataset.trials[0].time_s[:2])[0])
    tests = []
    for seed in range(5):
        noise = _left(dataset, lambda t, a, i: 0 * t, seed)
        turned = [replace(each, angle_rad=2 * np.pi * rate_hz / 23.00001 * each.time_s) for each in noise]
        tests += dependences(dataset, turned, teeth=4, orders=12)
    assert not [each for each in tests if each.found]
    lines = [each for each in tests if each.covariate in ("tooth phase", "spindle order")]
    assert len(lines) == 10 and max(each.share for each in lines) < 0.05


@pytest.mark.parametrize(
    ("covariate", "added"),
    [
        ("spindle order", lambda t, a, i: np.cos(a + i)),
        ("tooth phase", lambda t, a, i: np.cos(4 * a + i)),
        ("time in trial", lambda t, a, i: 3 * t / t[-1]),
        ("previous force", lambda t, a, i: _coloured(i, len(t))),
    ],
)  # fmt: skip
def test_each_covariate_is_told(dataset, covariate, added):
    assert covariate in _found(dataset, added)


def test_a_level_that_goes_with_the_feed_is_told(dataset):
    place = stats.rankdata([trial.feed_speed_m_s for trial in dataset.trials])

    def level(time, angle, index):
        return np.ones((len(time), 1)) * np.array([0.0, 0.4, -1.0]) * (place[index] - 3.5)

    assert "feed" in _found(dataset, level)


@pytest.mark.parametrize(
    ("covariate", "added"),
    [
        ("time in trial", lambda t, a, i: 3 * t / t[-1]),
        ("spindle order", lambda t, a, i: np.cos(a + i)),
        ("another axis", lambda t, a, i: 2 * _coloured(i, len(t))),
    ],
)  # fmt: skip
def test_what_levels_leave_is_no_share_of_what_goes_on_within_a_trial(dataset, covariate, added):
    """Levels of ten times the noise or more hold nearly all of what is left; what is told of the rest stays,
    as a share of the force."""
    levels = 10.0 * np.random.default_rng(7).choice([-2.0, -1.0, 1.0, 2.0], len(dataset.trials))

    def told(times):
        def more(time, angle, index):
            level = times * levels[index] * np.array([1.0, -1.0, 1.0])
            return level + np.asarray(added(time, angle, index)).reshape(len(time), -1)

        tests = dependences(dataset, _left(dataset, more), 4, 12)
        return next(each for each in tests if each.covariate == covariate)

    beside, alone = told(1.0), told(0.0)
    assert beside.share < 0.1 < alone.share
    assert beside.of_force == pytest.approx(alone.of_force, rel=0.05)


def test_a_tie_between_axes_is_told(dataset):
    generator = np.random.default_rng(5)

    def both(time, angle, index):
        common = generator.normal(size=len(time))
        return np.stack([common, common, 0 * common], axis=1)

    assert _found(dataset, both) == {"another axis"}


def test_a_factor_that_goes_with_the_place_is_told_from_one_that_goes_with_time(dataset):
    """The trials run at other feeds: a place comes at another time in each."""
    lengths = [trial.feed_speed_m_s * trial.time_s[-1] for trial in dataset.trials]

    def tests(share):
        found = _left(dataset, lambda t, a, i: 0 * t)
        ways = [(t.feed_speed_m_s * t.time_s if share else t.time_s) for t in dataset.trials]
        most = max(lengths) if share else max(t.time_s[-1] for t in dataset.trials)
        pairs = zip(found, ways, strict=True)
        scaled = [
            replace(p, predicted_n=p.measured_n / (1.0 + 0.4 * way / most)[:, None]) for p, way in pairs
        ]
        return {each.covariate for each in dependences(dataset, scaled, teeth=4, orders=12) if each.found}

    assert "position" in tests(True)
    assert "position" not in tests(False) and "time in trial" in tests(False)


@pytest.mark.parametrize("covariate", ["spindle speed", "feed with spindle speed"])
def test_a_factor_of_whole_trials_goes_with_their_conditions(dataset, covariate):
    """Nine trials of three speeds and three feeds; a bias of each trial's own has taken the means away."""
    like, trials, predictions = dataset.trials[0], [], []
    for index in range(9):
        speed, feed = index // 3 - 1, index % 3 - 1
        name, drawn = f"{index}.csv", _left(dataset, lambda t, a, i: 0 * t, seed=index)[0]
        trials.append(
            replace(like, file=name, spindle_speed_rev_s=50.0 + 10 * speed, feed_speed_m_s=0.01 * 2.0**feed)
        )
        factor = 1.0 - 0.1 * (speed if covariate == "spindle speed" else speed * feed)
        told = drawn.predicted_n / factor
        told = told + (drawn.measured_n - told).mean(axis=0)
        bias = (told - drawn.predicted_n / factor)[0]
        predictions.append(replace(drawn, file=name, predicted_n=told, bias_n=bias))
    found = dependences(replace(dataset, trials=tuple(trials)), predictions, teeth=4, orders=12)
    factors = {each.covariate for each in found if each.found}
    assert covariate in factors and not factors & {"feed", "cut length", "clock time", "radial depth"}


def test_a_factor_of_each_trials_own_ties_neither_axes_nor_teeth(dataset):
    """A force that is larger by some hundredths as a whole has its lines at tooth passing, on all axes."""
    drawn = _left(dataset, lambda t, a, i: 0 * t)
    size = 1.0 + 0.03 * np.array([1.0, -1.0, 0.5, -0.8, 0.9, -0.6])
    larger = [
        replace(p, measured_n=p.predicted_n * own + p.residual_n) for p, own in zip(drawn, size, strict=True)
    ]
    found = [each for each in dependences(dataset, larger, teeth=4, orders=12) if each.found]
    assert [each.covariate for each in found] == ["trial"]
    energy = sum(np.sum((own - 1.0) ** 2 * p.predicted_n**2) for own, p in zip(size, drawn, strict=True))
    whole = sum(np.sum(p.measured_n**2) for p in larger)
    assert found[0].factor == pytest.approx(np.sqrt(np.mean((size - 1.0) ** 2)), rel=0.1)
    assert found[0].of_force == pytest.approx(np.sqrt(energy / whole), rel=0.05)
    assert all(each in found[0].look_for for each in ("t01.csv +3%", "t02.csv -3%"))


def test_a_factor_that_comes_and_goes_by_the_clock_is_told(dataset):
    """One and a half swings over twelve trials, which no straight line follows; shuffled, it is scatter."""
    clocks = 150.0 * np.arange(12) + 20.0 * np.random.default_rng(3).normal(size=12)
    trials = tuple(
        replace(dataset.trials[index % 6], file=f"t{index}.csv", clock_start_s=clock)
        for index, clock in enumerate(clocks)
    )
    longer = replace(dataset, trials=trials)

    def clock_among(order) -> list[str]:
        swing = 0.05 * np.sin(2.0 * np.pi * clocks / 1200.0 + 0.4)[order]
        left = _left(longer, lambda t, a, i: swing[i] * trials[i].force_n)
        found = [each for each in dependences(longer, left, teeth=4, orders=12) if each.found]
        return [each.look_for for each in found if each.covariate == "clock time"]

    (told,) = clock_among(np.arange(12))
    assert "comes and goes" in told
    assert clock_among(np.random.default_rng(0).permutation(12)) == []
