"""`mjx-cutting demo`: the whole loop once, small enough for two cores and a few minutes.

Measured slotting trials are traced; the effect found acts in the simulation; a small expert is trained there;
what the model leaves unexplained becomes a disturbance; the expert is adapted to it by DAgger; both are
evaluated with and without it; the adapted policy is exported and run by the NumPy runtime. Everything ends in
one report.html.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mjx_cutting import runs
from mjx_cutting._files import write_atomic
from mjx_cutting.learning.settings import require
from mjx_cutting.sim.config import EnvConfig

LOAD_N = 11.0
"""Mean load of the paper's baseline over its five materials, N: what the disturbance is scaled to."""
MEASURED = "slotting"
BAND_HZ = (0.0, 250.0)
EFFECTS = ("radial_runout", "unequal_pitch", "size_effect", "sensor_resonance")
REPLAY_HZ = 500.0


@dataclass(frozen=True)
class DemoConfig:
    """Settings of the demo.

    Arguments:
        out: folder of the run; None: runs/<UTC time>-demo.
        seed: of everything random.
        preset: size of the training, "smoke" (does it run) or "demo".
        rollouts: episodes in each cell of the evaluation.
        effects: effects the tracing tries.
        quiet: no progress bars.
    """

    out: Path | None = None
    seed: int = 0
    preset: str = "demo"
    rollouts: int = 16
    effects: tuple[str, ...] = EFFECTS
    quiet: bool = False

    def __post_init__(self) -> None:
        require("preset", self.preset, self.preset in ("smoke", "demo"), "smoke or demo")
        require("rollouts", self.rollouts, self.rollouts >= 2, "at least 2")


@dataclass(frozen=True, eq=False)
class Outcome:
    """What the demo made, for its report.

    Fields:
        config, folder, seconds: settings, run folder, wall-clock time of each stage.
        measured: whether the trials were measured; if not, `why` says why.
        tracing: the tracing.
        disturbance: the fitted process; `replay` its times [T], s, and trials [R, T, 3], N.
        policies: by name, "untrained", "expert", "adapted".
        results: rollouts by domain ("source", "surrogate") and strategy.
        exported: parity and forces of the exported policy's own episode.
    """

    config: DemoConfig
    folder: Path
    env: EnvConfig
    measured: bool
    why: str
    tracing: Any
    disturbance: Any
    replay: tuple[np.ndarray, np.ndarray]
    policies: dict[str, Any]
    results: dict[str, dict[str, Any]]
    exported: dict[str, Any]
    seconds: dict[str, float] = field(default_factory=dict)


def run(config: DemoConfig) -> Path:
    """Run the loop and return the path of its report.

    Raises:
        OSError: the run folder cannot be written.
    """
    from rich.console import Console

    from mjx_cutting.loop.demo_report import render

    console = Console(stderr=True, quiet=config.quiet)
    folder = runs.open_run(config.out, "demo", config, config.seed)
    seconds: dict[str, float] = {}
    outcome = _loop(config, folder, console, seconds)
    with _stage("report", console, seconds):
        report = folder / "report.html"
        write_atomic(report, render(outcome))
    runs.append_metrics(folder, {"seconds": seconds, "total_s": sum(seconds.values())})
    return report


