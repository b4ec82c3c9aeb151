"""Of a tool that gives one level a trial, the part of the record that was taken for it is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.study import make
from mjx_cutting.tracing import trace
from mjx_cutting.tracing.records.levels import as_levels
from mjx_cutting.tracing.telling.at_level import at_level


def coming_in(share: float):
    """A turning session whose first cut comes in over the first `share` of its record."""
    dataset = make("turning", {}, 500).dataset
    first, *others = dataset.trials
    rise = np.minimum(np.linspace(0.0, 1.0, len(first.time_s)) / share, 1.0)
    return replace(dataset, trials=(replace(first, force_n=rise[:, None] * first.force_n), *others))


def test_a_ramp_that_was_not_traced_is_said():
    dataset = coming_in(0.3)
    first, told = dataset.trials[0], at_level(dataset, as_levels(dataset))
    assert told is not None and told.count(".csv") == 1
    begun_s, end_s = first.time_s[0], first.time_s[-1]
    low_s = float(told.split(first.file)[1].split()[0])
    assert begun_s + 0.3 * (end_s - begun_s) <= low_s < begun_s + 0.5 * (end_s - begun_s)
    found = trace(dataset, effects=("size_effect",))
    assert told in found.caveats and told in found.verdict["remaining"]["description"]


def test_records_traced_from_end_to_end_say_nothing():
    dataset = make("turning", {}, 500).dataset
    assert at_level(dataset, as_levels(dataset)) is None


def test_a_cutter_has_no_level(hiding):
    dataset = hiding({})
    assert at_level(dataset, as_levels(dataset)) is None
