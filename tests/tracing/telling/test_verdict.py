"""Which word a verdict says."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.study import make
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.telling import verdict as told
from mjx_cutting.tracing.telling.dependence import Dependence
from mjx_cutting.tracing.telling.judged import Judged

DRILL, MILL = (SimpleNamespace(tool=SimpleNamespace(kind=kind)) for kind in ("drill", "end_mill"))


def _base(error: float) -> SimpleNamespace:
    return SimpleNamespace(nrmse=error)


@pytest.mark.parametrize(("of_force", "missing"), [(0.012, False), (0.02, True)])
@pytest.mark.parametrize("covariate", ["previous force", "time in trial"])
def test_noise_that_remembers_is_nothing_missing(covariate, of_force, missing):
    """Levels of drills scatter beyond the noise, so that alone says nothing either."""
    memory = Dependence(covariate, 1e-9, 0.12, of_force, "memory")
    assert told._shown([memory], DRILL, 0.04, floor=0.0136, least=0.015) is missing
    feed = Dependence("feed", 1e-9, 0.12, 0.012, "edge law")
    assert told._shown([feed], DRILL, 0.04, floor=0.0136, least=0.015) is True


@pytest.mark.parametrize(
    ("error", "floor", "missing"),
    [(0.016, 0.005, False), (0.018, 0.005, True), (0.045, 0.021, False), (0.05, 0.021, True)],
)
def test_levels_scatter_beyond_their_noise_but_not_as_the_noise_of_a_sample(error, floor, missing):
    """A level of a noisy record is known much better than a sample of it."""
    assert told._shown([], DRILL, error, floor=floor, least=1.1 * floor) is missing


@pytest.mark.parametrize(("of_force", "missing"), [(0.007, False), (0.012, True)])
def test_what_noise_would_hide_is_nothing_missing(of_force, missing):
    """A noise of .02 and .009 beside it leave .022, which counts as noise alone."""
    lines = Dependence("spindle order", 1e-9, 0.04, of_force, "runout")
    assert told._shown([lines], MILL, 0.03, floor=0.02, least=0.022) is missing
    assert told._left([lines], error=0.021, floor=0.02, least=0.022, most=0.022) == (
        [lines] if missing else []
    )
    assert told._left([lines], error=0.023, floor=0.02, least=0.022, most=0.022) == [lines]


def test_the_colour_of_noise_is_nothing_left_of_a_model_that_leaves_no_more():
    memory = Dependence("previous force", 1e-9, 0.27, 0.006, "memory")
    feed = Dependence("feed", 1e-9, 0.12, 0.006, "edge law")
    assert told._left([memory, feed], error=0.010, floor=0.010, least=0.011, most=0.011) == [feed]
    assert told._left([memory, feed], error=0.020, floor=0.010, least=0.011, most=0.011) == [memory, feed]
    # levels scatter beyond the noise
    assert told._left([memory, feed], error=0.020, floor=0.010, least=0.011, most=0.033) == [feed]


@pytest.mark.parametrize(("nameless", "told_left"), [(True, ["spindle order"]), (False, [])])
def test_what_asks_for_a_name_is_told_though_chips_that_are_not_alike_would_hide_it(nameless, told_left):
    """Noise is .004 of the force, with chips .015: lines of .006 are beyond the one, not the other."""
    judged = Judged(0.016, 0.016, 0.015, unlike=0.015, noise=0.004)
    lines = Dependence("spindle order", 1e-9, 0.14, 0.006, "runout")
    _, _, left = told._remains([lines], judged, 1e-4, levels=False, nameless=nameless)
    assert [each.covariate for each in left] == told_left


@pytest.mark.parametrize(("factor", "word"), [(0.015, "explained"), (0.04, "partly explained")])
def test_forces_a_little_larger_in_some_trials_are_explained(factor, word):
    """Noise leaves .008 of the force; held out, each trial is off by its own factor as well."""
    share = 1.0 / (1.0 + (0.008 / factor) ** 2)
    own = Dependence("trial", 1e-9, share, factor, "sheets that are not alike", factor=factor)
    error = told.less_scatter(1.1 * factor, [own])
    assert error == pytest.approx(0.008 if factor < 0.02 else 1.1 * factor)
    assert told._word(error, 0.0093, named=True, tied=False, shown=True, left=[]) == word


@pytest.mark.parametrize(
    ("error", "p_value", "only"), [(0.008, 1e-9, True), (0.02, 1e-9, False), (0.008, 0.2, False)]
)
def test_scatter_alone_is_told_from_what_an_effect_may_explain(error, p_value, only):
    """Where the trials' own factors leave more than noise, or are not there, a name stands."""
    own = Dependence("trial", p_value, 1.0 / (1.0 + (error / 0.012) ** 2), 0.012, "sheets", factor=0.012)
    lines = Dependence("spindle order", 1e-9, 0.1, 0.005, "runout")
    assert told.only_scatter(_base(0.03), [own], floor=0.008) is only
    assert told.only_scatter(_base(0.03), [own, lines], floor=0.008) is False


@pytest.mark.parametrize(("share", "word"), [(0.006, "explained"), (0.03, "partly explained")])
def test_levels_that_scatter_by_less_than_three_times_the_noise_leave_nothing(share, word):
    """Each cut of a turning tool that wears is off by an offset of its own, of so much of the force."""
    worn, draw = make("turning", {"flank_wear": "strong"}, 700).dataset, np.random.default_rng(1)
    force = np.sqrt(np.mean([np.mean(trial.force_n**2) for trial in worn.trials if trial.kind == "cut"]))
    off = [replace(each, force_n=each.force_n + share * force * draw.normal(size=3)) for each in worn.trials]
    found = trace(replace(worn, trials=tuple(off)), effects=["flank_wear", "size_effect"])
    assert [kind.name for kind in found.kinds] == ["flank_wear"] and found.verdict["verdict"] == word
    assert found.final.nrmse > 1.5 * found.floor_nrmse
