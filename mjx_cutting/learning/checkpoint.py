"""The whole training state on disk: exact, whole or absent, and checked when it is read.

    RUN/checkpoints/00000120/manifest.json   format, iteration, settings, leaves, SHA-256 of every file
    RUN/checkpoints/00000120/state/          the arrays, written by orbax
    RUN/policy.npz                           the policy of the newest checkpoint, in plain arrays

Every leaf of the state (parameters, optimiser, normaliser, environment, random key, counters) is stored,
so a run that goes on from a checkpoint computes the same bits as one that never stopped, on the same
machine, versions and number of threads. A checkpoint is staged beside its place and renamed when it is
complete. It breaks when the state gets other leaves or the settings change; both are refused with the
difference named.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import orbax.checkpoint as ocp

from mjx_cutting import _files, _platform, runs
from mjx_cutting.learning import policy as policies

FORMAT = "mjx-cutting-checkpoint/1"
FOLDER = "checkpoints"
MANIFEST = "manifest.json"


def save(run: Path, iteration: int, state: Any, config: Any, keep: int = 2) -> Path:
    """Write the state after `iteration` iterations and return its folder; the older ones beyond `keep` go.

    Arguments:
        run: run folder.
        iteration: iterations done.
        state: pytree of arrays (random keys may be typed).
        config: settings that a resumed run must share; a dataclass or a mapping of JSON-like values.
        keep: whole checkpoints to leave, at least 1.

    Raises: OSError when it cannot be written; the earlier checkpoints are then untouched.
    """
    target = Path(run) / FOLDER / f"{iteration:08d}"
    _discard(target)
    write_state(target, iteration, state, config)
    for old in checkpoints(run)[:-keep]:
        _discard(old)
    return target


def write_state(target: Path, iteration: int, state: Any, config: Any) -> None:
    """Write one state with its manifest as the folder `target`, atomically."""
    leaves = _leaves(state)
    with _files.staged_folder(target) as staged:
        with _orbax() as orbax:
            # orbax refuses arrays of size zero; the template restores them.
            orbax.save(staged.resolve() / "state", {k: v for k, v in leaves.items() if v.size})
        files = sorted(p for p in (staged / "state").rglob("*") if p.is_file())
        manifest = {
            "format": FORMAT,
            "iteration": int(iteration),
            "config": runs.plain(config),
            "versions": _platform.versions(),
            "leaves": {k: {"shape": list(v.shape), "dtype": str(v.dtype)} for k, v in leaves.items()},
            "sha256": {str(p.relative_to(staged)): _digest(p) for p in files},
        }
        _files.write_atomic(staged / MANIFEST, json.dumps(manifest, indent=1))


def checkpoints(run: Path) -> list[Path]:
    """Return the folders of a run's checkpoints, oldest first."""
    folder = Path(run) / FOLDER
    found = folder.iterdir() if folder.is_dir() else ()
    return sorted(p for p in found if p.name.isdigit() and (p / MANIFEST).is_file())


def drop_after(run: Path, iteration: int) -> None:
    """Remove a run's checkpoints beyond an iteration, which a run resumed from there will write again."""
    for folder in checkpoints(run):
        if int(folder.name) > iteration:
            _discard(folder)


def find(path: Path) -> Path:
    """Return the checkpoint that `path` names: a checkpoint folder itself, or the newest of a run folder.

    Raises: ValueError when there is none.
    """
    path = Path(path)
    if (path / MANIFEST).is_file():
        return path
    found = checkpoints(path)
    if not found:
        raise ValueError(
            f"got {path}, which holds no checkpoint; expected a run folder with {FOLDER}/, or one "
            f"checkpoint in it; "
            "give the folder that `mjx-cutting train --out` named"
        )
    return found[-1]


def iteration_of(checkpoint: Path) -> int:
    """Return how many iterations a checkpoint has behind it."""
    return int(_manifest(checkpoint)["iteration"])


def restore(checkpoint: Path, template: Any, config: Any, may_differ: tuple[str, ...] = ()) -> Any:
    """Return the state in a checkpoint.

    Arguments:
        checkpoint: folder of one checkpoint (`find`).
        template: a state, or `jax.eval_shape` of one, of the same structure.
        config: settings of the run that goes on.
        may_differ: dotted names of settings that need not agree.

    Raises: ValueError when a file is cut off or changed, the version is another, the settings differ, or the
        leaves do not fit; the message names the previous checkpoint where there is one.
    """
    checkpoint = Path(checkpoint)
    manifest = _manifest(checkpoint)
    _compare(checkpoint, manifest["config"], runs.plain(config), may_differ)
    _verify(checkpoint, manifest)
    expected, structure = jax.tree_util.tree_flatten(template)
    named = manifest["leaves"]
    shapes = [(list(_data_shape(x)), str(_data_dtype(x))) for x in expected]
    stored = [(leaf["shape"], leaf["dtype"]) for leaf in named.values()]
    if shapes != stored:
        different = [name for name, a, b in zip(named, stored, shapes, strict=False) if a != b]
        raise ValueError(
            f"got a checkpoint {checkpoint} with {len(stored)} arrays that do not fit this state of "
            f"{len(shapes)} "
            f"(first: {(different or ['the number of arrays'])[0]}); expected the same network and "
            f"environment; "
            "resume with the settings and the version of mjx-cutting that wrote it"
        )
    wanted = {
        name: ocp.RestoreArgs(restore_type=np.ndarray)
        for name, leaf in named.items()
        if 0 not in leaf["shape"]
    }
    try:
        with _orbax() as orbax:
            arrays = orbax.restore(checkpoint.resolve() / "state", restore_args=wanted)
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise ValueError(_broken(checkpoint, f"orbax cannot read it: {error}")) from error
    leaves = [
        _as_leaf(arrays[name] if name in arrays else np.zeros(leaf["shape"], leaf["dtype"]), like)
        for (name, leaf), like in zip(named.items(), expected, strict=True)
    ]
    return jax.tree_util.tree_unflatten(structure, leaves)


