"""A dataset as MCAP files that Foxglove and ROS 2 open: forces as WrenchStamped, the tool as PoseStamped.

One trial is one file. Forces are written in process axes (frame "process"), positions as they were recorded
(frame "base"), stamps as nanoseconds since the trial's start on top of its `clock_start_s`. A conditions.json
beside them says what MCAP cannot, so that `data import mcap` reads the folder back. Needs the extra `mcap`.
"""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from mjx_cutting._files import staged_folder
from mjx_cutting.trials.dataset import Dataset, Trial
from mjx_cutting.trials.writing import describe

FORCE_TOPIC, POSE_TOPIC = "/force", "/pose"
_RULE = "=" * 80 + "\n"
_HEADER = (
    f"{_RULE}MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    f"{_RULE}MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
)
_XYZ = "float64 x\nfloat64 y\nfloat64 z\n"
WRENCH = (
    "std_msgs/Header header\ngeometry_msgs/Wrench wrench\n"
    f"{_RULE}MSG: geometry_msgs/Wrench\ngeometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n"
    f"{_RULE}MSG: geometry_msgs/Vector3\n{_XYZ}{_HEADER}"
)
POSE = (
    "std_msgs/Header header\ngeometry_msgs/Pose pose\n"
    f"{_RULE}MSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"
    f"{_RULE}MSG: geometry_msgs/Point\n{_XYZ}"
    f"{_RULE}MSG: geometry_msgs/Quaternion\n{_XYZ}float64 w\n{_HEADER}"
)
_UPRIGHT = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}


def write_mcap(dataset: Dataset, folder: str | os.PathLike[str]) -> Path:
    """Writes one MCAP file a trial and conditions.json; returns the folder.

    Arguments: dataset; folder, which must not exist or be empty.

    Raises ImportError where the extra is not installed, FileExistsError where the folder holds something
    already, OSError where it cannot be written.
    """
    from mjx_cutting.trials.importers.mcap import require_mcap

    require_mcap()
    with staged_folder(folder) as staged:
        for trial in dataset.trials:
            _write(trial, staged / _name(trial))
        (staged / "conditions.json").write_text(json.dumps(_conditions(dataset), indent=2) + "\n")
    return Path(folder)


def _write(trial: Trial, path: Path) -> None:
    from mcap_ros2.writer import Writer

    path.parent.mkdir(parents=True, exist_ok=True)
    stamps = np.round((trial.clock_start_s + trial.time_s - trial.time_s[0]) * 1e9).astype(np.int64)
    force = np.nan_to_num(trial.force_n)  # axes that a drill does not measure
    torque = np.zeros(len(stamps)) if trial.torque_nm is None else trial.torque_nm
    with path.open("wb") as file:
        writer = Writer(file)
        wrench = writer.register_msgdef("geometry_msgs/msg/WrenchStamped", WRENCH)
        pose = writer.register_msgdef("geometry_msgs/msg/PoseStamped", POSE)
        for at, stamp in enumerate(stamps.tolist()):
            body = {"force": _xyz(force[at]), "torque": {"x": 0.0, "y": 0.0, "z": float(torque[at])}}
            message = {"header": _header(stamp, "process"), "wrench": body}
            writer.write_message(FORCE_TOPIC, wrench, message, log_time=stamp)
            if trial.position_m is not None:
                where = {"position": _xyz(trial.position_m[at]), "orientation": _UPRIGHT}
                writer.write_message(
                    POSE_TOPIC, pose, {"header": _header(stamp, "base"), "pose": where}, log_time=stamp
                )
        writer.finish()


def _conditions(dataset: Dataset) -> dict[str, Any]:
    document = describe(replace(dataset, axes=None))
    del document["format"]
    for entry, trial in zip(document["trials"], dataset.trials, strict=True):
        entry["file"] = _name(trial)
    return {key: value for key, value in document.items() if value is not None}


def _name(trial: Trial) -> str:
    return str(PurePosixPath(trial.file).with_suffix(".mcap"))


def _header(stamp_ns: int, frame: str) -> dict[str, Any]:
    sec, nanosec = divmod(stamp_ns, 10**9)
    return {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": frame}


def _xyz(values: Any) -> dict[str, float]:
    return dict(zip("xyz", map(float, values), strict=True))
