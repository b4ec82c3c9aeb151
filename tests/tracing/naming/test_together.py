"""Two effects of which neither stands out alone are named together; what only looks like two is not."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.study import make
from mjx_cutting import _platform
from mjx_cutting.cutting import Tool, effect_class
from mjx_cutting.cutting.effects.size_effect import SizeEffect
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.fitting.fit import fit_base
from mjx_cutting.tracing.fitting.heldout import HeldOut, folds, held_out
from mjx_cutting.tracing.fitting.problem import pose
from mjx_cutting.tracing.fitting.screening import screen
from mjx_cutting.tracing.naming import together
from mjx_cutting.tracing.naming.by_direction import SizeEffectByDirection
from mjx_cutting.tracing.naming.candidate import Candidate, Contest, Round, try_effect
from mjx_cutting.tracing.naming.together import _afresh, _exchanged, _little_is_left, two_at_once
from mjx_cutting.tracing.records.levels import as_levels
from mjx_cutting.tracing.records.lines import compress, trusted_band
from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo, Trial

LAWS = ("size_effect", "thermal_drift", "flank_wear", "crosstalk")


def test_a_size_effect_and_a_drift_that_hide_each_other_are_both_named():
    case = make("turning", {"size_effect": 2.0, "thermal_drift": 4.0}, 500)
    found = trace(case.dataset, effects=LAWS)
    said = found.verdict
    assert said["verdict"] == "explained"
    assert {each["name"] for each in said["effects"]} == {"size_effect", "thermal_drift"}
    # neither passes alone
    for name in ("size_effect", "thermal_drift"):
        assert trace(case.dataset, effects=(name, "crosstalk")).verdict["effects"] == []
    true = case.truth["effects"]
    parameters = {each["name"]: each["parameters"] for each in said["effects"]}
    assert parameters["size_effect"]["exponent"]["value"] == pytest.approx(
        true["size_effect"]["exponent"], rel=0.02
    )
    np.testing.assert_allclose(
        parameters["thermal_drift"]["drift_n"]["values"], true["thermal_drift"]["drift_n"], rtol=0.1, atol=0.3
    )
    # each is told by what it brings beside the other
    assert all(each["heldout_gain"] > 0.5 * said["before"]["heldout_nrmse"] for each in said["effects"])


def test_of_two_laws_of_the_chip_beside_a_drift_that_with_fewer_unknowns_is_named():
    """Ploughing with a stiffness for each axis follows the bend of a size effect over a few feeds."""
    case = make("turning", {"size_effect": 2.0, "thermal_drift": 4.0}, 500)
    said = trace(case.dataset, effects=("size_effect", "thermal_drift", "ploughing")).verdict
    assert {each["name"] for each in said["effects"]} == {"size_effect", "thermal_drift"}


def test_no_pairs_are_fitted_where_only_noise_is_left(mill, monkeypatch):
    tried = []
    monkeypatch.setattr(together, "_descended", lambda *each: tried.append(each))
    found = trace(mill(), effects=("size_effect", "ploughing", "sensor_lowpass"))
    assert found.verdict["verdict"] == "nothing missing" and len(found.search.rounds[-1].candidates) > 1
    assert not tried


def test_a_gain_that_switches_at_random_is_not_two_effects():
    case = make("turning", {"gain_switching": "strong"}, 500)
    assert trace(case.dataset, effects=LAWS).verdict["verdict"] == "unexplained"


HOLES = """
a - 18 .000 0
a 3 18 .000 217
a 6 22 .438 439
a 4 14 .794 566
a 2 14 1.156 702
b 6 22 .000 968
b 4 18 .498 1188
b 2 18 .864 1428
b 6 18 1.265 1704
c 2 22 .000 1993
c 3 22 .253 2117
c - 18 .527 2337
c 4 18 .527 2566
c 2 18 .820 2770
c - 18 1.220 2972
c - 18 1.220 3170
"""
"""Drill, feed in mm/s (- in air), revolutions a second, length cut before in m, clock in s."""


def _three_drills(rate_hz: float = 200.0) -> Dataset:
    """Twelve holes by three drills, whose edges wear fast while they are sharp, behind a sensor that drifts,
    read four times in air."""
    draw, time, trials = np.random.default_rng(4), np.arange(300) / rate_hz, []
    for index, hole in enumerate(HOLES.split("\n")[1:-1], 1):
        drill, feed, *numbers = hole.split()
        speed, before_m, clock_s = map(float, numbers)
        cut, feed_m_s = feed != "-", 1e-3 * float(feed) if feed != "-" else 3e-3
        length_m = before_m + feed_m_s * time
        land_m = 7.5e-5 * (1.0 - np.exp(-length_m / 0.14)) + 7e-5 * length_m
        chip_m = feed_m_s / (2.0 * speed)
        drifted = np.exp(-240.0 / 1300.0) - np.exp(-(240.0 + clock_s + time) / 1300.0)
        force = np.full((len(time), 3), np.nan)
        force[:, 2] = cut * (5.6e6 * chip_m + 118.0 + 4e5 * land_m) + 38.0 * drifted
        torque = cut * (2.1e4 * chip_m + 0.3 + 380.0 * land_m) - 0.25 * drifted
        trials.append(
            Trial(
                file=f"{index:02d}.csv",
                kind="cut" if cut else "air",
                milling=None,
                spindle_speed_rev_s=speed,
                feed_speed_m_s=feed_m_s,
                radial_depth_m=3.5e-3 if cut else 0.0,
                axial_width_m=3.5e-3,
                tool_id=drill,
                cut_length_before_m=before_m,
                clock_start_s=clock_s,
                time_s=time,
                force_n=force + draw.normal(0.0, 2.4, force.shape),
                torque_nm=torque + draw.normal(0.0, 0.023, len(time)),
            )
        )
    told = {"name": "drills", "source": "made by calculation", "licence": "Apache-2.0"}
    sensor = Sensor(rate_hz, (2.4, 2.4, 0.023), zeroed="session")
    return Dataset(**told, tool=ToolInfo("drill", 2, 0.007), sensor=sensor, trials=tuple(trials))


def _at_once(dataset: Dataset, *names: str, not_fitted: str = "") -> tuple[HeldOut, Candidate, Candidate]:
    """The error without and the two named at once, where that of `not_fitted` was only screened before."""
    kinds = [effect_class(name) for name in names]
    with _platform.x64():
        dataset = as_levels(dataset)
        lines = compress(dataset, trusted_band(dataset, None))
        problem, base = fit_base(pose(dataset, lines))
        fold = folds(dataset, 0)
        before = held_out(problem, lines, (), base.x, fold)
        contest = Contest(problem, lines, fold, kinds)
        screened = screen(problem, (), base.x, kinds)
        fitted = [each for each in screened if each.kind.name != not_fitted]
        tried = [try_effect(contest, (each.kind,), each.x, base, before) for each in fitted]
        tried.sort(key=lambda each: each.heldout.nrmse)
        found = two_at_once(contest, (), base, Round(before, screened, tuple(tried), None))
    assert found is not None and found[0].accepted is not None and found[1].accepted is not None
    return before, found[0].accepted, found[1].accepted


def test_a_law_with_more_unknowns_beside_the_other_is_held_against_itself_alone(monkeypatch):
    """An exponent for each direction, asked for only beside the drift."""
    kind = type("SizeEffectByDirection", (SizeEffectByDirection,), {"apart": ("radial", "axial")})

    def by_direction(found, contest, effects, before, heldout):
        if found.kind is not SizeEffect:
            return found
        return try_effect(contest, (*effects[:-1], kind), np.append(found.fit.x, [0.0, 0.0]), before, heldout)

    monkeypatch.setitem(two_at_once.__globals__, "finer", by_direction)
    case = make("turning", {"size_effect": 2.0, "thermal_drift": 4.0}, 500)
    before, first, second = _at_once(case.dataset, "size_effect", "thermal_drift")
    assert {first.kind, second.kind} == {kind, effect_class("thermal_drift")}
    assert second.heldout.nrmse < 0.3 * before.nrmse


def test_of_a_pair_each_is_told_as_finely_as_the_trials_show():
    """Even wear beside the drift leaves too much to tell that these two are all; with its run-in, noise."""
    before, first, second = _at_once(_three_drills(), "flank_wear", "thermal_drift")
    assert [each.kind.name for each in (first, second)] == ["flank_wear", "thermal_drift"]
    land = second.fit.model.effects[0].values()
    assert float(land["run_in_m"]) == pytest.approx(0.14, rel=0.15)
    # 2.4 N and .023 N m beside 300 N and 1 N m, on the mean of each hole
    assert second.heldout.nrmse < 0.12 * before.nrmse


@pytest.mark.parametrize("not_fitted", ["flank_wear", "thermal_drift"])
def test_one_of_a_pair_may_not_have_been_among_the_most_telling_alone(not_fitted):
    names = ("flank_wear", "thermal_drift", "size_effect")
    before, first, second = _at_once(_three_drills(), *names, not_fitted=not_fitted)
    assert {each.kind.name for each in (first, second)} == {"flank_wear", "thermal_drift"}
    assert second.heldout.nrmse < 0.12 * before.nrmse


def test_what_follows_the_most_telling_has_few_starts_and_explains_something():
    shares = {
        "size_effect": 0.5,
        "thermal_drift": 0.1,
        "torque_ripple": 0.09,
        "ploughing": 0.08,
        "static_compliance": 0.07,
        "flank_wear": 0.06,
        "crosstalk": 0.05,
        "sensor_lowpass": 0.04,
    }
    screened = [SimpleNamespace(kind=effect_class(name), share=share) for name, share in shares.items()]
    alone = SimpleNamespace(screened=screened, candidates=screened[:1])
    saw = SimpleNamespace(tool=Tool("slitting_saw", 20, 0.05))
    told = [each.kind.name for each in together._following(saw, alone)]
    assert told == ["thermal_drift", "static_compliance", "flank_wear", "crosstalk"]
    alone.screened = [SimpleNamespace(kind=each.kind, share=each.share / 10.0) for each in screened]
    assert together._following(saw, alone) == []


def _leaves(error: float) -> HeldOut:
    return HeldOut(np.full((4, 3), error**2 / 3.0), np.full((4, 3), 1.0 / 3.0), None, np.arange(4))


@pytest.mark.parametrize(
    ("first", "second", "both", "little"),
    [(0.06, 0.08, 0.01, True), (0.06, 0.08, 0.05, False), (0.012, 0.08, 0.01, False)],
    ids=["both are needed", "much is left", "the first does nearly all"],
)
def test_a_pair_must_leave_little_and_need_both(first, second, both, little):
    left = (_leaves(each) for each in (0.1, first, second, both))
    assert _little_is_left(*left) is little


def test_unknowns_of_two_effects_change_places():
    x = np.arange(9.0)
    exchanged = _exchanged(x, 2, 3)
    np.testing.assert_array_equal(exchanged, [0, 1, 2, 3, 7, 8, 4, 5, 6])
    np.testing.assert_array_equal(_exchanged(exchanged, 3, 2), x)


@pytest.mark.parametrize(
    ("names", "begins"),
    [
        (("static_compliance", "flank_wear"), 2),
        (("static_compliance", "torque_ripple"), 2),
        (("torque_ripple", "robot_mode"), 0),
    ],
)
def test_a_pair_that_is_not_found_from_what_each_is_alone_begins_where_the_search_for_each_does(
    names, begins
):
    """One of many starts stays where it is alone."""
    tool = Tool("slitting_saw", 20, 0.05)
    kinds = [effect_class(name) for name in names]
    alone = [SimpleNamespace(kind=k, x=np.full(6 + k.size(tool), 7.0)) for k in kinds]
    found = _afresh(SimpleNamespace(tool=tool), SimpleNamespace(x=np.arange(6.0)), tuple(alone))
    assert len(found) == begins
    for x in found:
        np.testing.assert_array_equal(x[:6], np.arange(6.0))
        first, second = np.split(x[6:], [kinds[0].size(tool)])
        assert first.tolist() in kinds[0].starts(tool).tolist()
        few = len(kinds[1].starts(tool)) <= 2
        assert (second.tolist() in kinds[1].starts(tool).tolist()) is few
        assert few or np.all(second == 7.0)
