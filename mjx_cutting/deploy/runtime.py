"""Runs an exported policy with NumPy alone: one observation in, one action out, no allocation in the layers.

Importing this module loads no JAX (a serving process starts in a fraction of a second and some 40 MB). The
observation is scaled, normalised, clipped, passed through the network and a tanh; see artefact.py for the
equation. One runtime serves one thread: its buffers are reused by every call.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from mjx_cutting.deploy.artefact import Artefact

# isort: split
import numpy as np

TOLERANCE = 5e-5
"""Largest difference from the exporting program, as a fraction of each action's range."""


class PolicyRuntime:
    """A policy ready to run.

    Example:
        runtime = PolicyRuntime.load("policy.npz")
        action = runtime(observation)            # [action] in [-1, 1]
        target = runtime.set_point(action)       # [action], in the units that runtime.artefact names
    """

    def __init__(self, artefact: Artefact):
        self.artefact = artefact
        self._scale = np.asarray(artefact.observation_scales, np.float32)
        self._activate = _ACTIVATE[artefact.activation]
        self._input = np.zeros(artefact.observation_size, np.float32)
        self._buffers = tuple(np.zeros(bias.shape, np.float32) for _, bias in artefact.layers)
        low = np.asarray(artefact.action_low, np.float64)
        high = np.asarray(artefact.action_high, np.float64)
        self._log = np.asarray(artefact.action_log, bool)
        self._bottom = np.where(self._log, np.log(np.where(self._log, low, 1.0)), low)
        self._top = np.where(self._log, np.log(np.where(self._log, high, 1.0)), high)
        self._limits = low, high
        self._step = np.asarray(artefact.action_rate_per_s, np.float64) * artefact.policy_period_s

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> PolicyRuntime:
        """Returns the runtime of an exported policy.

        Raises:
            ValueError: the file is missing, cut off, changed, or of another format.
        """
        return cls(Artefact.load(path))

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Returns the action, float32 [action] in [-1, 1], in a new array.

        Args:
            observation: [observation], physical values in the artefact's order and units; any real dtype.

        Raises:
            ValueError: the shape is wrong or a value is not finite; nothing is returned to act on.
        """
        given = np.asarray(observation)
        if given.shape != self._input.shape or given.dtype.kind not in "fiu":
            raise ValueError(
                f"got an observation of shape {given.shape} and dtype {given.dtype}; expected real numbers "
                f"of "
                f"shape {self._input.shape}: {', '.join(self.artefact.observation_names)}"
            )
        if not np.isfinite(given).all():
            names = np.asarray(self.artefact.observation_names)[~np.isfinite(given)]
            raise ValueError(
                f"got a value that is not finite in {', '.join(names)}; expected finite ones; "
                "check the sensor, and hold or stop instead of acting"
            )
        x: np.ndarray = self._input
        with np.errstate(over="ignore"):  # beyond float32 it is infinite, and clipped
            np.copyto(x, given, casting="unsafe")
            np.divide(x, self._scale, out=x)
            np.subtract(x, self.artefact.mean, out=x)
            np.divide(x, self.artefact.std, out=x)
        np.clip(x, -self.artefact.clip, self.artefact.clip, out=x)
        for (weights, bias), out in zip(self.artefact.layers[:-1], self._buffers, strict=False):
            np.matmul(x, weights, out=out)
            np.add(out, bias, out=out)
            self._activate(out)
            x = out
        (weights, bias), out = self.artefact.layers[-1], self._buffers[-1]
        np.matmul(x, weights, out=out)
        np.add(out, bias, out=out)
        return np.tanh(out)

    def set_point(self, action: np.ndarray) -> np.ndarray:
        """Returns the set-point, float64 [action] in the action's units, within the limits.

        Args:
            action: [action] in [-1, 1]; what lies outside is clipped.
        """
        share = (np.clip(np.asarray(action, np.float64), -1.0, 1.0) + 1.0) / 2.0
        value = self._bottom + share * (self._top - self._bottom)
        return np.clip(np.where(self._log, np.exp(np.where(self._log, value, 0.0)), value), *self._limits)

    def advance(self, set_point: np.ndarray, action: np.ndarray) -> np.ndarray:
        """Returns the set-point one policy period later: moved towards the action's at the limited rate.

        Args:
            set_point: [action], the present one, in the action's units; `artefact.action_initial` at first.
            action: [action] in [-1, 1].
        """
        now, target = (
            self._to_scale(np.asarray(set_point, np.float64)),
            self._to_scale(self.set_point(action)),
        )
        moved = now + np.clip(target - now, -self._step, self._step)
        return np.clip(np.where(self._log, np.exp(np.where(self._log, moved, 0.0)), moved), *self._limits)

    def _to_scale(self, set_point: np.ndarray) -> np.ndarray:
        return np.where(self._log, np.log(np.where(self._log, set_point, 1.0)), set_point)


@dataclass(frozen=True)
class Verification:
    """What replaying the golden pairs gave.

    Arguments:
        pairs: golden pairs replayed.
        worst: largest difference of any action, as a fraction of its range.
        sha256: the content's hash, in hexadecimal.
        passed: whether the worst is within `TOLERANCE`.
    """

    pairs: int
    worst: float
    sha256: str
    passed: bool


def verify(path: str | os.PathLike[str]) -> Verification:
    """Returns how far this machine's actions lie from the golden ones in the file.

    Raises:
        ValueError: the file is missing, cut off, changed, or of another format.
    """
    runtime = PolicyRuntime.load(path)
    artefact = runtime.artefact
    actions = np.stack([runtime(observation) for observation in artefact.golden_observation])
    worst = float(np.max(np.abs(actions - artefact.golden_action))) / 2.0
    return Verification(len(actions), worst, artefact.sha256, worst <= TOLERANCE)


def save_verified(artefact: Artefact, path: str | os.PathLike[str]) -> Path:
    """Returns `path`, written atomically once the golden pairs were reproduced from the written file.

    Raises:
        ValueError: they are not reproduced; nothing is written.
        OSError: the file cannot be written.
    """
    path = Path(path)
    staged = path.with_name(f".{path.name}.unverified")
    try:
        artefact.save(staged)
        result = verify(staged)
        if not result.passed:
            raise ValueError(
                f"got actions that differ from the golden ones by {result.worst:.2g} of their range; "
                f"expected at most {TOLERANCE:g}; nothing was written: check the weights' magnitude"
            )
        staged.replace(path)
    except OSError as error:
        raise type(error)(error.errno, error.strerror, str(path)) from error
    finally:
        if staged.exists():
            staged.unlink()
    return path


def _tanh(x: np.ndarray) -> None:
    np.tanh(x, out=x)


def _relu(x: np.ndarray) -> None:
    np.maximum(x, 0.0, out=x)


def _swish(x: np.ndarray) -> None:
    # x sigmoid(x) = x/2 (1 + tanh(x/2)): no overflow where exp(-x) has one
    np.multiply(x, 0.5, out=x)
    np.add(x, x * np.tanh(x), out=x)


def _elu(x: np.ndarray) -> None:
    np.expm1(x, out=x, where=x < 0)


_ACTIVATE: dict[str, Callable[[np.ndarray], None]] = {
    "tanh": _tanh,
    "relu": _relu,
    "swish": _swish,
    "elu": _elu,
}
