"""The injection study: blind sessions from an independent simulator, traced, and marked against the truth.

    python benchmarks/tracing_study.py --quick
    python benchmarks/tracing_study.py --design saw --seeds 10 --log saw.jsonl --json results.json

Every effect at three strengths, pairs, sessions with nothing missing and causes beyond any library, for the
designs mill, saw, drill and turning. Each case is appended to the log when it is done, and a run finds in the
log what it need not repeat. `--peers` also scores, at new speeds and feeds, the base model, the named effect,
one Gaussian process on time, sparse polynomial terms and a small neural residual. `--trials one_speed` (or
five, unstated) traces sessions cut down to what a busy person records. `--figure` draws the share
of first names that are right, effect by strength.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
import traceback
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from benchmarks.study import DESIGNS, make
from benchmarks.study.cases import Question, questions
from benchmarks.study.fewer import FEWER
from benchmarks.study.isolability import isolability
from benchmarks.study.scoring import marked, seen_over_noise
from benchmarks.study.strengths import LEVELS
from benchmarks.study.tables import draw, gathered, printed


def answer(question: Question, peers: bool = False) -> dict[str, Any]:
    """Makes the session, traces it and marks the verdict; a failure is a row too."""
    from mjx_cutting import _platform
    from mjx_cutting.tracing.trace import trace

    _platform.enable_compile_cache()
    effects = dict.fromkeys(question.effects, question.strength)
    case = make(question.design, effects, question.seed)
    began = time.perf_counter()
    try:
        found = trace(FEWER[question.trials](case.dataset), seed=question.seed)
    except Exception as error:
        fault = {"error": f"{type(error).__name__}: {error}"[:500], "where": traceback.format_exc()[-1500:]}
        return {"key": question.key, **asdict(question), **fault}
    row = marked(question, case.truth, found.verdict)
    row["seconds"] = time.perf_counter() - began
    row["seen_over_noise"] = seen_over_noise(question)
    whole = question.trials == "all"
    if whole and question.kind == "single":
        row["isolability"] = isolability(question.design, question.seed, question.strength)[
            question.effects[0]
        ]
    if whole and peers and question.design in ("mill", "saw"):
        try:
            row["peers"] = beside(question, effects, found)
        except Exception as error:
            row["peers"] = {"error": f"{type(error).__name__}: {error}"[:300]}
    return row


def beside(question: Question, effects: dict[str, Any], found: Any) -> dict[str, float]:
    """Error at new speeds and feeds of the base model, the model found, and each peer."""
    from benchmarks.study import peers
    from mjx_cutting.tracing.along.predicted import predict_trials

    new = peers.unbiased(make(question.design, effects, question.seed, new=True))
    train = peers.unbiased(make(question.design, effects, question.seed))
    known = predict_trials(train, found.base_model)
    asked = predict_trials(new, found.base_model)
    scores = {"base": peers.nrmse(asked), "traced": peers.nrmse(predict_trials(new, found.model))}
    for name, peer in peers.PEERS.items():
        scores[name] = peers.nrmse(asked, peer(train, known, new, asked))
    noise = [p.measured_n for p in asked]
    sensor = new.sensor
    if sensor.noise_std_n is not None and sensor.anti_alias is not None:
        share = sensor.anti_alias.hz / (0.5 * sensor.sample_rate_hz)
        power = sum(float((each**2).sum()) for each in noise) / sum(each.size for each in noise)
        scores["floor"] = float((sum(s * s for s in sensor.noise_std_n) / 3.0 * share / power) ** 0.5)
    return scores


def run(todo: list[Question], log: Path, processes: int, peers: bool) -> None:
    """Answers the questions and appends each to the log as it is done."""
    began = time.perf_counter()

    def write(count: int, row: dict[str, Any]) -> None:
        with log.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        said = row.get("error") or f"{row['verdict']}: {', '.join(row['named']) or '-'}"
        took = time.perf_counter() - began
        print(f"{count}/{len(todo)} {took:6.0f} s  {row['key']:55s} {said}", flush=True)

    if processes == 1:
        for count, question in enumerate(todo, 1):
            write(count, answer(question, peers))
        return
    from multiprocessing import get_context

    # not an executor: that of Python 3.11 may wait for ever once every worker has done its tasks
    with get_context("spawn").Pool(processes, maxtasksperchild=20) as pool:
        for count, row in enumerate(pool.imap_unordered(partial(answer, peers=peers), todo), 1):
            write(count, row)


def main() -> None:
    """Runs what is asked for and not yet in the log; prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--quick", action="store_true", help="saw and mill, medium strength, few effects, 1 seed"
    )
    parser.add_argument("--json", metavar="FILE", help="write the tables to FILE")
    parser.add_argument("--figure", metavar="FILE", help="draw the heat map to FILE (png or svg)")
    parser.add_argument("--log", metavar="FILE", default="tracing_study.jsonl", help="where cases are kept")
    parser.add_argument("--design", nargs="+", choices=DESIGNS, help="default: all")
    parser.add_argument(
        "--effects", nargs="+", help='effects, "a+b", "nothing", "outside" or "pair"; default all'
    )
    parser.add_argument("--strength", nargs="+", choices=LEVELS, help="of single effects; default all")
    parser.add_argument(
        "--trials", choices=FEWER, default="all", help="what is left of each session (default all trials)"
    )
    parser.add_argument("--seeds", type=int, help="number of seeds (default 10, quick 1)")
    parser.add_argument("--first-seed", type=int, default=0, help="first of them (default 0)")
    parser.add_argument("--processes", type=int, default=1, help="sessions traced side by side (default 1)")
    parser.add_argument("--peers", action="store_true", help="also score the peers at new speeds and feeds")
    parser.add_argument("--tables-only", action="store_true", help="no tracing: tables of what is in the log")
    arguments = parser.parse_args()
    designs = arguments.design or (["saw", "mill"] if arguments.quick else list(DESIGNS))
    count = arguments.seeds or (1 if arguments.quick else 10)
    seeds = range(arguments.first_seed, arguments.first_seed + count)
    log = Path(arguments.log)
    asked = list(
        questions(designs, seeds, arguments.effects, arguments.quick, arguments.strength, arguments.trials)
    )
    rows = read(log)
    if not arguments.tables_only:
        done = {row["key"] for row in rows}
        run([each for each in asked if each.key not in done], log, arguments.processes, arguments.peers)
        rows = read(log)
    keys = {each.key for each in asked}
    found = gathered([row for row in rows if row["key"] in keys])
    print(printed(found))
    if arguments.json:
        from mjx_cutting import _files, _platform
        from mjx_cutting.sim import throughput

        command = ["python", "benchmarks/tracing_study.py", *sys.argv[1:]]
        found = {
            "command": command,
            "quick": arguments.quick,
            "machine": throughput.machine(),
            "versions": _platform.versions(),
            **found,
        }
        _files.write_atomic(arguments.json, json.dumps(found, indent=2) + "\n")
    if arguments.figure:
        draw(found, Path(arguments.figure))


def read(log: Path) -> list[dict[str, Any]]:
    """The finished cases; a line cut short by a kill is passed over, the last of a key counts."""
    if not log.exists():
        return []
    rows: dict[str, dict[str, Any]] = {}
    for line in log.read_text(encoding="utf-8").splitlines():
        try:
            row = json.loads(line)
        except json.JSONDecodeError:
            continue
        rows[row["key"]] = row
    return list(rows.values())


if __name__ == "__main__":
    main()
