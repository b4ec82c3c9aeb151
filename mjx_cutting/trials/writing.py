"""Writes a dataset folder: `dataset.json` and one file a trial, whole or not at all.

The idea: what `reading.read` takes in comes back out: the forces are put back into the file's own columns
(`Dataset.axes`), numbers are written so that the same float64 is read again. The folder is made beside its
place and renamed into it when complete.

The assumption that breaks it: the trials fit in memory, and one session writes the folder once. A recorder
that must survive being killed writes its own parts.
"""

from __future__ import annotations

import json
import os
from pathlib import Path, PurePosixPath
from typing import Any

from mjx_cutting._files import staged_folder
from mjx_cutting.trials.dataset import Dataset, Trial
from mjx_cutting.trials.manifest import FORMAT
from mjx_cutting.trials.records import SUFFIXES, columns_of, write_columns


def write(dataset: Dataset, folder: str | os.PathLike[str]) -> Path:
    """Writes the dataset in the format mjx-cutting-trials/1 and returns the folder.

    Arguments: dataset, whose trials' file names end in .csv or .parquet (that decides how each is written);
    folder, which must not exist or be empty. What was left out is not written.

    Raises ValueError where a file name does not fit or no trial is there, FileExistsError where the folder
    holds something already.
    """
    if not dataset.trials:
        raise ValueError(
            f"{dataset.name}: got a dataset without trials, expected at least one; nothing was written."
        )
    for trial in dataset.trials:
        name = PurePosixPath(trial.file)
        if name.suffix.lower() not in SUFFIXES or name.is_absolute() or ".." in name.parts:
            raise ValueError(
                f"{trial.file}: got this file name, expected one inside the folder that ends in .csv or "
                ".parquet; rename the trial."
            )
    path = Path(folder)
    with staged_folder(path) as staged:
        for trial in dataset.trials:
            file = staged / trial.file
            file.parent.mkdir(parents=True, exist_ok=True)
            write_columns(file, columns_of(trial, dataset.tool, dataset.axes))
        text = json.dumps(describe(dataset), indent=2, ensure_ascii=False, allow_nan=False)
        (staged / "dataset.json").write_text(text + "\n", encoding="utf-8")
    return path


def describe(dataset: Dataset) -> dict[str, Any]:
    """The content of `dataset.json` for a dataset."""
    tool, sensor = dataset.tool, dataset.sensor
    noise = sensor.noise_std_n
    if noise is not None and len(noise) == 3 and dataset.axes is not None:
        noise = (*(noise["xyz".index(axis[1])] for axis in dataset.axes),)  # type: ignore[assignment]
    filter_ = sensor.anti_alias
    return {
        "format": FORMAT,
        "name": dataset.name,
        "source": dataset.source,
        "licence": dataset.licence,
        "tool": {
            "kind": tool.kind,
            "teeth": int(tool.teeth),
            "diameter_m": float(tool.diameter_m),
            "helix_rad": float(tool.helix_rad),
        },
        "sensor": {
            "sample_rate_hz": float(sensor.sample_rate_hz),
            "noise_std_n": None if noise is None else [float(value) for value in noise],
            "zeroed": sensor.zeroed,
            "units": sensor.units,
            "anti_alias": None
            if filter_ is None
            else {
                "kind": filter_.kind,
                "order": int(filter_.order),
                "hz": float(filter_.hz),
                "zero_phase": filter_.zero_phase,
            },
        },
        "axes": None if dataset.axes is None else list(dataset.axes),
        "trials": [_described(trial) for trial in dataset.trials],
    }


def _described(trial: Trial) -> dict[str, Any]:
    return {
        "file": trial.file,
        "kind": trial.kind,
        "milling": trial.milling,
        "spindle_speed_rev_s": float(trial.spindle_speed_rev_s),
        "feed_speed_m_s": float(trial.feed_speed_m_s),
        "radial_depth_m": float(trial.radial_depth_m),
        "axial_width_m": float(trial.axial_width_m),
        "material": trial.material,
        "tool_id": trial.tool_id,
        "cut_length_before_m": float(trial.cut_length_before_m),
        "clock_start_s": float(trial.clock_start_s),
    }