def load_policy(run: Path) -> policies.Policy:
    """Return the policy of a run folder (of its newest checkpoint), or of a policy file.

    Raises: ValueError when there is none or it is not whole.
    """
    path = Path(run)
    return policies.Policy.load(path / policies.FILE if path.is_dir() else path)


def _orbax() -> ocp.Checkpointer:
    """Reads and writes by this process alone: of several, orbax would wait for all at each."""
    own = ocp.options.MultiprocessingOptions()
    if jax.process_count() > 1:
        index = jax.process_index()
        own = ocp.options.MultiprocessingOptions(
            primary_host=index, active_processes={index}, barrier_sync_key_prefix=f"process{index}"
        )
    handler = ocp.PyTreeCheckpointHandler(multiprocessing_options=own)
    return ocp.Checkpointer(handler, multiprocessing_options=own)


def _leaves(state: Any) -> dict[str, np.ndarray]:
    flat, _ = jax.tree_util.tree_flatten_with_path(state)
    # orbax makes folders of "/" and reads "." apart, so a name keeps letters, digits and "_" only.
    leaves = {}
    for i, (path, leaf) in enumerate(flat):
        words = "".join(c if c.isalnum() else "_" for c in jax.tree_util.keystr(path)).strip("_")
        leaves[f"{i:04d}_{words}"] = np.asarray(jax.random.key_data(leaf) if _is_key(leaf) else leaf)
    return leaves


def _is_key(leaf: Any) -> bool:
    return jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key) if hasattr(leaf, "dtype") else False


def _key_template(leaf: Any) -> Any:
    return jax.eval_shape(jax.random.key_data, leaf)


def _data_shape(leaf: Any) -> tuple[int, ...]:
    return _key_template(leaf).shape if _is_key(leaf) else jnp.shape(leaf)


def _data_dtype(leaf: Any) -> Any:
    return _key_template(leaf).dtype if _is_key(leaf) else jnp.result_type(leaf)


def _as_leaf(array: np.ndarray, like: Any) -> Any:
    if _is_key(like):  # without a concrete key to ask, the default implementation
        impl = jax.random.key_impl(like) if isinstance(like, jax.Array) else None
        return jax.random.wrap_key_data(jnp.asarray(array), impl=impl)
    return jnp.asarray(array)


def _manifest(checkpoint: Path) -> dict[str, Any]:
    try:
        manifest = json.loads((Path(checkpoint) / MANIFEST).read_text())
    except (OSError, ValueError) as error:
        raise ValueError(_broken(checkpoint, f"its {MANIFEST} cannot be read: {error}")) from error
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        got = manifest.get("format") if isinstance(manifest, dict) else type(manifest).__name__
        raise ValueError(
            f"got a checkpoint {checkpoint} of format {got!r}; expected {FORMAT!r}; "
            "resume with the version of mjx-cutting that wrote it, or start a new run"
        )
    return manifest


def _verify(checkpoint: Path, manifest: Mapping[str, Any]) -> None:
    for name, digest in manifest["sha256"].items():
        path = checkpoint / name
        if not path.is_file():
            raise ValueError(_broken(checkpoint, f"{name} is missing"))
        if _digest(path) != digest:
            raise ValueError(_broken(checkpoint, f"{name} is cut off or was changed"))


def _broken(checkpoint: Path, reason: str) -> str:
    earlier = [p for p in checkpoints(checkpoint.parent.parent) if p.name < checkpoint.name]
    mend = f"resume from the one before it: {earlier[-1]}" if earlier else "start a new run"
    return f"got a checkpoint {checkpoint} that is not whole ({reason}); expected all its files; {mend}"


def _compare(checkpoint: Path, stored: Any, given: Any, may_differ: tuple[str, ...]) -> None:
    a, b = _flat(stored), _flat(given)
    different = [
        f"{name}: {a.get(name, 'absent')} in the checkpoint, {b.get(name, 'absent')} now"
        for name in sorted(a.keys() | b.keys())
        if name not in may_differ and a.get(name, "absent") != b.get(name, "absent")
    ]
    if different:
        raise ValueError(
            f"got other settings than those of {checkpoint} ({'; '.join(different)}); expected the same, so "
            f"that "
            "the run goes on as if it had never stopped; resume with the run's config.json, or start a new "
            "run"
        )


def _flat(value: Any, name: str = "") -> dict[str, Any]:
    if isinstance(value, Mapping):
        parts = (_flat(v, f"{name}.{k}" if name else str(k)) for k, v in value.items())
        return {k: v for part in parts for k, v in part.items()}
    return {name: value}


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _discard(checkpoint: Path) -> None:
    # The manifest goes first: what is left of an interrupted removal is no longer listed as a checkpoint.
    with contextlib.suppress(FileNotFoundError):
        (checkpoint / MANIFEST).unlink()
    shutil.rmtree(checkpoint, ignore_errors=True)