def _loop(config: DemoConfig, folder: Path, console: Any, seconds: dict[str, float]) -> Outcome:
    from mjx_cutting.deploy.export import export_policy
    from mjx_cutting.disturbance import fit
    from mjx_cutting.evaluation.evaluate import EvaluateConfig, run_domains
    from mjx_cutting.learning import presets
    from mjx_cutting.learning.adapt import AdaptConfig, adapt
    from mjx_cutting.learning.checkpoint import load_policy
    from mjx_cutting.learning.environment import make_env
    from mjx_cutting.learning.expert import initial_policy
    from mjx_cutting.learning.train import TrainConfig, train
    from mjx_cutting.loop.exported import fly
    from mjx_cutting.loop.transfer import replayed
    from mjx_cutting.tracing import save, trace

    size: Any = config.preset
    env = (
        EnvConfig() if config.preset == "demo" else EnvConfig(approach_m=0.005, cut_m=0.02, max_episode_s=4.0)
    )
    with _stage("trace the measured trials", console, seconds) as told:
        dataset, why = trials(config.seed)
        tracing = trace(dataset, band_hz=BAND_HZ, effects=config.effects, seed=config.seed, progress=told)
        save(tracing, folder / "trace")
    model = folder / "trace" / "model.json"
    with _stage("fit the disturbance to what is left", console, seconds):
        replay = replayed(tracing.after, env.spindle_speed_rev_s, REPLAY_HZ, LOAD_N)
        turn = env.spindle_speed_rev_s
        disturbance = fit(
            *replay,
            frequency_range_hz=(0.9 * turn, 1.1 * turn),
            trial_effects=False,  # a trial's own mean is not known: its bias was fitted away
            diagnose=False,
            provenance={"dataset": dataset.name, "load_n": LOAD_N, "replayed_rev_s": turn},
        )
        gp = disturbance.save(folder / "gp.npz")
    with _stage("train the expert", console, seconds, bar=True):
        train(
            TrainConfig(
                out=folder / "expert", seed=config.seed, preset=size, env=env, model=model, quiet=config.quiet
            )
        )
    with _stage("adapt it by DAgger", console, seconds, bar=True):
        adapt(
            AdaptConfig(
                expert=folder / "expert",
                strategy="dagger",
                gp=gp,
                model=model,
                out=folder / "adapted",
                seed=config.seed,
                preset=size,
                quiet=config.quiet,
            )
        )
    with _stage("evaluate on clean and disturbed simulation", console, seconds):
        policies = {
            "untrained": initial_policy(make_env(env, model), presets.EXPERT[config.preset], config.seed),
            "expert": load_policy(folder / "expert"),
            "adapted": load_policy(folder / "adapted"),
        }
        asked = EvaluateConfig(
            policies=(folder / "expert",),
            domain="both",
            gp=gp,
            model=model,
            disturbance_mode="observation",
            rollouts=config.rollouts,
            seed=config.seed + 1,
            env=env,
        )
        results = run_domains(asked, policies)
    with _stage("export the policy and run it", console, seconds):
        path = folder / "policy.npz"
        export_policy(policies["adapted"], path, provenance={"run": folder.name, "verb": "demo"})
        exported = fly(path, make_env(env, model, gp, "observation"), policies["adapted"], config.seed)
    return Outcome(
        config=config,
        folder=folder,
        env=env,
        measured=not why,
        why=why,
        tracing=tracing,
        disturbance=disturbance,
        replay=replay,
        policies=policies,
        results=results,
        exported=exported,
        seconds=seconds,
    )


def trials(seed: int) -> tuple[Any, str]:
    """The measured slotting trials and "", or trials made by calculation and why it is those."""
    from mjx_cutting.trials import resolve
    from mjx_cutting.trials.dataset import Sensor, ToolInfo
    from mjx_cutting.trials.synthetic import Conditions, Hidden, Sheet, make_trials

    try:
        return resolve(MEASURED), ""
    except (OSError, ValueError) as error:
        reason = str(error)
    feeds = (0.005, 0.010, 0.015, 0.020, 0.025)
    made = make_trials(
        ToolInfo("end_mill", 2, 0.025, 0.785),
        Sheet((9e8, 2.4e8, 1.4e8), (1.6e4, 2.0e4, 1.8e4)),
        [Conditions(100.0, feed, 0.025, 0.003) for feed in feeds],
        Sensor(10_000.0, (3.0, 4.0, 2.0)),
        hidden=Hidden(runout_m=1.1e-5),
        seed=seed,
        name="trials made by calculation",
    )
    return made, reason


@contextmanager
def _stage(title: str, console: Any, seconds: dict[str, float], bar: bool = False) -> Iterator[Any]:
    """Time a stage and say what it does; with `bar` it draws a progress bar of its own."""
    began = time.monotonic()
    if bar:
        console.print(f"[bold]{title}[/bold]")
        yield None
    else:
        with console.status(title) as status:
            yield lambda text: status.update(f"{title}: {text}")
    seconds[title] = time.monotonic() - began
    console.print(f"  {title}: {seconds[title]:.1f} s")
