"""The picture of `throughput.compare`: rate over the number of environments, the peers as level lines."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from mjx_cutting import _files

_PEERS = {
    "gym_one_process": ("Gymnasium-style C MuJoCo, 1 process", ":", "#9a3324"),
    "gym_two_processes": ("Gymnasium-style C MuJoCo, 2 processes", "-", "#9a3324"),
    "rollout_one_thread": ("mujoco.rollout, bare dynamics, 1 thread", ":", "0.35"),
    "rollout_two_threads": ("mujoco.rollout, bare dynamics, 2 threads", "-", "0.35"),
}
_OURS = {"fused": "#2c6e8f", "mjx": "#d08a2e"}


def draw(result: dict[str, Any], path: str | Path) -> Path:
    """Returns `path` (.png, .svg, .pdf), now holding the picture; written whole or not at all."""
    path = Path(path)
    figure = Figure(figsize=(7.4, 4.4), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    for engine, rates in result["rates"].items():
        batches = [int(batch) for batch in rates]
        speeds = [each["physics_steps_per_s"] for each in rates.values()]
        axes.plot(batches, speeds, "o-", color=_OURS.get(engine), label=f"mjx-cutting, {engine}: whole steps")
    for name, rate in result["peers"].items():
        label, style, colour = _PEERS[name]
        axes.axhline(rate, color=colour, linestyle=style, linewidth=1.2, label=label)
    axes.set(xscale="log", yscale="log", xlabel="environments at once", ylabel="physics steps per second")
    machine = result["machine"]
    name = machine["backend"] if machine["backend"] == "cpu" else machine["device_kind"]
    axes.set_title(f"{machine['cores']} cores, jax {machine['jax']}, {name}", fontsize=10)
    axes.grid(alpha=0.25, which="major")
    figure.legend(loc="outside lower center", ncols=2, fontsize=8, frameon=False)
    buffer = io.BytesIO()
    figure.savefig(buffer, format=path.suffix.lstrip("."), dpi=130)
    return _files.write_atomic(path, buffer.getvalue())
