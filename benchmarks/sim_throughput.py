"""How fast the simulation is, beside what anyone would use instead, all in one run on this machine.

    python benchmarks/sim_throughput.py [--quick] [--json FILE] [--plot FILE.png] [--engines fused mjx]

Whole physics steps are counted (dynamics, control, cutting force, sheet, sensor, payload error and torque
limits live). Peers: a Gymnasium-style environment on C MuJoCo with the same control and force in NumPy, in
one and two processes, and the bare dynamics in mujoco.rollout on one and two threads. Compile times are those
of the first step call in a fresh process, without and with the persistent cache. `mjx-cutting bench` does the
same from an installed wheel.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from mjx_cutting import _files
from mjx_cutting.sim import throughput, throughput_figure


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
    if given.json:
        _files.write_atomic(given.json, json.dumps(result, indent=2) + "\n")
    if given.plot:
        throughput_figure.draw(result, given.plot)


if __name__ == "__main__":
    main()
