"""The Python loop around one jitted iteration: progress, checkpoints, Ctrl-C, and a stop when a number is
not finite.

Nothing in it decides what is computed: `iterate` is a pure function of the state, and the loop calls it,
shows its metrics and saves the state. That is why a run may be killed at any moment and resumed to the
same bits. The first Ctrl-C (or SIGTERM) finishes the iteration, saves and leaves by `TrainingInterrupted`,
which exits with 128 plus the signal's number; the second leaves at once, and the last checkpoint stays whole.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

import jax
import numpy as np

from mjx_cutting import _platform
from mjx_cutting.learning import checkpoint, progress
from mjx_cutting.learning.distributed import Alone
from mjx_cutting.learning.policy import Policy

GUARD = "finite_"


class TrainingInterrupted(KeyboardInterrupt):
    """Ctrl-C was asked for and obeyed: the checkpoint is whole. `exit_code` is what the process should
    return.
    """

    def __init__(self, message: str, exit_code: int):
        super().__init__(message)
        self.exit_code = exit_code


class TrainingDiverged(RuntimeError):
    """A number in training was not finite; the message says which, where the dump lies and what may help."""


@dataclass(frozen=True)
class Training:
    """What to run, for `run_training`.

    Arguments:
        title: shown before the bar.
        initialise: () -> state; called once.
        iterate: pure (state) -> (state, metrics); its metrics finite_observation,
            finite_reward, finite_loss and finite_parameters, where given, are flags that the guard reads.
        iterations: how many to run in all.
        steps_per_iteration: policy steps of one, of all seeds together; where episodes end at different times
            the metric "steps" (steps so far) is used instead.
        policies: state -> {file name: Policy}, written into the run folder with each checkpoint.
        config: settings that a resumed run must share.
        may_differ: dotted names of settings that it need not share.
        names: labels of the entries of a flag, by flag name, for the message.
        shards: the processes that share the training; the leader alone writes.
    """

    title: str
    initialise: Callable[[], Any]
    iterate: Callable[[Any], tuple[Any, dict[str, jax.Array]]]
    iterations: int
    steps_per_iteration: int
    policies: Callable[[Any], dict[str, Policy]]
    config: Any
    may_differ: tuple[str, ...] = ()
    names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    shards: Alone = field(default_factory=Alone)


def run_training(
    training: Training,
    run: Path,
    resume: Path | None = None,
    checkpoint_every_s: float = 60.0,
    quiet: bool = False,
    tensorboard: bool = False,
) -> Any:
    """Run (or go on with) a training and return its last state.

    Arguments:
        training: what to run.
        run: run folder, made where missing.
        resume: a run folder or one of its checkpoints to go on from; None: start anew.
        checkpoint_every_s: least wall-clock time between checkpoints, s; the last state is always saved.
        quiet: no progress bar.
        tensorboard: write TensorBoard scalars too.

    Raises: TrainingInterrupted after Ctrl-C; TrainingDiverged when a number is not finite; ValueError when
        the checkpoint to resume from is not whole or has other settings; OSError when nothing can be written.
    """
    run = Path(run)
    run.mkdir(parents=True, exist_ok=True)
    state = training.initialise()
    done = 0
    shards = training.shards
    if resume is not None:
        found = checkpoint.find(resume)
        state = shards.spread(checkpoint.restore(found, state, training.config, training.may_differ))
        done = checkpoint.iteration_of(found)
        shards.wait("restored")
        if shards.leader:
            progress.rewind(run, done)
            checkpoint.drop_after(run, done)
        shards.wait("rewound")
        if not checkpoint.checkpoints(run):  # going on in another folder
            _save(training, run, done, state)
    iterate = _platform.jit(lambda s: _strip_weak_types(training.iterate(s)))
    state = _strip_weak_types(state)
    saved_at = time.monotonic()
    steps = done * training.steps_per_iteration
    quiet, tensorboard = quiet or not shards.leader, tensorboard and shards.leader
    reporter = progress.Reporter(run, training.title, training.iterations, done, quiet, tensorboard)
    with reporter, _interrupts() as stop:
        while done < training.iterations:
            after, metrics = iterate(state)
            _wait(metrics)
            metrics = {name: np.asarray(value) for name, value in metrics.items()}
            done += 1
            _guard(training, run, done, state, metrics)
            state = after
            shown = {k: v for k, v in metrics.items() if not k.startswith(GUARD)}
            before_steps, steps = steps, _steps(training, done, shown)
            if shards.leader:
                reporter.report(done, steps, steps - before_steps, shown)
            due = time.monotonic() - saved_at >= checkpoint_every_s
            stopped, due = shards.agree(stop.signal, due)
            if due or stopped or done == training.iterations:
                _save(training, run, done, state)
                saved_at = time.monotonic()
            if stopped and done < training.iterations:
                raise TrainingInterrupted(
                    f"stopped after iteration {done} of {training.iterations}; the checkpoint in {run} is "
                    f"whole; "
                    f"go on with --resume {run}",
                    128 + stopped,
                )
    return state


def _steps(training: Training, done: int, shown: dict[str, np.ndarray]) -> int:
    """Policy steps so far: the learner's own count where it keeps one."""
    return int(np.sum(shown.pop("steps"))) if "steps" in shown else done * training.steps_per_iteration


