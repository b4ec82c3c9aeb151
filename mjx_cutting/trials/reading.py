"""Reads a dataset folder: the manifest, each trial's file, each trial's checks.

The idea: a bad trial is named and left out with its reason, the others go on. Only a broken `dataset.json`,
or no good trial at all, is an error.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path, PurePosixPath

from mjx_cutting.trials.checks import Verdict, check_trial, finish
from mjx_cutting.trials.dataset import Dataset, LeftOut, Trial
from mjx_cutting.trials.manifest import Entry, Manifest, read_manifest
from mjx_cutting.trials.parts import recover
from mjx_cutting.trials.records import read_columns, records_of, required_columns


def read(folder: str | os.PathLike[str]) -> Dataset:
    """The dataset in a folder in the format mjx-cutting-trials/1, forces in process axes, checked.

    Raises ValueError where dataset.json is missing or broken (the message names the key path) or no trial is
    good. What a recorder that was killed left in the folder is merged first (see `parts`).
    """
    place = Path(folder)
    recover(place)
    manifest = read_manifest(place)
    with ThreadPoolExecutor(max_workers=4) as pool:
        outcomes = list(pool.map(lambda entry: _read_trial(place, entry, manifest), manifest.entries))
    return finish(manifest.without_trials(), outcomes, where=str(place))


def _read_trial(folder: Path, entry: Entry, manifest: Manifest) -> tuple[Trial | LeftOut, Verdict]:
    try:
        name = PurePosixPath(entry.file)
        if name.is_absolute() or ".." in name.parts:
            raise ValueError(
                "got a path that leaves the dataset folder, expected a file inside it; move the file there."
            )
        columns, unknown = read_columns(folder / entry.file, required_columns(manifest.tool))
        records, warnings = records_of(columns, manifest.tool, manifest.axes)
        trial = Trial(file=entry.file, **entry.conditions, **records)
    except ValueError as error:
        return LeftOut(entry.file, str(error).removeprefix(f"{entry.file}: ")), Verdict()
    if unknown:
        warnings = [f"unknown columns {', '.join(unknown)}, ignored.", *warnings]
    verdict = check_trial(trial, manifest.tool, manifest.sensor, manifest.axes)
    return trial, Verdict(verdict.reasons, (*warnings, *verdict.warnings))
