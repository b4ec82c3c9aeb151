"""`mjx-cutting train` and `mjx-cutting adapt`: policies, trained in the simulation.

The settings of the room itself are the options, so an option that a room gains is an option here. What a
preset stands for is worked in before the line is parsed: --help shows the sizes of the preset given.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import tyro

from mjx_cutting.learning import presets
from mjx_cutting.learning.adapt import AdaptConfig
from mjx_cutting.learning.settings import ImitationConfig, PPOConfig
from mjx_cutting.learning.train import TrainConfig
from mjx_cutting.sim.config import EnvConfig


@dataclass(frozen=True)
class Train(TrainConfig):
    """Trains an expert by PPO in the simulation. Ctrl-C keeps a checkpoint that --resume goes on from."""

    ppo: PPOConfig = presets.EXPERT["cpu"]

    @classmethod
    def on(cls, words: Sequence[str]) -> type[Train]:
        """Returns the options with the defaults of the preset on this line."""
        preset = _given(words, "preset", "cpu")
        presets.check(preset)
        return _with_defaults(cls, preset=preset, ppo=presets.EXPERT[preset])

    def run(self) -> None:
        """Prints the run folder."""
        from mjx_cutting.learning.loop import TrainingDiverged
        from mjx_cutting.learning.train import train

        try:
            print(f"trained: {train(self)}")
        except TrainingDiverged as error:
            raise ValueError(str(error)) from error


@dataclass(frozen=True)
class Adapt(AdaptConfig):
    """Adapts a trained expert to a disturbance or a traced effect. Ctrl-C keeps a checkpoint for --resume."""

    expert: Annotated[Path, tyro.conf.Positional]
    imitation: ImitationConfig = presets.IMITATION["cpu"]
    ppo: PPOConfig = presets.EXPERT["cpu"]
    env: tyro.conf.Suppress[EnvConfig | None] = None

    @classmethod
    def on(cls, words: Sequence[str]) -> type[Adapt]:
        """Returns the options with the defaults of the preset and the strategy on this line."""
        preset = _given(words, "preset", "cpu")
        presets.check(preset)
        sizes = presets.FINE_TUNE if _given(words, "strategy", "dagger") == "fine_tune" else presets.EXPERT
        return _with_defaults(cls, preset=preset, ppo=sizes[preset], imitation=presets.IMITATION[preset])

    def run(self) -> None:
        """Prints the run folder."""
        from mjx_cutting.learning.adapt import adapt
        from mjx_cutting.learning.loop import TrainingDiverged

        try:
            print(f"adapted: {adapt(self)}")
        except TrainingDiverged as error:
            raise ValueError(str(error)) from error


def _given(words: Sequence[str], option: str, default: str) -> str:
    """The value of an option on the line, else the default."""
    for before, word in zip(("", *words), words, strict=False):
        if before == f"--{option}":
            return word
        if word.startswith(f"--{option}="):
            return word.split("=", 1)[1]
    return default


def _with_defaults(options: type[Any], **defaults: Any) -> type[Any]:
    """The same options with other defaults."""
    kinds = get_type_hints(options, include_extras=True)
    changed = [(name, kinds[name], dataclasses.field(default=value)) for name, value in defaults.items()]
    namespace = {"__module__": options.__module__, "__doc__": options.__doc__}
    return dataclasses.make_dataclass(
        options.__name__, changed, bases=(options,), frozen=True, namespace=namespace
    )
