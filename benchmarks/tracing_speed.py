"""How long `trace` takes with the full library: cold, and with a warm compile cache, and how much memory.

    python benchmarks/tracing_speed.py [--trials 15] [--samples 4000] [--json FILE]

Each figure is of a fresh process that imports the package, traces and ends; the cold one starts with an empty
compile cache, the warm one with what that left. The session is the injection study's (`benchmarks/study`), an
end mill or a slitting saw with one hidden effect, its conditions repeated up to the number of trials asked
for. Wall-clock time, the processor's time over all cores, and the largest resident memory of the process.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

PAUSE_S = 60.0


def main() -> None:
    """Parse the command line, measure, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--design", choices=("mill", "saw"), default="saw")
    parser.add_argument("--effect", default="flank_wear", help='hidden effect, medium strength, or "nothing"')
    parser.add_argument("--trials", type=int, default=15, help="cut trials")
    parser.add_argument("--samples", type=int, default=4000, help="samples of each")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, help="write all figures to this file")
    parser.add_argument("--cold-only", action="store_true", help="one process, with an empty cache")
    parser.add_argument("--traced", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.traced:
        print(json.dumps(traced(given.traced)))
        return
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "session"
        make(given, place)
        runs = {}
        for name in ("cold",) if given.cold_only else ("cold", "warm"):
            runs[name] = once(place, Path(folder) / "cache")
            print(f"{name}: {json.dumps(runs[name])}", flush=True)
    if given.json:
        from mjx_cutting import _files, _platform
        from mjx_cutting.sim import throughput

        told = {
            "command": ["python", "benchmarks/tracing_speed.py", *sys.argv[1:]],
            "versions": _platform.versions(),
            "machine": throughput.machine(),
            "session": {k: getattr(given, k) for k in ("design", "effect", "trials", "samples", "seed")},
            **runs,
        }
        _files.write_atomic(given.json, json.dumps(told, indent=1) + "\n")


def make(given: argparse.Namespace, place: Path) -> None:
    """The session as a dataset in the folder `place`."""
    from benchmarks.study.designs import plan, stream
    from benchmarks.study.generator import recorded
    from benchmarks.study.strengths import draw
    from mjx_cutting.trials.dataset import Dataset
    from mjx_cutting.trials.writing import write

    hidden = () if given.effect == "nothing" else (given.effect,)
    session = plan(given.design, given.seed, hidden)
    seconds = given.samples / session.sensor.sample_rate_hz
    cuts, clock, length = [], 0.0, 0.0
    whole = [cut for cut in session.cuts if cut.kind == "cut"]
    for index in range(given.trials):
        cut = whole[index % len(whole)]
        phase = float(stream(given.seed, "phase", index).uniform(0.0, 6.28))
        cuts.append(replace(cut, duration_s=seconds, phase_rad=phase, clock_s=clock, length_before_m=length))
        clock, length = clock + seconds + PAUSE_S, length + cuts[-1].path_m
    bias = session.bias_n[[index % len(session.bias_n) for index in range(given.trials)]]
    session = replace(session, cuts=tuple(cuts), bias_n=bias)
    effects = {name: draw(name, session, "medium", stream(given.seed, name)) for name in hidden}
    session, trials = recorded(session, effects, given.seed)
    dataset = Dataset(
        name="speed",
        source="benchmarks/study",
        licence="Apache-2.0",
        tool=session.tool,
        sensor=session.sensor,
        trials=trials,
    )
    write(dataset, place)


def once(place: Path, cache: Path) -> dict[str, Any]:
    """One fresh process: its whole time, and what it told of itself."""
    environment = {**os.environ, "JAX_COMPILATION_CACHE_DIR": str(cache)}
    line = [sys.executable, __file__, "--traced", str(place)]
    began = time.perf_counter()
    out = subprocess.run(line, env=environment, capture_output=True, text=True, check=True).stdout
    return {"process_wall_s": round(time.perf_counter() - began, 1), **json.loads(out.splitlines()[-1])}


def traced(place: Path) -> dict[str, Any]:
    """Traces a dataset as the command line does; time, memory, verdict."""
    began = time.perf_counter()
    from mjx_cutting import _platform

    _platform.enable_compile_cache()
    from mjx_cutting.tracing import trace
    from mjx_cutting.trials.reading import read

    found = trace(read(place))
    used = resource.getrusage(resource.RUSAGE_SELF)
    return {
        "trace_wall_s": round(time.perf_counter() - began, 1),
        "cpu_s": round(used.ru_utime + used.ru_stime, 1),
        "memory_mb": round(used.ru_maxrss / 1024),
        "verdict": found.verdict["verdict"],
        "named": [each["name"] for each in found.verdict["effects"]],
    }


if __name__ == "__main__":
    main()
