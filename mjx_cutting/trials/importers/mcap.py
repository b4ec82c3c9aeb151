"""MCAP and rosbag2 recordings: forces from WrenchStamped messages, the tool's path from PoseStamped ones.

The idea: messages carry their own time stamps, which jitter; the record is put on an even grid at the
sensor's rate by linear interpolation, and a gap longer than a few samples is a reason to leave the trial out,
not to invent data. One file is one trial; its conditions come from a side file (see `conditions`), whose
`columns` may name the force and torque fields.

The assumption that breaks it: the wrench is given in the sensor's frame, and that frame does not turn against
the process frame during the trial; `axes` then maps it. Needs the extra `mcap`.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mjx_cutting.trials.checks import Verdict, check_trial, finish
from mjx_cutting.trials.dataset import Array, Dataset, LeftOut, Trial
from mjx_cutting.trials.importers.conditions import plan_import
from mjx_cutting.trials.records import FORCES, POSITIONS, TIME, TORQUE, records_of

PATTERNS = ("*.mcap",)
WRENCH_TYPES = ("geometry_msgs/msg/WrenchStamped", "geometry_msgs/WrenchStamped")
POSE_TYPES = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/PoseStamped")
LONGEST_GAP_SAMPLES = 5
"""A longer gap between messages, in sampling intervals, is not interpolated."""

ENDS_S = 0.1
"""The poses may begin later and end earlier than the wrench record by this [s]; the end values are held."""


def import_mcap(
    path: str | os.PathLike[str],
    *,
    conditions: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    name: str | None = None,
    wrench_topic: str | None = None,
    pose_topic: str | None = None,
) -> Dataset:
    """A checked dataset from an MCAP file, or a folder of them, with WrenchStamped messages.

    Arguments: path; conditions, as `import_dynoware` takes them, with sensor.sample_rate_hz; name of the
    dataset; wrench_topic and pose_topic, needed where a file has several of a kind.

    Raises ImportError where the extra is not installed, ValueError where nothing can be imported.
    """
    require_mcap()
    place = Path(path)
    given = conditions if conditions is None or isinstance(conditions, Mapping) else Path(conditions)
    plan = plan_import(place, patterns=PATTERNS, conditions=given, name=name, sample_rate_hz=None)
    manifest = plan.manifest
    places = {file.name: file for file in plan.files}
    outcomes: list[tuple[Trial | LeftOut, Verdict]] = []
    for entry in manifest.entries:
        try:
            columns, doubts = _columns(
                places[entry.file], manifest.sensor.sample_rate_hz, wrench_topic, pose_topic
            )
            wanted = {TIME, FORCES[2], TORQUE} if manifest.tool.measures_torque else {TIME, *FORCES}
            used = {key: value for key, value in columns.items() if key in wanted or key in POSITIONS}
            records, warnings = records_of(used, manifest.tool, manifest.axes)
            trial = Trial(file=f"{Path(entry.file).stem}.parquet", **entry.conditions, **records)
        except ValueError as error:
            outcomes.append((LeftOut(entry.file, str(error)), Verdict()))
            continue
        verdict = check_trial(trial, manifest.tool, manifest.sensor, manifest.axes)
        outcomes.append((trial, Verdict(verdict.reasons, (*doubts, *warnings, *verdict.warnings))))
    return finish(manifest.without_trials(), outcomes, where=str(place))


def require_mcap() -> None:
    """Raises ImportError, with how to install it, where the extra `mcap` is missing."""
    try:
        import mcap.reader  # noqa: F401
        import mcap_ros2.decoder  # noqa: F401
    except ImportError as error:
        raise ImportError(
            f"got no package {error.name}, expected mcap and mcap-ros2-support to read MCAP files; "
            "install them with: pip install 'mjx-cutting[mcap]'"
        ) from error


def _columns(
    path: Path, rate_hz: float, wrench_topic: str | None, pose_topic: str | None
) -> tuple[dict[str, Array], list[str]]:
    messages = _read_messages(path)
    wrench = _pick(messages, WRENCH_TYPES, wrench_topic, "WrenchStamped")
    if wrench is None:
        raise ValueError(
            f"got topics {_topics(messages)}, expected one of type WrenchStamped; record the force sensor."
        )
    stamps_s, values = wrench
    if len(stamps_s) < 2:
        raise ValueError(
            f"got {len(stamps_s)} wrench messages, expected two revolutions of them; record longer."
        )
    grid_s = _even_grid(stamps_s, rate_hz)
    columns = {TIME: grid_s - grid_s[0]}
    for index, name in enumerate((*FORCES, TORQUE)):
        columns[name] = np.interp(grid_s, stamps_s, values[:, index])
    pose = _pick(messages, POSE_TYPES, pose_topic, "PoseStamped")
    if pose is None:
        return columns, []
    if pose[0][0] > grid_s[0] + ENDS_S or pose[0][-1] < grid_s[-1] - ENDS_S:
        return columns, [
            "got poses that do not cover the wrench record, expected the whole of it; position is not used."
        ]
    columns |= {name: np.interp(grid_s, pose[0], pose[1][:, index]) for index, name in enumerate(POSITIONS)}
    return columns, []


def _even_grid(stamps_s: Array, rate_hz: float) -> Array:
    steps = np.diff(stamps_s)
    if (steps <= 0).any():
        raise ValueError(
            "got time stamps that do not increase, expected increasing header stamps; check the sensor's "
            "clock."
        )
    measured_hz = (len(stamps_s) - 1) / float(stamps_s[-1] - stamps_s[0])
    if abs(measured_hz / rate_hz - 1) > 0.01:
        raise ValueError(
            f"got {measured_hz:.5g} messages a second, expected sensor.sample_rate_hz = {rate_hz:g} within "
            "1 %; correct the rate, or "
            "record without losses."
        )
    if steps.max() > LONGEST_GAP_SAMPLES / rate_hz:
        raise ValueError(
            f"got a gap of {steps.max():.4g} s between messages at "
            f"{stamps_s[int(np.argmax(steps))] - stamps_s[0]:.4g} s, expected at "
            f"most {LONGEST_GAP_SAMPLES} sampling intervals; cut the record there."
        )
    count = int(np.floor((stamps_s[-1] - stamps_s[0]) * rate_hz * (1 + 1e-12))) + 1
    return stamps_s[0] + np.arange(count) / rate_hz


Messages = dict[str, tuple[str, Array, Array]]
"""Topic -> its type, stamps [T] in seconds, values [T, 4] (force, torque about z) or [T, 3] (position)."""


def _read_messages(path: Path) -> Messages:
    from mcap.exceptions import McapError
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    if not path.is_file():
        raise ValueError("got no such file, expected an MCAP file; check the path.")
    found: dict[str, tuple[str, list[int], list[tuple[float, ...]]]] = {}
    try:
        with path.open("rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            channels = (reader.get_summary() or _no_summary()).channels.values()
            schemas = {channel.topic: channel.schema_id for channel in channels}
            types = {
                schema.id: schema.name for schema in (reader.get_summary() or _no_summary()).schemas.values()
            }
            wanted = [t for t, schema in schemas.items() if types.get(schema) in (*WRENCH_TYPES, *POSE_TYPES)]
            others = {
                topic: types.get(schema, "") for topic, schema in schemas.items() if topic not in wanted
            }
            for schema, channel, message, decoded in (
                reader.iter_decoded_messages(topics=wanted) if wanted else ()
            ):
                kind = schema.name if schema is not None else ""
                stamp = decoded.header.stamp
                nanoseconds = stamp.sec * 1_000_000_000 + stamp.nanosec or message.log_time
                _, stamps, values = found.setdefault(channel.topic, (kind, [], []))
                stamps.append(nanoseconds)
                values.append(_values(decoded, kind))
    except (McapError, OSError) as error:
        raise ValueError(
            f"got a file that cannot be read as MCAP ({type(error).__name__}: {error}), expected a whole "
            "recording with its summary; repair it with `mcap recover`."
        ) from None
    messages: Messages = {topic: (kind, np.empty(0), np.empty((0, 3))) for topic, kind in others.items()}
    origin = min((min(stamps) for _, stamps, _ in found.values()), default=0)
    for topic, (kind, stamps, values) in found.items():
        seconds: Array = np.asarray([stamp - origin for stamp in stamps], dtype=np.float64) * 1e-9
        messages[topic] = (kind, seconds, np.asarray(values, dtype=np.float64))
    return messages


def _no_summary() -> Any:
    raise ValueError(
        "got an MCAP file without a summary, expected a whole recording; repair it with `mcap recover`."
    )


def _values(decoded: Any, kind: str) -> tuple[float, ...]:
    if kind in WRENCH_TYPES:
        force = decoded.wrench.force
        return force.x, force.y, force.z, decoded.wrench.torque.z
    position = decoded.pose.position
    return position.x, position.y, position.z


def _pick(
    messages: Messages, types: tuple[str, ...], topic: str | None, what: str
) -> tuple[Array, Array] | None:
    topics = [one for one, (kind, _, _) in messages.items() if kind in types]
    if topic is not None:
        if topic not in topics:
            raise ValueError(
                f"got topics {_topics(messages)}, expected {topic} of type {what}; correct the topic."
            )
        topics = [topic]
    if len(topics) > 1:
        raise ValueError(f"got {what} on {', '.join(topics)}, expected one topic; name the one to import.")
    return messages[topics[0]][1:] if topics else None


def _topics(messages: Messages) -> str:
    return ", ".join(f"{topic} ({kind})" for topic, (kind, _, _) in messages.items()) or "none"
