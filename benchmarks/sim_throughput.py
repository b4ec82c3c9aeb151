"""How fast the simulation is, beside what anyone would use instead, all in one run on this machine.

    python benchmarks/sim_throughput.py [--quick] [--json FILE] [--plot FILE.png] [--engines fused mjx]

Whole physics steps are counted (dynamics, control, cutting force, sheet, sensor, payload error and torque
limits live). Peers: a Gymnasium-style environment on C MuJoCo with the same control and force in NumPy, in
one and two processes, and the bare dynamics in mujoco.rollout on one and two threads. Compile times are those
of the first step call in a fresh process, without and with the persistent cache.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from mjx_cutting import _files
from mjx_cutting.sim import throughput


def draw(result: dict[str, Any], path: Path) -> None:
    """Rate against the number of environments, peers as level lines."""
    import io

    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(7.0, 4.2), constrained_layout=True)
    for engine, rates in result["rates"].items():
        batches = [int(b) for b in rates]
        axes.plot(
            batches, [f["physics_steps_per_s"] for f in rates.values()], "o-", label=f"mjx-cutting, {engine}"
        )
    for style, (name, rate) in zip(("--", "-.", ":", "-"), result["peers"].items(), strict=False):
        axes.axhline(rate, color="0.4", linestyle=style, linewidth=1.0, label=name.replace("_", " "))
    axes.set(xscale="log", yscale="log", xlabel="environments", ylabel="physics steps per second")
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize=8)
    buffer = io.BytesIO()
    figure.savefig(buffer, format=path.suffix.lstrip(".") or "png", dpi=150)
    pyplot.close(figure)
    _files.write_atomic(path, buffer.getvalue())


def main() -> None:
    """Parse the command line, measure, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="few batch sizes, one second each")
    parser.add_argument("--json", type=Path, help="write all figures to this file")
    parser.add_argument("--plot", type=Path, help="write a plot over batch sizes to this file")
    parser.add_argument(
        "--engines", nargs="+", default=["fused"], choices=["fused", "mjx"], help="ours to measure"
    )
    parser.add_argument("--batches", nargs="+", type=int, help="numbers of environments")
    given = parser.parse_args()
    batches = given.batches or (throughput.QUICK_BATCHES if given.quick else throughput.BATCHES)
    result = throughput.compare(
        tuple(batches),
        seconds=1.0 if given.quick else 4.0,
        engines=tuple(given.engines),
        say=lambda line: print(line, flush=True),
    )
    print(throughput.table(result))
    print(f"state of one environment: {result['state_bytes_per_environment']} bytes")
    if given.json:
        _files.write_atomic(given.json, json.dumps(result, indent=2) + "\n")
    if given.plot:
        draw(result, given.plot)


if __name__ == "__main__":
    main()
