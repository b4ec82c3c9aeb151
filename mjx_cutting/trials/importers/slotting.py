"""The public slotting records: five full slots at five feeds, 6,000 rpm, two teeth, DynoWare at 10 kHz.

Which process axis each column measures, and with which sign. A full slot's mean force on the tool is, in the
process frame (feed +x, angle clockwise from +y), with b the axial width, c the feed per tooth, N teeth:

    mean Fx = -(N b/4) K_rc c - (N b/pi) K_re,   mean Fy = (N b/4) K_tc c + (N b/pi) K_te,   mean Fz = -(N
    b/pi) K_ac c - (N b/2) K_ae.

The tangential force is the largest, and all coefficients are positive. Over the five feeds the columns' means
are: Fx +63 to +211 N (the steepest in feed), Fy -40 to -78 N, Fz +56 to +85 N. So column Fx is +y, column Fy
is +x and column Fz is -z. Swapping x and y and turning z round is a proper rotation (determinant +1), as it
must be for a right-handed dynamometer. The mean-force line then gives K_tc 959, K_te 15.8, K_rc 251, K_re
19.4, K_ac 146, K_ae 18.2 N/mm^2 and N/mm, all positive.

The rotation agrees: at tooth passing (200 Hz) the line along x lags the one along y by 72 to 79 degrees in
all five records; the model says 90, mirrored axes would give a lead.

The source states no licence: use and cite, never redistribute. Workpiece material and wear are not stated.
The transducer rings above 400 Hz.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from mjx_cutting.trials.dataset import Dataset
from mjx_cutting.trials.importers.dynoware import import_dynoware

AXES = ("+y", "+x", "-z")
SOURCE = "github.com/leekunhwee/ForceCalculation, commit 3fda341, General/Flat end milling"
LICENCE = "none stated: use and cite, never redistribute"
FEEDS_MM_MIN = (300, 600, 900, 1200, 1500)
FILES = tuple(f"6-n6000f{feed}ap3ae25.csv" for feed in FEEDS_MM_MIN)


def import_slotting(folder: str | os.PathLike[str]) -> Dataset:
    """The five slotting trials in rising feed, forces in process axes. Raises ValueError where none can be
    read.
    """
    conditions = {
        "name": "slotting",
        "source": SOURCE,
        "licence": LICENCE,
        "tool": {"kind": "end_mill", "teeth": 2, "diameter_m": 0.025, "helix_rad": float(np.deg2rad(45.0))},
        "sensor": {"sample_rate_hz": 10_000.0, "zeroed": "trial", "units": "SI"},
        "axes": list(AXES),
        "defaults": {"kind": "cut", "milling": "slot"},
        "trials": [{"file": file} for file in FILES],
    }
    return import_dynoware(Path(folder), conditions=conditions, name="slotting")
