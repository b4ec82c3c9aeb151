"""Keep the last states of a run, and write them down when an environment is no longer finite.

The environment masks what is not finite and counts it (`metrics["nan"]`), so training goes on; to find the
cause one needs the states before. `RollingDump` is called after each step outside jit, and keeps the states
and actions of the last steps on the host, for the environments that broke.
"""

from __future__ import annotations

import io
from collections import deque
from pathlib import Path
from typing import Any

import jax
import numpy as np

from mjx_cutting._files import write_atomic
from mjx_cutting.sim.env import EnvState


class RollingDump:
    """A rolling buffer of states and actions.

    Arguments:
        folder: where a dump is written, as nan-<count>.npz.
        keep: steps kept.
        most: dumps written at most.

    Raises:
        ValueError: `keep` or `most` below 1.
    """

    def __init__(self, folder: str | Path, keep: int = 16, most: int = 5):
        if keep < 1 or most < 1:
            raise ValueError(f"keep is {keep} and most {most}; expected at least 1")
        self.folder, self.most, self.written = Path(folder), most, 0
        self._steps: deque[tuple[Any, Any]] = deque(maxlen=keep)

    def __call__(self, state: EnvState, action: Any) -> Path | None:
        """Take note of the state [B] that `action` [B, 5] led to; path of the dump when one was written."""
        broken = np.flatnonzero(np.asarray(state.metrics["nan"]) > 0.0)
        path = None
        if len(broken) and self._steps and self.written < self.most:
            path = self._write(broken, np.asarray(action))
        self._steps.append((jax.device_get(_arrays(state)), np.asarray(action)))
        return path

    def _write(self, broken: np.ndarray, action: np.ndarray) -> Path:
        content: dict[str, np.ndarray] = {"environments": broken, "last_action": action[broken]}
        names = self._steps[0][0].keys()
        for name in names:
            content[name] = np.stack([arrays[name][broken] for arrays, _ in self._steps])
        content["action"] = np.stack([given[broken] for _, given in self._steps])
        buffer = io.BytesIO()
        np.savez(buffer, **content)  # type: ignore[arg-type]
        self.folder.mkdir(parents=True, exist_ok=True)
        path = self.folder / f"nan-{self.written}.npz"
        write_atomic(path, buffer.getvalue())
        self.written += 1
        return path


def _arrays(state: EnvState) -> dict[str, Any]:
    """Arrays of a state by name, keys of random numbers as their data."""
    leaves, _ = jax.tree_util.tree_flatten_with_path((state.pipeline_state, state.obs))
    named = {}
    for path, leaf in leaves:
        if jax.numpy.issubdtype(leaf.dtype, jax.dtypes.prng_key):
            leaf = jax.random.key_data(leaf)
        named[jax.tree_util.keystr(path).strip(".[]'").replace("/", "_")] = leaf
    return named
