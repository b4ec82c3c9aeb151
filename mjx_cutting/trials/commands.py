"""What `mjx-cutting data list | get | import | check` do: functions that print tables, return an exit status.

The idea: the command line stays thin, and a notebook can call the same functions. Nothing is written unless
all of it can be.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any, Literal

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from mjx_cutting.trials.catalogue import CATALOGUE, fetch, locate, resolve
from mjx_cutting.trials.checks import feed_per_tooth_m
from mjx_cutting.trials.dataset import Dataset, Trial
from mjx_cutting.trials.writing import write

ImportKind = Literal["dynoware", "slotting", "drilling", "mcap"]
FileFormat = Literal["csv", "parquet"]


def list_(*, console: Console | None = None) -> int:
    """Shows the public data sets: where each is, its size, its source and its licence. Returns 0."""
    console = console or Console()
    for name, data in CATALOGUE.items():
        try:
            found = locate(name)
            where = str(found) if found is not None else f"not here yet: mjx-cutting data get {name}"
        except ValueError as error:
            where = str(error)
        console.print(f"[bold]{name}[/bold]")
        grid = Table.grid(padding=(0, 2))
        grid.add_column()
        grid.add_column(overflow="fold")
        rows = {
            "what": data.title,
            "size": f"{data.size_bytes / 1e6:.1f} MB, {len(data.files)} files",
            "where": where,
            "source": data.source_url,
            "licence": data.licence,
        }
        for key, value in rows.items():
            grid.add_row(f"  {key}", escape(value))
        console.print(grid)
    return 0


def get(
    name: str,
    out: str | os.PathLike[str] | None = None,
    *,
    file_format: FileFormat = "csv",
    cache: Path | None = None,
    base_url: str | None = None,
    console: Console | None = None,
) -> int:
    """Downloads a public data set into the user's cache, unless it is there, and shows its licence.

    With `out` it is also written there as a dataset folder.

    Returns 0. Raises ValueError for an unknown name or a wrong local copy, DownloadError where it cannot be
    had, OSError where `out` cannot be written.
    """
    console = console or Console()
    folder = fetch(name, cache=cache, base_url=base_url)
    console.print(f"{name}: whole and checked in {escape(str(folder))}")
    console.print(f"licence: {escape(CATALOGUE[name].licence)}; source: {escape(CATALOGUE[name].source_url)}")
    if out is not None:
        dataset = CATALOGUE[name].load(folder)
        _write_and_tell(dataset, Path(out), file_format, console)
    return 0


def import_(
    kind: ImportKind,
    path: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    conditions: str | os.PathLike[str] | None = None,
    name: str | None = None,
    file_format: FileFormat = "csv",
    tool_kind: str | None = None,
    teeth: int | None = None,
    diameter_m: float | None = None,
    helix_rad: float | None = None,
    milling: str | None = None,
    spindle_speed_rev_s: float | None = None,
    feed_speed_m_s: float | None = None,
    radial_depth_m: float | None = None,
    axial_width_m: float | None = None,
    material: str | None = None,
    sample_rate_hz: float | None = None,
    axes: str | Sequence[str] | None = None,
    wrench_topic: str | None = None,
    pose_topic: str | None = None,
    console: Console | None = None,
) -> int:
    """Makes a dataset folder from recordings in another form.

    Arguments: kind: "dynoware" (text exports), "slotting" and "drilling" (the public sets' own files),
    "mcap"; path of a recording or a folder of them; out, the folder to make; conditions, a side file
    (docs/dataset.md), default conditions.toml beside the recordings; the other options stand for every trial
    and go before the side file's defaults, units in their names, axes as "+y,+x,-z"; file_format of the
    trials.

    Returns 0. Raises ValueError where nothing can be imported or `out` has something in it (FileExistsError),
    nothing is then written.
    """
    console = console or Console()
    place = Path(path)
    if kind in ("slotting", "drilling"):
        if not place.exists():
            raise ValueError(
                f"{place}: got no such file or folder, expected the files of {kind}; check the path."
            )
        dataset = CATALOGUE[kind].load(place)
    elif kind in ("dynoware", "mcap"):
        options: dict[str, Any] = {
            "tool": {"kind": tool_kind, "teeth": teeth, "diameter_m": diameter_m, "helix_rad": helix_rad},
            "trial": {
                "milling": milling,
                "spindle_speed_rev_s": spindle_speed_rev_s,
                "feed_speed_m_s": feed_speed_m_s,
                "radial_depth_m": radial_depth_m,
                "axial_width_m": axial_width_m,
                "material": material,
            },
            "sensor": {"sample_rate_hz": sample_rate_hz},
            "axes": axes.split(",") if isinstance(axes, str) else axes,
        }
        dataset = _import_recordings(kind, place, conditions, options, name, wrench_topic, pose_topic)
    else:
        raise ValueError(
            f"kind: got {kind!r}, expected dynoware, slotting, drilling or mcap; correct the word."
        )
    if name is not None:
        dataset = replace(dataset, name=name)
    _write_and_tell(dataset, Path(out), file_format, console)
    return 0


def check(name_or_folder: str | os.PathLike[str], *, console: Console | None = None) -> int:
    """Reads a dataset folder, or a public data set by name, and shows the verdict on each trial.

    Returns 0 where all trials are good, 1 where any is left out.
    Raises ValueError where dataset.json is broken or no trial is good.
    """
    console = console or Console()
    dataset = resolve(name_or_folder)
    _show(dataset, console)
    return 1 if dataset.left_out else 0


def write_as_mcap(
    name_or_folder: str | os.PathLike[str], out: str | os.PathLike[str], *, console: Console | None = None
) -> int:
    """Writes the good trials of a dataset as MCAP files and says where. Returns 0.

    Raises ValueError where the dataset is broken or the extra `mcap` is missing, OSError where the folder
    cannot be written.
    """
    from mjx_cutting.trials.mcap_writing import write_mcap

    dataset = resolve(name_or_folder)
    try:
        folder = write_mcap(dataset, out)
    except ImportError as error:
        raise ValueError(str(error)) from None
    (console or Console()).print(f"{len(dataset.trials)} trials written: {escape(str(folder))}")
    return 0


def _import_recordings(
    kind: str,
    path: Path,
    conditions: str | os.PathLike[str] | None,
    options: dict[str, Any],
    name: str | None,
    wrench_topic: str | None,
    pose_topic: str | None,
) -> Dataset:
    from mjx_cutting.trials.importers.conditions import find_side_file, merge_options, read_side_file

    side_file = Path(conditions) if conditions is not None else find_side_file(path)
    table = None
    given = any(
        value is not None for group in ("tool", "trial", "sensor") for value in options[group].values()
    )
    if side_file is not None or given or options["axes"] is not None:
        table = merge_options(read_side_file(side_file) if side_file is not None else {}, **options)
    if kind == "mcap":
        from mjx_cutting.trials.importers.mcap import import_mcap, require_mcap

        try:
            require_mcap()
        except ImportError as error:
            raise ValueError(str(error)) from None
        return import_mcap(
            path, conditions=table, name=name, wrench_topic=wrench_topic, pose_topic=pose_topic
        )
    from mjx_cutting.trials.importers.dynoware import import_dynoware

    return import_dynoware(path, conditions=table, name=name)


def _write_and_tell(dataset: Dataset, out: Path, file_format: FileFormat, console: Console) -> None:
    if file_format not in ("csv", "parquet"):
        raise ValueError(f"file_format: got {file_format!r}, expected csv or parquet; correct the word.")
    trials = tuple(
        replace(trial, file=str(PurePosixPath(trial.file).with_suffix(f".{file_format}")))
        for trial in dataset.trials
    )
    write(replace(dataset, trials=trials), out)
    _show(replace(dataset, trials=trials), console)
    console.print(f"written: {escape(str(out))}")


def _show(dataset: Dataset, console: Console) -> None:
    tool = dataset.tool
    console.print(
        f"{escape(dataset.name)}: {tool.kind}, {tool.teeth} teeth, {tool.diameter_m * 1e3:g} mm, "
        f"{dataset.sensor.sample_rate_hz:g} Hz; source: {escape(dataset.source or 'not given')}; "
        f"licence: {escape(dataset.licence or 'not given')}"
    )
    table = Table(
        title=f"{len(dataset.trials)} good, {len(dataset.left_out)} left out",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )
    table.add_column("trial", overflow="fold")
    table.add_column("cut", no_wrap=True)
    for heading in ("rev/s", "um/tooth", "depth mm", "width mm", "s", "rms"):
        table.add_column(heading, justify="right")
    table.add_column("verdict")
    for trial in dataset.trials:
        table.add_row(*map(escape, _row(trial, dataset)))
    console.print(table)
    for one in dataset.left_out:
        console.print(f"[red]left out[/red] {escape(one.file)}: {escape(one.reason)}")
    for warning in dataset.warnings:
        console.print(f"[yellow]warning[/yellow] {escape(warning)}")


def _row(trial: Trial, dataset: Dataset) -> tuple[str, ...]:
    doubts = sum(warning.startswith(f"{trial.file}: ") for warning in dataset.warnings)
    return (
        trial.file,
        trial.milling or trial.kind if trial.kind == "cut" else trial.kind,
        f"{trial.spindle_speed_rev_s:.4g}",
        f"{feed_per_tooth_m(trial, dataset.tool) * 1e6:.3g}",
        f"{trial.radial_depth_m * 1e3:.3g}",
        f"{trial.axial_width_m * 1e3:.3g}",
        f"{trial.time_s[-1] - trial.time_s[0]:.3g}",
        f"{float(np.sqrt(np.mean(trial.signals**2))):.3g}",
        f"good, {doubts} warnings" if doubts else "good",
    )
