"""A sheet of several layers, of which few trials reach the deepest."""

from __future__ import annotations

import numpy as np

from tests.tracing.along.test_slow import _ends, _named


def test_a_second_layer_is_held_to_chance_as_the_one_kind_that_was_tried_beside_the_first():
    """The first alone leaves so much that it passes with the second only, which four of six cuts reach, all
    of which sway by more than it."""

    def gain(place, trial):
        layers = np.where((place > 0.01) & (place < 0.016), -0.27, 0.0)
        layers += np.where((place > 0.042) & (place < 0.056), -0.2, 0.0)
        sway = np.sin(0.02 * np.arange(len(place)) * (1.0 + 0.37 * trial) + 2.1 * trial)
        return layers + 0.3 * sway

    named, _ = _named(gain, edge_share=1.0)
    assert [each.kind.name for each in named] == ["layered_material"] * 2
    (first, middle), (second, last) = sorted(_ends(each.effect.values()) for each in named)
    np.testing.assert_allclose([first, middle, second], [0.01, 0.016, 0.042], atol=3e-4)
    assert last > 0.055
