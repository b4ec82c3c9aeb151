"""A further effect must do more than the laws of those before it may be off."""

from __future__ import annotations

from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest

from mjx_cutting.cutting import Tool
from mjx_cutting.cutting.effects import RadialRunout, SizeEffect, Unbalance
from mjx_cutting.tracing.guards import own_law
from mjx_cutting.tracing.guards.gain import Gain
from mjx_cutting.tracing.guards.own_law import rather_their_law


class _Posed(NamedTuple):
    """What the guard reads of a problem: the tool, and the order of each line."""

    tool: Tool
    order: np.ndarray


class _Still:
    """A descent that stays where it is."""

    def __init__(self, problem, effects):
        pass

    def descend(self, start, steps):
        return start, 0.0


# squares that the base model, one effect and two leave: at tooth passing (order 2), and beside it (order 1)
@pytest.mark.parametrize(
    ("beside", "at_passing", "refused"),
    [
        ((0.0, 0.0, 0.0), (1000.0, 50.0, 20.0), None),
        ((0.0, 0.0, 0.0), (1000.0, 3.0, 1.0), "all that they do"),
        ((0.0, 0.0, 0.0), (1000.0, 8.0, 3.0), "on its lines"),
        # as small, but next to nothing is left beside it
        ((0.0, 0.0, 0.0), (1000.0, 3.0, 0.5), None),
        ((1000.0, 1.0, 1.0), (8.0, 8.0, 1.0), None),
    ],
)
def test_what_is_within_the_law_of_another_is_refused(monkeypatch, beside, at_passing, refused):
    size = RadialRunout.size(Tool("end_mill", 2, 0.01))
    squares = np.zeros((3, 1, 5, 3))
    squares[:, 0, 1, 0], squares[:, 0, 3, 0] = beside, at_passing
    monkeypatch.setattr(own_law, "Descent", _Still)
    monkeypatch.setattr(own_law, "squares", lambda problem, effects, x: squares[len(effects)])
    monkeypatch.setattr(own_law, "noise_squares", lambda problem, lines: np.zeros((1, 5, 3)))
    posed = _Posed(Tool("end_mill", 2, 0.01), np.array([0, 1, 1, 2, 2]))
    before, found = (SimpleNamespace(x=np.zeros(count + size)) for count in (6, 7))
    why = rather_their_law(Gain(posed, None, (RadialRunout, SizeEffect), before, found))
    assert why is None if refused is None else refused in why


def test_the_first_effect_has_no_law_before_it():
    assert rather_their_law(Gain(None, None, (Unbalance,), None, None)) is None
