"""`mjx-cutting data list|get|import|mcap|check`: measured trials, public or the user's own."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Literal

import tyro


@dataclass(frozen=True)
class DataList:
    """Shows the public data sets known by name: what they are, their licence, and whether they are here."""

    def run(self) -> int:
        """Prints one entry a data set."""
        from mjx_cutting.trials.commands import list_

        return list_()


@dataclass(frozen=True)
class DataGet:
    """Downloads a public data set into the user's cache, pinned by SHA-256, unless it is there."""

    name: Annotated[str, tyro.conf.Positional]
    """A name of `mjx-cutting data list`."""

    out: Path | None = None
    """Folder to write it to as well, in the dataset format; must not exist or be empty. Default: none."""

    file_format: Literal["csv", "parquet"] = "csv"
    """Format of the trials in --out."""

    def run(self) -> int:
        """Prints where the data lie and their licence."""
        from mjx_cutting.trials.commands import get

        return get(self.name, self.out, file_format=self.file_format)


@dataclass(frozen=True)
class DataImport:
    """Turns recordings of another form into a folder in the dataset format, checked.

    What the recordings do not say comes from the options below, which stand for every trial, and from a side
    file (docs/dataset.md).
    """

    kind: Annotated[Literal["dynoware", "slotting", "drilling", "mcap"], tyro.conf.Positional]
    """dynoware: Kistler text exports. mcap: ROS 2 bags. slotting, drilling: files of that public data set."""

    path: Annotated[Path, tyro.conf.Positional]
    """A recording, or a folder of them."""

    out: Path
    """Folder to write; must not exist or be empty."""

    conditions: Path | None = None
    """TOML or JSON with tool, sensor and cutting conditions. Default: conditions.toml or conditions.json
    beside the recordings."""

    name: str | None = None
    """Name of the dataset. Default: that of the side file, or the path's."""

    file_format: Literal["csv", "parquet"] = "csv"
    """Format of the trials."""

    tool_kind: Literal["end_mill", "slitting_saw", "drill", "turning"] | None = None
    """What cuts."""

    teeth: int | None = None
    """Teeth of the tool."""

    diameter_m: float | None = None
    """Diameter of the tool, m."""

    helix_rad: float | None = None
    """Helix of the tool, rad."""

    milling: Literal["slot", "conventional", "climb"] | None = None
    """How the tool meets the sheet."""

    spindle_speed_rev_s: float | None = None
    """Spindle speed, rev/s (rpm / 60)."""

    feed_speed_m_s: float | None = None
    """Feed, m/s."""

    radial_depth_m: float | None = None
    """Depth of cut across the feed, m."""

    axial_width_m: float | None = None
    """Width of cut along the tool's axis, m."""

    material: str | None = None
    """What is cut."""

    sample_rate_hz: float | None = None
    """Sample rate of the force sensor, Hz."""

    axes: str | None = None
    """Process axis of each force column, such as --axes=+y,+x,-z."""

    wrench_topic: str | None = None
    """mcap: topic of the force. Default: the only one that carries a WrenchStamped."""

    pose_topic: str | None = None
    """mcap: topic of the tool's pose. Default: the only one that carries a PoseStamped."""

    def run(self) -> int:
        """Writes the folder and prints the verdict on each trial."""
        from mjx_cutting.trials.commands import import_

        return import_(**{field.name: getattr(self, field.name) for field in fields(self)})


@dataclass(frozen=True)
class DataMcap:
    """Writes trials as MCAP files, which Foxglove and ROS 2 open, one a trial."""

    dataset: Annotated[str, tyro.conf.Positional]
    """A name of `mjx-cutting data list`, or a folder in the dataset format."""

    out: Path
    """Folder to write; must not exist or be empty."""

    def run(self) -> int:
        """Prints the folder."""
        from mjx_cutting.trials.commands import write_as_mcap

        return write_as_mcap(self.dataset, self.out)


@dataclass(frozen=True)
class DataCheck:
    """Reads trials and says which are good, which are left out and why, and what is doubtful."""

    dataset: Annotated[str, tyro.conf.Positional]
    """A name of `mjx-cutting data list`, or a folder in the dataset format."""

    def run(self) -> int:
        """Prints the verdict on each trial; returns 1 where one is left out."""
        from mjx_cutting.trials.commands import check

        return check(self.dataset)
