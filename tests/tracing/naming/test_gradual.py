"""Ploughing is told from the size effect, whether its borderline is sharp or gradual."""

from __future__ import annotations

import pytest

from mjx_cutting.tracing import trace

pytestmark = pytest.mark.slow
THINNEST_M = 8e-6


@pytest.mark.parametrize(
    ("name", "hidden"),
    [
        ("ploughing", {"minimum_chip_m": THINNEST_M, "ratio": 4.0, "gradual": 1.0}),
        ("ploughing", {"minimum_chip_m": THINNEST_M, "ratio": 4.0}),
        ("size_effect", {"exponent": 0.25}),
    ],
    ids=["gradual", "sharp", "size effect"],
)
def test_the_law_that_was_cut_by_is_named(hiding, name: str, hidden: dict[str, float]):
    found = trace(hiding({name: hidden}), effects=("ploughing", "size_effect", "radial_runout"))
    (named,) = found.verdict["effects"]
    assert (found.verdict["verdict"], named["name"]) == ("explained", name)
    if name == "ploughing":
        values = {key: each["value"] for key, each in named["parameters"].items()}
        assert values["gradual"] == hidden.get("gradual", 0.0)
        assert values["minimum_chip_m"] == pytest.approx(THINNEST_M, rel=0.2)
