"""Time warping measured: all ordered pairs of 14 trials of 2,500 samples, beside a C library pair by pair.

    python benchmarks/alignment.py [--quick] [--json FILE]

dtaidistance (C, compiled) computes another step pattern (symmetric1, closed end, squared Euclidean) at the
same cost a cell; on that pattern the two are also compared for equality. `--quick` takes 4 trials of 600
samples.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import sys
import time
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from mjx_cutting import _platform
from mjx_cutting.trials import dtw
from mjx_cutting.trials.align import align

RATE_HZ = 500.0


def trials(count: int, samples: int, seed: int = 0) -> tuple[list[np.ndarray], np.ndarray]:
    """Returns (series, lags_s): a periodic force with a rise, shifted and bent differently in each trial."""
    rng = np.random.default_rng(seed)
    t = np.arange(samples) / RATE_HZ
    lags = rng.uniform(-0.05, 0.05, count)
    made = []
    for lag in lags:
        bent = t - lag + 0.02 * rng.normal() * np.sin(np.pi * t / t[-1])
        rise = 1.0 / (1.0 + np.exp(-(bent - 0.3) / 0.04))
        cycle = np.sin(2 * np.pi * bent * 4.0)
        force = np.stack([rise * (3 + cycle), rise * (1 - cycle), 0.3 * cycle + rise], -1)
        made.append(force + 0.2 * rng.normal(size=force.shape))
    return made, lags


def main() -> None:
    """Runs the parts and prints the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="4 trials of 600 samples")
    parser.add_argument("--json", metavar="FILE", help="also write the figures to FILE")
    arguments = parser.parse_args()
    count, samples = (4, 600) if arguments.quick else (14, 2500)
    series, lags = trials(count, samples)
    found: dict[str, Any] = {
        "command": " ".join(["python", "benchmarks/alignment.py", *sys.argv[1:]]),
        "quick": arguments.quick,
        "machine": {
            "processor": platform.machine(),
            "cpus": os.cpu_count(),
            "load_1_min": os.getloadavg()[0],
        },
        "timing": "least of several repeats: other work on the machine can only lengthen a time",
        "versions": _platform.versions(),
        "trials": count,
        "samples": samples,
        "ordered_pairs": count * (count - 1),
    }
    seconds = []
    for _ in range(3):
        start = time.perf_counter()
        distance = dtw.distances(series)
        seconds.append(time.perf_counter() - start)
    found["dtw_seconds_cold"], found["dtw_seconds"] = seconds[0], min(seconds[1:])
    found["ns_per_cell"] = 1e9 * found["dtw_seconds"] / (count * (count - 1) * samples**2)
    found["asymmetry"] = float(np.max(np.abs(distance - distance.T)))
    start = time.perf_counter()
    path = dtw.warp(series[0], series[1])
    found["path_seconds_cold"], found["path_length"] = time.perf_counter() - start, len(path.query)
    start = time.perf_counter()
    aligned = align(series, RATE_HZ, warp_radius_s=0.1)
    found["align_seconds"] = time.perf_counter() - start
    error = (aligned.lag_s - aligned.lag_s.mean()) - (lags - lags.mean())
    found["lag_error_rms_s"] = float(np.sqrt(np.mean(error**2)))
    report = aligned.report()
    found |= {k: v for k, v in report.items() if k.startswith(("spread_", "period_"))}
    found["peak_rss_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    found["peers"] = peers(series)
    for key, value in found.items():
        print(f"{key}: {value:.4g}" if isinstance(value, float) else f"{key}: {value}")
    if arguments.json:
        with open(arguments.json, "w") as file:
            json.dump(found, file, indent=2)
            file.write("\n")


def peers(series: list[np.ndarray]) -> dict[str, Any]:
    """Returns the C library's seconds for all ordered pairs, and the difference where comparable."""
    try:
        from dtaidistance import dtw_ndim
    except ImportError:
        return {"dtaidistance": "absent"}
    repeats = []
    for _ in range(2):
        start = time.perf_counter()
        for query in range(len(series)):
            for reference in range(len(series)):
                if query != reference:
                    dtw_ndim.distance_fast(series[query], series[reference])
        repeats.append(time.perf_counter() - start)
    seconds = min(repeats)
    few = [s[:200] for s in series[:3]]
    ours = dtw.distances(few, open_end=False, step="symmetric1")
    theirs = [[dtw_ndim.distance(a, b, inner_dist="euclidean") for b in few] for a in few]
    return {
        "dtaidistance": {
            "seconds": seconds,
            "largest_relative_difference": float(np.max(np.abs(ours - theirs)) / np.max(theirs)),
        }
    }


if __name__ == "__main__":
    main()
