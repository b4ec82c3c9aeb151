"""A spindle that slows as it enters the sheet: its droop and lag are read from the phase on the ramps."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from mjx_cutting.cutting import effect_class
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.along.ends import effect_at, places_of
from mjx_cutting.tracing.along.slip import Slip
from mjx_cutting.tracing.along.slow_round import SlowCandidate
from mjx_cutting.tracing.droop_on_ramps import _Judged
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.naming.decision import Decision
from mjx_cutting.tracing.naming.intervals import Interval
from mjx_cutting.tracing.whole_records import Told
from mjx_cutting.trials.dataset import AntiAlias, Dataset, Sensor, ToolInfo, Trial

TEETH, DIAMETER_M, WIDTH_M, EDGE_M = 20, 0.05, 1.6e-3, 12e-3
K_TC, K_RC, K_TE, K_RE = 7e8, 2.1e8, 14e3, 5.6e3
DROOP, LAG_S = 0.25, 0.12
FINE_HZ, RATE_HZ, CORNER_HZ = 16e3, 500.0, 200.0


def _cut(index: int, speed_rev_s: float, feed_m_s: float, depth_m: float, generator) -> Trial:
    """A saw that comes to its sheet from the air, by small steps of time."""
    radius, step = 0.5 * DIAMETER_M, 1.0 / FINE_HZ
    free = speed_rev_s * (1.0 + generator.uniform(-0.005, 0.005))
    reach = np.sqrt(depth_m * (DIAMETER_M - depth_m))
    air_s = generator.uniform(0.6, 1.1)
    time = np.arange(0.0, air_s + reach / feed_m_s + 2.5, step)
    axis_m = EDGE_M - reach + feed_m_s * (time - air_s)
    arc = np.arccos(1.0 - depth_m / radius)
    # mean torque of the teeth between where the sheet begins and the end of the arc
    begin = np.arcsin(np.clip((EDGE_M - axis_m) / radius, 0.0, 1.0))
    inside = np.clip(arc - begin, 0.0, None)
    swept = np.where(inside > 0.0, np.cos(begin) - np.cos(arc), 0.0)
    per_tooth = TEETH / (2.0 * np.pi) * WIDTH_M * radius
    speed, angle = np.empty_like(time), np.empty_like(time)
    now, turned = free, generator.uniform(0.0, 2.0 * np.pi)
    for k in range(len(time)):
        torque = per_tooth * (K_TC * feed_m_s / (TEETH * now) * swept[k] + K_TE * inside[k])
        now += (free - DROOP * torque - now) * (1.0 - np.exp(-step / LAG_S))
        turned += 2.0 * np.pi * now * step
        speed[k], angle[k] = now, turned
    force = np.zeros((len(time), 3))
    chip = feed_m_s / (TEETH * speed)
    for tooth in range(TEETH):
        th = np.mod(angle + 2.0 * np.pi * tooth / TEETH, 2.0 * np.pi)
        on = WIDTH_M * ((th >= begin) & (th <= arc) & (inside > 0.0))
        tangential, radial = on * (K_TC * chip * np.sin(th) + K_TE), on * (K_RC * chip * np.sin(th) + K_RE)
        force[:, 0] += -tangential * np.cos(th) - radial * np.sin(th)
        force[:, 1] += tangential * np.sin(th) - radial * np.cos(th)
    # as the sensor samples it
    seen = lfilter(*butter(4, CORNER_HZ, fs=FINE_HZ), force, axis=0)[:: int(FINE_HZ / RATE_HZ)]
    seen += generator.normal(0.0, (0.2, 0.2, 0.2), seen.shape)
    place = np.zeros((len(seen), 3))
    place[:, 0] = axis_m[:: int(FINE_HZ / RATE_HZ)]
    return Trial(
        file=f"{index}.csv",
        kind="cut",
        milling="conventional",
        spindle_speed_rev_s=speed_rev_s,
        feed_speed_m_s=feed_m_s,
        radial_depth_m=depth_m,
        axial_width_m=WIDTH_M,
        time_s=np.arange(len(seen)) / RATE_HZ,
        force_n=seen,
        position_m=place,
    )


@pytest.mark.parametrize("places", [(4e-3, np.inf, 1.0), (-np.inf, 0.05, 0.0), (4e-3, 0.05, 0.0)])
def test_an_end_that_no_record_reaches_stays_away(places):
    """Intervals of what the ramps show, of the other end the one it had."""
    kind = effect_class("entry_exit")
    had = {name: Interval(-9.0, -9.0, -9.0, "m") for name in ("share", "start_m", "length_m", "by_axis")}
    left = HeldOut(np.ones((3, 3)), np.full((3, 3), 100.0), None, np.arange(3))
    told = Told(left, left, 0.98, np.array([0.97, 0.98, 0.99]), 1000, np.ones(3, bool))
    decision = Decision(True, True, 0.0, 1.0, 0.1, had, ())
    known = SlowCandidate(kind, effect_at(np.array(places), np.ones(1)), left, decision, ())
    moved = [np.array(places) + np.array([by, by**2, 0.0]) for by in (-1e-4, 0.0, 1e-4, 3e-4)]
    by_fold = [Slip(each, 0.2, 0.1) for each in moved[1:]]
    found = _Judged(by_fold[0], by_fold, told, ())._ends(known)
    assert places_of(found.effect) == pytest.approx(places)
    start, end = np.isfinite(places[:2]).tolist()
    shown = {"share", *["start_m"] * start, *["length_m"] * end}
    assert {name for name, each in found.decision.parameters.items() if each.value != -9.0} == shown
    assert all(np.isfinite([each.low, each.high]).all() for each in found.decision.parameters.values())


@pytest.mark.slow
def test_droop_and_its_lag_are_read_on_the_ramps():
    generator = np.random.default_rng(3)
    cuts = [(feed, depth) for feed in (8e-3, 24e-3) for depth in (1e-3, 2e-3)]
    plan = [(speed, *cut) for speed in (7.0, 9.5) for cut in cuts]
    trials = tuple(_cut(index, *each, generator) for index, each in enumerate(plan))
    sensor = Sensor(RATE_HZ, (0.2, 0.2, 0.2), "session", anti_alias=AntiAlias(order=4, hz=CORNER_HZ))
    saw = ToolInfo("slitting_saw", TEETH, DIAMETER_M)
    session = Dataset(name="ramps", tool=saw, sensor=sensor, trials=trials)
    verdict = trace(session, effects=("spindle_droop", "entry_exit")).verdict
    droop, sheet = verdict["effects"]
    assert [droop["name"], sheet["name"]] == ["spindle_droop", "entry_exit"]
    found = droop["parameters"]["droop_rev_s_nm"]
    assert found["value"] == pytest.approx(DROOP, rel=0.05)
    assert found["low"] < DROOP < found["high"]
    assert found["high"] - found["low"] < 0.2 * DROOP
    assert sheet["parameters"]["start_m"]["value"] == pytest.approx(EDGE_M, abs=2e-4)
    assert f"{1e3 * sheet['parameters']['start_m']['value']:.2f} mm" in " ".join(sheet["evidence"])
    (lag,) = re.findall(r"lag of ([\d.]+) s", " ".join(droop["evidence"]))
    assert float(lag) == pytest.approx(LAG_S, abs=0.02)
    assert verdict["after"]["heldout_nrmse"] < 0.25 * verdict["before"]["heldout_nrmse"]
