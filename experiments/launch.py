"""How an experiment is started: a preset gives the defaults, options change single fields.

    python -m experiments.expert --preset smoke --seed 3 --ppo.learning-rate 3e-4

The exit status is 0, 2 after bad input, or 130 after Ctrl-C, as for `mjx-cutting`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from mjx_cutting import _platform


def launch(
    run: Callable[[Any], Path], presets: Mapping[str, Any], arguments: Sequence[str] | None = None
) -> int:
    """Run an experiment from the command line and return the exit status.

    Arguments:
        run: takes a configuration and returns the folder with the results.
        presets: name -> configuration, all of one frozen dataclass.
        arguments: the words after the module's name; None: those of the process.
    """
    import tyro

    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        name, words = _preset(words, presets)
        _platform.enable_compile_cache()
        default = presets[name]
        options = tyro.cli(
            type(default),
            args=words,
            default=default,
            description=f"{run.__doc__}\nPreset {name}; --preset {'|'.join(presets)}",
        )
        print(f"results: {run(options)}")
    except KeyboardInterrupt as error:
        print(f"\n{error or 'interrupted'}", file=sys.stderr)
        return int(getattr(error, "exit_code", 130))
    except (ValueError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def _preset(words: list[str], presets: Mapping[str, Any]) -> tuple[str, list[str]]:
    first = next(iter(presets))
    for i, word in enumerate(words):
        if word == "--preset" or word.startswith("--preset="):
            joined = word.startswith("--preset=")
            value = word.split("=", 1)[1] if joined else "".join(words[i + 1 : i + 2])
            if value not in presets:
                raise ValueError(f"got --preset {value!r}; expected one of {', '.join(presets)}; choose one")
            return value, words[:i] + words[i + (1 if joined else 2) :]
    return first, words