def _save(training: Training, run: Path, done: int, state: Any) -> None:
    shards = training.shards
    whole = shards.collect(state)
    if shards.leader:
        checkpoint.save(run, done, whole, training.config)
        for name, policy in training.policies(shards.first(whole)).items():
            policy.save(run / name)
    shards.wait("saved")


def _guard(training: Training, run: Path, done: int, before: Any, metrics: Mapping[str, np.ndarray]) -> None:
    # In the order in which a fault spreads; what is named first is its source.
    flags = [GUARD + name for name in ("observation", "reward", "loss", "parameters")]
    broken = [name for name in flags if not np.all(metrics.get(name, True))]
    if not broken:
        return
    first = broken[0].removeprefix(GUARD)
    fine: np.ndarray = np.atleast_1d(metrics[broken[0]])
    entries: np.ndarray = np.logical_not(np.all(fine.reshape(-1, fine.shape[-1]), axis=0))
    labels = training.names.get(broken[0], ())
    which = [labels[i] for i in np.flatnonzero(entries)] if len(labels) == len(entries) else []
    dump = run / "diverged"
    before = training.shards.collect(before)
    if training.shards.leader:
        checkpoint.save(dump, done - 1, before, training.config)
    found = checkpoint.checkpoints(run)
    last = f"the last whole checkpoint is {found[-1]}" if found else "there is no checkpoint before it"
    raise TrainingDiverged(
        f"got a value that is not finite in iteration {done}: first in the {first}"
        f"{' (' + ', '.join(which) + ')' if which else ''}; the state before that iteration is in {dump}; "
        f"{last}; "
        + (
            "look for a state of the simulation that it cannot integrate (too stiff, too deep a cut)"
            if first in ("observation", "reward")
            else "lower learning_rate or max_grad_norm"
        )
    )


def _wait(metrics: Mapping[str, Any]) -> None:
    """Wait in short naps: a blocking wait would keep Python from seeing the second Ctrl-C."""
    nap_s = 1e-4
    while not all(value.is_ready() for value in metrics.values()):
        time.sleep(nap_s)
        nap_s = min(2 * nap_s, 0.02)


def _strip_weak_types(tree: Any) -> Any:
    return jax.tree_util.tree_map(
        lambda x: (
            x
            if jax.numpy.issubdtype(x.dtype, jax.dtypes.prng_key)
            else jax.lax.convert_element_type(x, x.dtype)
        ),
        tree,
    )


class _Stop:
    signal = 0


@contextmanager
def _interrupts() -> Iterator[_Stop]:
    stop = _Stop()
    if threading.current_thread() is not threading.main_thread():
        yield stop  # only the main thread may handle signals
        return

    def handle(number: int, frame: FrameType | None) -> None:
        if stop.signal:
            raise KeyboardInterrupt("stopped at once; the last checkpoint is whole")
        stop.signal = number

    before = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
