"""`mjx-cutting sim`: one episode of the simulation, told, drawn, filmed or watched."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from mjx_cutting.cli.folder import run_folder

if TYPE_CHECKING:
    from mjx_cutting.sim import CuttingEnv

SHOWN = (
    ("time_s", "time", "s"),
    ("path_deviation_mm", "path deviation", "mm"),
    ("load_n", "load", "N"),
    ("mrv_mm3", "removed volume", "mm^3"),
    ("reward", "reward", ""),
)


@dataclass(frozen=True)
class Sim:
    """Plays one episode of the cutting simulation and tells what came of it; draws it where asked to."""

    policy: Path | None = None
    """Run folder or policy.npz of train or adapt. Default: none, the fixed baseline (nominal feed, 1 mm)."""

    material: Literal["any", "foam", "plastic", "cardboard", "mica", "aluminium", "model"] = "foam"
    """Sheet; any: drawn by the seed; model: the constants of --model."""

    model: Path | None = None
    """model.json of trace, whose effects act. Default: none, the base model."""

    gp: Path | None = None
    """gp.npz of fit-gp. Default: none, no disturbance."""

    disturbance_mode: Literal["observation", "dynamics"] = "dynamics"
    """Whether the disturbance of --gp is only seen, or acts on robot and reward too."""

    engine: Literal["fused", "mjx"] = "fused"
    """fused: the fast formulation; mjx: the stages of MuJoCo MJX, the reference."""

    render: Path | None = None
    """Video to write, .mp4 or .gif: robot, sheet with the cut growing, force, traces. Needs the extra video.
    Default: none."""

    still: Path | None = None
    """Picture to write, .png. Default: none."""

    at_s: float = 10.0
    """When in the episode the picture is taken, s."""

    camera: Literal["cut", "overview"] = "cut"
    """cut: close to the saw; overview: the whole robot."""

    speed: float = 1.0
    """Speed of the video; 1 is real time."""

    view: bool = False
    """Watch it in MuJoCo's interactive viewer; needs a display."""

    seed: int = 0
    """Draws the episode's constants, disturbance and noise."""

    out: Path | None = None
    """Folder for episode.json with the settings and versions behind it, new or empty. Default: none."""

    def run(self) -> None:
        """Prints time, deviation, load, volume and reward, and where the pictures lie."""
        self._check()
        if self.out is None:
            told = self._play()
        else:
            with run_folder(self.out, "sim", self, self.seed) as (staged, _):
                told = self._play()
                (staged / "episode.json").write_text(json.dumps(told, indent=2) + "\n")
        print(f"{told['material']}: {told['ended']}")
        for key, name, unit in SHOWN:
            print(f"  {name:<15} {told[key]:.4g} {unit}".rstrip())
        for path in (self.render, self.still, self.out):
            if path is not None:
                print(f"written: {path}")

    def _check(self) -> None:
        if self.render is not None and self.render.suffix not in (".mp4", ".gif"):
            raise ValueError(f"got --render {self.render}; expected a name that ends in .mp4 or .gif")
        if self.still is not None and self.still.suffix != ".png":
            raise ValueError(f"got --still {self.still}; expected a name that ends in .png")
        if not self.speed > 0.0 or not self.at_s >= 0.0:
            raise ValueError(
                f"got --speed {self.speed} and --at-s {self.at_s}; expected above 0, and 0 or more"
            )
        if self.material == "model" and self.model is None:
            raise ValueError("got --material model without --model; give the model.json that trace wrote")
        if self.view and sys.platform.startswith("linux") and not _display():
            raise ValueError(
                "got --view, but there is no display (neither DISPLAY nor WAYLAND_DISPLAY is set); run it on "
                "a desktop, or write a film with --render cut.mp4"
            )

    def _play(self) -> dict[str, Any]:
        from mjx_cutting.learning.environment import make_env
        from mjx_cutting.sim import EnvConfig, render
        from mjx_cutting.sim.materials import MATERIALS

        names = tuple(MATERIALS) if self.material == "any" else (self.material,)
        config = EnvConfig(engine=self.engine, materials=names)
        env = make_env(config, self.model, self.gp, self.disturbance_mode)
        policy = self._policy(env)
        try:
            if self.still is not None:
                render.render_still(
                    env, policy, self.still, seed=self.seed, camera=self.camera, at_s=self.at_s
                )
            if self.view:
                render.view(env, policy, self.seed)
            with _progress(config.path_m / config.nominal_feed_m_s) as say:
                if self.render is None:
                    shots = render.play(env, policy, self.seed, every=25)
                else:
                    seen: list[Any] = []
                    render.render_video(
                        env, policy, self.render, seed=self.seed, camera=self.camera, speed=self.speed,
                        say=say, keep=seen.append,
                    )  # fmt: skip
                    shots = iter(seen)
                played = []
                for each in shots:
                    say(each[0].time_s)
                    played.append(each)
        except (ImportError, RuntimeError) as error:
            raise ValueError(str(error)) from error
        return render.tell(*played[-1]) | {"seed": self.seed}

    def _policy(self, env: CuttingEnv) -> Callable[[Any], Any]:
        from mjx_cutting.sim.baseline import BaselinePolicy

        if self.policy is None:
            return BaselinePolicy(env.config)
        from mjx_cutting.learning import load_policy

        loaded = load_policy(self.policy)
        if (loaded.observation_size, loaded.action_size) != (env.observation_size, env.action_size):
            raise ValueError(
                f"got {self.policy}, a policy of {loaded.observation_size} observations and "
                f"{loaded.action_size} actions; expected {env.observation_size} and {env.action_size}"
            )
        return loaded.apply


def _display() -> bool:
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


@contextmanager
def _progress(nominal_s: float) -> Iterator[Callable[[float], None]]:
    """A bar over the simulated time; an episode may be shorter or longer than `nominal_s`."""
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("simulating", total=nominal_s)
        yield lambda time_s: bar.update(task, completed=min(time_s, nominal_s))
