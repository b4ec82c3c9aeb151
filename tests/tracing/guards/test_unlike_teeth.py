"""Teeth that each cut with more or less force as a whole have no unequal pitch, however well it fits."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from mjx_cutting import _platform
from mjx_cutting.cutting import Cut, ForceModel, Material, Tool, order_lines
from mjx_cutting.cutting.average import mean_load
from mjx_cutting.cutting.effects import RadialRunout, StaticCompliance, UnequalPitch
from mjx_cutting.tracing.guards.unlike_teeth import UnlikeTeeth, rather_teeth_apart

TEETH, DIAMETER_M, DEPTH_M = 6, 0.05, 0.004


@pytest.mark.parametrize(
    ("kind", "tool", "apart", "refused"),
    [
        (UnequalPitch, Tool("slitting_saw", 30, 0.05), 370.0, True),
        (UnequalPitch, Tool("slitting_saw", 30, 0.05), 449.0, False),
        (UnequalPitch, Tool("slitting_saw", 30, 0.05), 900.0, False),
        (UnequalPitch, Tool("turning", 1, 0.05), 370.0, False),
        (RadialRunout, Tool("end_mill", 2, 0.01), 370.0, True),
        (RadialRunout, Tool("end_mill", 4, 0.01), 370.0, False),
    ],
    ids=["surely less", "hardly less", "more", "no teeth", "runout of two", "runout of four"],
)
def test_what_makes_teeth_unlike_is_refused_where_teeth_apart_leave_surely_less(kind, tool, apart, refused):
    """It takes 1,600 to 450, over 2,000 samples."""
    gain = SimpleNamespace(
        kind=kind,
        problem=SimpleNamespace(tool=tool, whitened=np.zeros((10, 200))),
        before=SimpleNamespace(squares=1600.0),
        found=SimpleNamespace(squares=450.0, x=np.zeros(20)),
        squares_with=lambda instead: apart,
    )
    why = rather_teeth_apart(gain)
    assert (why is not None) == refused
    assert why is None or "explain 1.07 times as much" in why


def test_a_share_of_each_tooth_repeats_once_a_turn_and_leaves_the_mean():
    tool, material = Tool("slitting_saw", TEETH, DIAMETER_M), Material(8e8, 1.6e4, 3e8, 1e4, 5e7, 1e3)
    exit_rad = float(np.arccos(1.0 - 2.0 * DEPTH_M / DIAMETER_M))
    cut = Cut(0.0, 20.0, 4e-5 * TEETH * 20.0, DEPTH_M, 0.0015, 0.0, exit_rad)
    share = 0.04 * np.random.default_rng(1).normal(size=TEETH)
    with _platform.x64():
        alike, apart, shifted = (
            np.asarray(order_lines(ForceModel(tool, material, effects), cut, 2 * TEETH, 512))
            for effects in ((), (UnlikeTeeth(share),), (UnlikeTeeth(share + 0.3),))
        )
    np.testing.assert_allclose(apart[::TEETH], alike[::TEETH], rtol=1e-6, atol=1e-9)
    assert np.abs(apart[1]).max() > 0.01 * np.abs(alike[0]).max() > 100.0 * np.abs(alike[1]).max()
    np.testing.assert_allclose(shifted, apart, rtol=1e-9, atol=1e-12)


def test_they_even_out_in_the_load_that_bends_a_tool():
    """A tool that bends asks for the mean force of a turn, of one tooth that stands for all."""
    tool, material = Tool("slitting_saw", TEETH, DIAMETER_M), Material(8e8, 1.6e4, 3e8, 1e4, 5e7, 1e3)
    exit_rad = float(np.arccos(1.0 - 2.0 * DEPTH_M / DIAMETER_M))
    cut = Cut(0.0, 20.0, 4e-5 * TEETH * 20.0, DEPTH_M, 0.0015, 0.0, exit_rad)
    bends, apart = StaticCompliance(2e-7), UnlikeTeeth(0.04 * np.random.default_rng(1).normal(size=TEETH))
    with _platform.x64():
        alike, unlike = (
            np.asarray(order_lines(ForceModel(tool, material, effects), cut, 2 * TEETH, 512))
            for effects in ((bends,), (bends, apart))
        )
        loads = [
            np.asarray(mean_load(ForceModel(tool, material, effects), cut).force)
            for effects in ((), (apart,))
        ]
    np.testing.assert_allclose(unlike[::TEETH], alike[::TEETH], rtol=1e-6, atol=1e-9)
    assert np.abs(unlike[1]).max() > 100.0 * np.abs(alike[1]).max()
    np.testing.assert_array_equal(*loads)
