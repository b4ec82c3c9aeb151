"""The public drilling records: thrust and torque of 334 holes by 14 drills, each used until it failed.

The entries of one MATLAB file are called d<drill>h<hole>, each [T, 2]: thrust and torque, in units the source
does not give (hence "arbitrary"). What the source states: two-flute high-speed-steel drills, 800 rpm, 4.5
inch/min, dry, bars of stainless steel a quarter of an inch thick, sampled at 250 Hz. It follows here that a
hole is 6.35 mm deep, so `cut_length_before_m` is that times the holes drilled before.

Assumptions that break it: (1) the drill's diameter is not stated; a quarter of an inch is taken, which only
scales the coefficients. (2) The rate is doubtful: at the stated feed a hole lasts 3.3 s or 833 samples, the
records hold about 200. Treat the records as quasi-static and do not read frequencies from them.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np

from mjx_cutting.trials.checks import Verdict, check_trial, finish
from mjx_cutting.trials.dataset import Dataset, LeftOut, Sensor, ToolInfo, Trial

SOURCE = (
    "github.com/ArnabBir/Condition_Based_Maintenance, commit a8bb334, matData/dbhole.mat "
    "(after Kumar et al., IJCNN 2008)"
)
LICENCE = "Apache-2.0 at repository level; the data come from a course challenge"
FILE = "dbhole.mat"
INCH_M = 0.0254
HOLE_DEPTH_M = 0.25 * INCH_M
FEED_SPEED_M_S = 4.5 * INCH_M / 60
SPINDLE_SPEED_REV_S = 800 / 60
TOOL = ToolInfo("drill", teeth=2, diameter_m=0.25 * INCH_M)
SENSOR = Sensor(sample_rate_hz=250.0, zeroed="trial", units="arbitrary")
WARNINGS = (
    "sensor.sample_rate_hz: got 250 Hz from the source, expected about 60 Hz from the hole depth and the "
    "feed it states as "
    "well; treat the records as quasi-static.",
    "tool.diameter_m: not stated by the source; 6.35 mm is assumed, which only scales the coefficients.",
)
_KEY = re.compile(r"d(\d+)h(\d+)")


def import_drilling(path: str | os.PathLike[str]) -> Dataset:
    """The holes as trials, by drill and hole; broken entries are named in left_out.

    Arguments: path of the .mat file, or of the folder that holds dbhole.mat. Zeros before contact are removed
    and time starts there.

    Raises ValueError where the file cannot be read or holds no entry d<drill>h<hole>.
    """
    place = Path(path)
    place = place / FILE if place.is_dir() else place
    entries = _read_entries(place)
    outcomes: list[tuple[Trial | LeftOut, Verdict]] = []
    for drill, hole in sorted(entries):
        file = f"d{drill}h{hole}.csv"
        try:
            trial = _hole_trial(file, drill, hole, entries[drill, hole])
        except ValueError as error:
            outcomes.append((LeftOut(file, str(error)), Verdict()))
        else:
            outcomes.append((trial, check_trial(trial, TOOL, SENSOR)))
    dataset = Dataset(
        name="drilling", source=SOURCE, licence=LICENCE, tool=TOOL, sensor=SENSOR, warnings=WARNINGS
    )
    return finish(dataset, outcomes, where=str(place))


def _read_entries(path: Path) -> dict[tuple[int, int], np.ndarray]:
    import scipy.io

    try:
        content = scipy.io.loadmat(path)
    except Exception as error:  # on a broken file scipy raises many kinds, zlib.error too
        raise ValueError(
            f"{path}: got a file that cannot be read as MATLAB ({type(error).__name__}: {error}), expected "
            f"{FILE}; get it again."
        ) from None
    entries = {}
    for key, value in content.items():
        found = _KEY.fullmatch(key)
        if found is not None:
            entries[int(found[1]), int(found[2])] = np.asarray(value)
    if not entries:
        raise ValueError(
            f"{path}: got no entry named d<drill>h<hole>, expected 334 of them; check that it is {FILE}."
        )
    return entries


def _hole_trial(file: str, drill: int, hole: int, samples: np.ndarray) -> Trial:
    name = f"entry d{drill}h{hole}"
    if samples.ndim != 2 or samples.shape[1] != 2 or not np.issubdtype(samples.dtype, np.number):
        raise ValueError(
            f"{name}: got shape {samples.shape} of {samples.dtype}, expected [samples, 2]: thrust, torque."
        )
    touched = np.flatnonzero((samples != 0).any(axis=1))
    if not len(touched):
        raise ValueError(
            f"{name}: got a broken stub, {samples.shape[0]} x {samples.shape[1]} zeros of type "
            f"{samples.dtype}, expected a record of "
            "thrust and torque; nothing can be done without the original."
        )
    record = samples[touched[0] :].astype(np.float64)
    unmeasured = np.full(len(record), np.nan)
    return Trial(
        file=file,
        kind="cut",
        milling=None,
        spindle_speed_rev_s=SPINDLE_SPEED_REV_S,
        feed_speed_m_s=FEED_SPEED_M_S,
        radial_depth_m=TOOL.diameter_m / 2,
        axial_width_m=TOOL.diameter_m / 2,
        material="stainless steel",
        tool_id=f"d{drill}",
        cut_length_before_m=(hole - 1) * HOLE_DEPTH_M,
        time_s=np.arange(len(record)) / SENSOR.sample_rate_hz,
        force_n=np.stack([unmeasured, unmeasured, record[:, 0]], axis=-1),
        torque_nm=record[:, 1],
    )
