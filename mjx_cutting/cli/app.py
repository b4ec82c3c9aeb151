"""Finds the verb, parses its options, runs it, and turns what goes wrong into one line and an exit status.

A verb is a frozen dataclass whose fields are its options (tyro makes the parser and the help of them) and
whose `run` does the work by calling a room. Only the verb that was asked for is imported, so `mjx-cutting
--help` and `mjx-cutting data list` start without JAX.

Exit status: 0 done; 1 the work was done and its verdict is negative (a check that failed); 2 bad input, or
a file that cannot be read or written; 130 interrupted.
"""

from __future__ import annotations

import difflib
import importlib
import os
import sys
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mjx_cutting
from mjx_cutting import _platform
from mjx_cutting._files import explain

PROGRAM = "mjx-cutting"
DEBUG = "MJX_CUTTING_DEBUG"
HELP = ("-h", "--help", "help")


@dataclass(frozen=True)
class Verb:
    """Where a verb stands, and one line of help.

    Arguments:
        home: module under mjx_cutting.cli.
        options: its dataclass.
        help: what it does, for the list of verbs.
    """

    home: str
    options: str
    help: str


VERBS = {
    "demo": Verb("demo", "Demo", "run the whole loop once, in a few minutes, and report it"),
    "data list": Verb("data", "DataList", "show the public data sets known by name"),
    "data get": Verb("data", "DataGet", "download a public data set, pinned by SHA-256"),
    "data import": Verb("data", "DataImport", "turn recordings of another format into the dataset format"),
    "data mcap": Verb("data", "DataMcap", "write trials as MCAP files, for Foxglove and ROS 2"),
    "data check": Verb("data", "DataCheck", "say which trials are good, left out or doubtful"),
    "trace": Verb("trace", "Trace", "name the effect that a force model lacks on measured trials"),
    "fit-gp": Verb("disturbance", "FitGp", "fit what stays unexplained, for the simulation to draw from"),
    "sim": Verb("sim", "Sim", "play one episode of the cutting simulation: figures, video, still, viewer"),
    "train": Verb("learning", "Train", "train an expert in the simulation"),
    "adapt": Verb("learning", "Adapt", "adapt the expert to a disturbance or a traced effect"),
    "evaluate": Verb("evaluation", "Evaluate", "compare policies and the baseline on the same episodes"),
    "export": Verb("export", "Export", "write a trained policy to one file that needs NumPy alone"),
    "bench": Verb("bench", "Bench", "measure the simulation's speed on this machine, beside its peers"),
    "serve": Verb("serve", "Serve", "serve an exported policy to a robot's controller, and record it"),
    "cell": Verb("cell", "CellVerb", "run the virtual cell: robot, saw and sheet for a policy server"),
    "loop": Verb("loop", "Loop", "close the loop on the virtual cell: serve, record, trace, adapt, again"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Returns the exit status of one command line.

    Args:
        arguments: the words after the program's name; default those of the process.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in words or os.environ.get(DEBUG, "") not in ("", "0")
    words = [word for word in words if word != "--debug"]
    if not words or words[0] in HELP:
        print(usage(VERBS))
        return 0 if words else 2
    if words[1:2] in ([], *([word] for word in HELP)) and (group := _group(words[0])):
        print(usage(group))
        return 0 if words[1:] else 2
    if words[0] == "--version":
        print(f"{PROGRAM} {mjx_cutting.__version__}")
        return 0
    try:
        return _run(words)
    except KeyboardInterrupt as error:
        told = str(error) or "interrupted; what was complete has been kept, nothing is half written"
        print(f"\n{told}", file=sys.stderr)
        return int(getattr(error, "exit_code", 130))
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except (ValueError, OSError) as error:
        if debug:
            traceback.print_exc()
        told = explain(error) if isinstance(error, OSError) else str(error)
        print(f"error: {told}", file=sys.stderr)
        if not debug:
            print(f"(--debug, or {DEBUG}=1, shows where)", file=sys.stderr)
        return 2


def usage(verbs: Mapping[str, Verb]) -> str:
    """Returns the list of these verbs, one a line."""
    width = max(map(len, verbs))
    lines = [f"  {name:<{width}}  {verb.help}" for name, verb in verbs.items()]
    return "\n".join(
        [
            f"usage: {PROGRAM} VERB [options]",
            "",
            "Names the physics a cutting force model lacks, simulates with it, and adapts the policy that "
            "cuts.",
            "",
            *lines,
            "",
            f"{PROGRAM} VERB --help shows a verb's options with their units and defaults; --version, "
            f"--debug.",
        ]
    )


def _run(words: list[str]) -> int:
    name, rest = _match(words)
    verb = VERBS[name]
    _platform.enable_compile_cache()
    import tyro

    options = getattr(importlib.import_module(f"mjx_cutting.cli.{verb.home}"), verb.options)
    if hasattr(options, "on"):  # defaults that depend on the line
        options = options.on(rest)
    parsed = tyro.cli(options, args=rest, prog=f"{PROGRAM} {name}", config=(tyro.conf.FlagCreatePairsOff,))
    status = parsed.run()
    sys.stdout.flush()
    return int(status or 0)


def _match(words: list[str]) -> tuple[str, list[str]]:
    """The verb of one or two words that the line starts with, and the words after it."""
    for count in (2, 1):
        name = " ".join(words[:count])
        if len(words) >= count and name in VERBS:
            return name, words[count:]
    group = _group(words[0])
    if group:
        raise ValueError(f"got the verb {' '.join(words[:2])!r}; expected one of: {', '.join(group)}")
    near = difflib.get_close_matches(words[0], VERBS, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    raise ValueError(f"got the verb {words[0]!r}; expected one of: {', '.join(VERBS)}{hint}")


def _group(word: str) -> dict[str, Verb]:
    """The verbs of two words of which this is the first."""
    return {name: verb for name, verb in VERBS.items() if name.startswith(word + " ")}
