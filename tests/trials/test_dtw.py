"""The wavefront against a plain dynamic programme, and against dtaidistance where they define the same."""

from __future__ import annotations

import numpy as np
import pytest
from dtaidistance import dtw_ndim
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from mjx_cutting.trials import dtw


def oracle(x, y, weight=2.0, radius=None, open_end=True):
    """Returns (distance, accumulated costs) by the textbook double loop."""
    x, y = (np.asarray(a, float).reshape(len(a), -1) for a in (x, y))
    n, m = len(x), len(y)
    D = np.full((n, m), np.inf)
    for i in range(n):
        for j in range(m):
            if radius is not None and abs(i - j) > radius:
                continue
            d = np.sqrt(np.sum((x[i] - y[j]) ** 2))
            if i == j == 0:
                D[i, j] = d
                continue
            options = [
                D[i - 1, j] + d if i else np.inf,
                D[i, j - 1] + d if j else np.inf,
                D[i - 1, j - 1] + weight * d if i and j else np.inf,
            ]
            D[i, j] = min(options)
    last = D[-1] if open_end else np.where(np.arange(m) == m - 1, D[-1], np.inf)
    costs = last / (n + np.arange(m) + 1) if weight == 2.0 else last
    return costs.min(), D


def cost_of(path, x, y, weight):
    x, y = (np.asarray(a, float).reshape(len(a), -1) for a in (x, y))
    d = np.sqrt(np.sum((x[path.query] - y[path.reference]) ** 2, -1))
    diagonal = (np.diff(path.query) == 1) & (np.diff(path.reference) == 1)
    return d[0] + np.sum(d[1:] * np.where(diagonal, weight, 1.0))


@pytest.mark.parametrize("radius", [None, 0, 3])
@pytest.mark.parametrize("open_end", [True, False])
@pytest.mark.parametrize("step", ["symmetric2", "symmetric1"])
def test_random_series_against_the_oracle(radius, open_end, step):
    rng = np.random.default_rng(0)
    series = [rng.normal(size=(n, 2)) for n in (9, 14, 14, 11)]
    if radius == 0:
        series = [s[:9] for s in series]
    got = dtw.distances(series, radius=radius, open_end=open_end, step=step)
    weight = dtw.STEPS[step]
    for q in range(4):
        for r in range(4):
            expected = 0.0 if q == r else oracle(series[q], series[r], weight, radius, open_end)[0]
            np.testing.assert_allclose(got[q, r], expected, rtol=1e-12)
            if q == r or not np.isfinite(expected):
                continue
            path = dtw.warp(series[q], series[r], radius=radius, open_end=open_end, step=step)
            assert path.distance == pytest.approx(expected, rel=1e-12)
            assert path.query[0] == path.reference[0] == 0
            assert path.query[-1] == len(series[q]) - 1 and path.reference[-1] == path.end
            steps = np.stack([np.diff(path.query), np.diff(path.reference)])
            assert steps.min() >= 0 and steps.max() <= 1 and steps.sum(0).min() >= 1
            total = cost_of(path, series[q], series[r], weight)
            if step == "symmetric2":
                total /= len(series[q]) + path.end + 1
            assert total == pytest.approx(expected, rel=1e-12)


def test_closed_end_symmetric1_is_dtaidistances():
    rng = np.random.default_rng(1)
    series = [rng.normal(size=(40, 3)).cumsum(0) for _ in range(3)]
    got = dtw.distances(series, open_end=False, step="symmetric1")
    for q in range(3):
        for r in range(3):
            expected = dtw_ndim.distance(series[q], series[r], inner_dist="euclidean")
            assert got[q, r] == pytest.approx(expected, rel=1e-10)


finite = st.floats(-1e3, 1e3, allow_nan=False, width=32)


@settings(max_examples=40, deadline=None)
@given(
    hnp.arrays(float, st.integers(2, 8), elements=finite),
    hnp.arrays(float, st.integers(2, 8), elements=finite),
    st.sampled_from([None, 1, 4]),
)
def test_any_short_series_against_the_oracle(x, y, radius):
    # one padded size, so that this compiles once
    pad = np.zeros(9)
    got = dtw.distances([x, y, pad], radius=radius)
    np.testing.assert_allclose(got[0, 1], oracle(x, y, radius=radius)[0], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(got[1, 0], oracle(y, x, radius=radius)[0], rtol=1e-9, atol=1e-9)


def test_edge_cases():
    constant = np.ones((6, 1))
    assert dtw.distances([constant, constant])[0, 1] == 0.0
    assert dtw.distances([constant, constant + 2.0])[0, 1] > 0
    two = dtw.warp([0.0, 1.0], [0.0, 1.0])
    assert two.distance == 0.0
    np.testing.assert_array_equal(two.query, [0, 1])
    one = dtw.distances([np.arange(5.0)])
    np.testing.assert_array_equal(one, [[0.0]])


def test_an_open_end_stops_where_the_query_stops():
    t = np.linspace(0, 3, 60)
    path = dtw.warp(np.sin(t[:40]), np.sin(t))
    assert path.end == 39 and path.distance == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_array_equal(path.query, path.reference)
    forth = dtw.distances([np.sin(t[:40]), np.sin(t)])
    assert forth[0, 1] == pytest.approx(0.0, abs=1e-12) and forth[1, 0] > 0.01  # not symmetric


def test_a_radius_that_allows_no_path_gives_infinity():
    x, y = np.zeros(20), np.zeros(5)
    assert np.isinf(dtw.distances([x, y], radius=3)[0, 1])
    assert np.isinf(dtw.warp(x, y, radius=3).distance) and len(dtw.warp(x, y, radius=3).query) == 0


@pytest.mark.parametrize(
    ("series", "options", "message"),
    [
        ([[0.0, np.nan, 1.0], [0.0, 1.0]], {}, "series 0 is not finite at sample 1"),
        ([[0.0], [0.0, 1.0]], {}, "at least 2 samples"),
        ([np.zeros((3, 2)), np.zeros((3, 1))], {}, "channels"),
        ([[0.0, 1.0], [0.0, 1.0]], {"step": "asymmetric"}, "symmetric2, symmetric1"),
        ([[0.0, 1.0], [0.0, 1.0]], {"radius": -1}, "at least 0"),
    ],
)
def test_bad_input_is_named(series, options, message):
    with pytest.raises(ValueError, match=message):
        dtw.distances(series, **options)
