import math

import numpy as np
import pytest
from scipy import stats

from mjx_cutting.evaluation.statistics import mean_interval, two_tailed, welch


@pytest.mark.parametrize("seed", range(5))
def test_welch_equals_scipy(seed):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(0, 1, 5 + seed), rng.normal(0.5, 3, 20)
    ours, theirs = welch(a, b), stats.ttest_ind(a, b, equal_var=False)
    assert ours.t == pytest.approx(theirs.statistic, rel=1e-12)
    assert ours.p_value == pytest.approx(theirs.pvalue, rel=1e-9)
    assert ours.degrees_of_freedom == pytest.approx(theirs.df, rel=1e-12)
    assert ours.difference == pytest.approx(a.mean() - b.mean())


def test_published_example():
    # Welch test of two samples of Ruxton 2006-style data worked by hand: n = 2 each.
    # a = 1, 3 (mean 2, var 2), b = 5, 9 (mean 7, var 8): t = -5 / sqrt(1 + 4), nu = 25 / (1 + 16).
    result = welch([1, 3], [5, 9])
    assert result.t == pytest.approx(-5 / math.sqrt(5))
    assert result.degrees_of_freedom == pytest.approx(25 / 17)


def test_p_is_two_tailed():
    # The paper's comparison on foam: t = -5 with four degrees of freedom is p = .0075 two-tailed, .0037
    # one-tailed.
    assert two_tailed(-5.0, 4.0) == pytest.approx(0.00749, abs=1e-5)
    assert two_tailed(5.0, 4.0) == two_tailed(-5.0, 4.0)
    assert two_tailed(0.0, 4.0) == pytest.approx(1.0)


def test_samples_without_spread():
    assert welch([1, 1], [1, 1]).p_value == 1.0
    assert welch([2, 2], [1, 1]).p_value == 0.0
    assert welch([2, 2], [1, 1]).t == math.inf


def test_false_alarms_have_the_stated_rate():
    rng = np.random.default_rng(0)
    p = [welch(rng.normal(0, 1, 8), rng.normal(0, 5, 20)).p_value for _ in range(2000)]
    assert np.mean(np.asarray(p) < 0.05) == pytest.approx(0.05, abs=0.015)


@pytest.mark.parametrize("sample", [[1.0], [1.0, np.nan], []])
def test_unusable_samples_are_refused(sample):
    with pytest.raises(ValueError, match="expected two or more finite"):
        welch(sample, [1, 2, 3])


def test_interval_is_that_of_student():
    values = np.asarray([[1.0, 10.0], [2.0, 10.0], [3.0, 10.0]])
    mean, low, high = mean_interval(values)
    np.testing.assert_allclose(mean, [2, 10])
    half = 4.302652729911275 / math.sqrt(3)  # t of 97.5 %, two degrees of freedom
    np.testing.assert_allclose(high - mean, [half, 0], rtol=1e-9)
    np.testing.assert_allclose(mean - low, [half, 0], rtol=1e-9)
    np.testing.assert_array_equal(mean_interval(values[:1])[1], values[0])
