"""The isolability of effects: survivals and cosines by name, from what was screened first."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from mjx_cutting.cutting import effect_class
from mjx_cutting.tracing.telling.isolability import isolability


def _search(*rows):
    screened = tuple(
        SimpleNamespace(kind=effect_class(name), survival=survival, direction=np.asarray(direction))
        for name, survival, direction in rows
    )
    return SimpleNamespace(rounds=(SimpleNamespace(screened=screened),) if rows else ())


def test_names_are_in_order_and_cosines_have_no_sign():
    found = isolability(
        _search(
            ("unequal_pitch", 0.9, [1.0, 0.0]),
            ("flank_wear", 0.4, [-0.6, 0.8]),
            ("radial_runout", 0.8, [0.0, 1.0]),
        )
    )
    assert found.names == ("flank_wear", "radial_runout", "unequal_pitch")
    np.testing.assert_allclose(found.cosine[0], [1.0, 0.8, 0.6])
    assert found.to_dict()["survival"] == [0.4, 0.8, 0.9]


def test_nothing_screened_gives_nothing():
    assert isolability(_search()) is None
