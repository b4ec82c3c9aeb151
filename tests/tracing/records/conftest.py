"""One cut of a turning tool, for whatever is read from a record."""

from __future__ import annotations

import pytest

from mjx_cutting.trials.dataset import Trial


@pytest.fixture(scope="session")
def turning_cut():
    """Call it with the record's `time_s` [T] and `force_n` [T, 3], and whatever else the trial has."""

    def make(time_s, force_n, *, file: str = "t01.csv", **rest) -> Trial:
        return Trial(
            file=file,
            kind="cut",
            milling=None,
            spindle_speed_rev_s=10.0,
            feed_speed_m_s=1e-3,
            radial_depth_m=1e-3,
            axial_width_m=1e-3,
            tool_id="a",
            cut_length_before_m=0.0,
            time_s=time_s,
            force_n=force_n,
            **rest,
        )

    return make
