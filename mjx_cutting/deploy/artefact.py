"""The exported policy: one .npz without pickle that says everything needed to run it (mjx-cutting-policy/1).

What the file computes, for an observation o in the order and the physical units that it names:

    x = min(max((o / scale - mean) / std, -clip), clip)
    a = tanh(W_L phi(... phi(W_1 x + b_1) ...) + b_L)                      in [-1, 1]
    u = low + (a + 1) / 2 (high - low),   or the same in ln u where `action_log`       the set-point

and the receiver moves its set-point towards u by at most rate x dt (of ln u where `action_log`). Members of
the archive: `header` (UTF-8 JSON as bytes), `observation_mean`, `observation_std`, `weights_i` [in, out] and
`bias_i` [out], and golden pairs `golden_observation` [pair, observation], physical, and `golden_action`
[pair, action], which the exporting program computed and `verify` replays. The
header's `sha256` is over everything else in the file, so a changed byte is found; it is no signature, and
does not show who wrote the file.
"""

from __future__ import annotations

import dataclasses
import hashlib
import io
import itertools
import json
import os
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mjx_cutting import _platform  # noqa: F401 (first: asks for one BLAS thread before NumPy is loaded)

# isort: split
import numpy as np

from mjx_cutting._files import write_atomic

FORMAT = "mjx-cutting-policy/1"
ACTIVATIONS = ("tanh", "swish", "relu", "elu")
BYTES_AT_MOST = 64 * 2**20

CONVENTIONS = {
    "gains": "Position gains K_p, s^-2, one for each base axis, of tau = J^T Lambda (K_p e + K_d de) + bias "
    "with the operational-space inertia Lambda and K_d = 2 sqrt(K_p): per unit of mass, not N/m.",
    "actions": "An action in [-1, 1] maps onto [action_low, action_high], in the logarithm where action_log; "
    "the receiver moves its set-point there by at most action_rate_per_s times the time passed.",
}

_UNREADABLE = (
    OSError, EOFError, KeyError, ValueError, TypeError, SyntaxError, MemoryError, OverflowError,
    NotImplementedError, RuntimeError, struct.error, tokenize.TokenError, zipfile.BadZipFile, zlib.error,
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Artefact:
    """An exported policy in memory; its arrays cannot be written to.

    Arguments:
        mean, std: float32 [observation], normaliser of the scaled observation; std above 0.
        clip: largest magnitude of a normalised observation; what lies beyond is clipped, as in training.
        layers: float32 (weights [in, out], bias [out]) of each layer.
        activation: "tanh", "swish", "relu" or "elu", after every layer but the last, which has tanh.
        observation_names, observation_units: order, and units of the physical values.
        observation_scales: what a physical value is divided by first, above 0.
        action_names, action_units: the set-points and their units.
        action_low, action_high: set-point at action -1 and at +1.
        action_rate_per_s: largest change of the set-point in a second (of its natural logarithm for a log
            action); infinite where unlimited.
        action_log: true where the set-point is interpolated in the logarithm.
        action_initial: set-point at the start.
        policy_period_s: time between two actions, s.
        conventions: what the numbers mean beyond their units: at least "gains".
        provenance: where the policy came from.
        golden_observation, golden_action: float32 [pair, observation], physical, and [pair, action].

    Raises:
        ValueError: sizes do not fit together, or a value is out of its range.
    """

    mean: np.ndarray
    std: np.ndarray
    clip: float
    layers: tuple[tuple[np.ndarray, np.ndarray], ...]
    activation: str
    observation_names: tuple[str, ...]
    observation_units: tuple[str, ...]
    observation_scales: tuple[float, ...]
    action_names: tuple[str, ...]
    action_units: tuple[str, ...]
    action_low: tuple[float, ...]
    action_high: tuple[float, ...]
    action_rate_per_s: tuple[float, ...]
    action_log: tuple[bool, ...]
    action_initial: tuple[float, ...]
    policy_period_s: float
    golden_observation: np.ndarray
    golden_action: np.ndarray
    conventions: Mapping[str, str] = field(default_factory=lambda: dict(CONVENTIONS))
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("mean", "std", "golden_observation", "golden_action"):
            object.__setattr__(self, name, _frozen(getattr(self, name)))
        object.__setattr__(self, "layers", tuple((_frozen(w), _frozen(b)) for w, b in self.layers))
        _check(self)

    @property
    def observation_size(self) -> int:
        """Entries of an observation."""
        return len(self.observation_names)

    @property
    def action_size(self) -> int:
        """Entries of an action."""
        return len(self.action_names)

    @property
    def sha256(self) -> str:
        """The hash, in hexadecimal, over all content."""
        return _digest(self.header(), self._arrays())

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Returns `path`, written atomically; the same artefact gives the same bytes.

        Raises:
            OSError: it cannot be written.
        """
        header, arrays = self.header(), self._arrays()
        header["sha256"] = _digest(header, arrays)
        buffer = io.BytesIO()
        np.savez(buffer, header=np.frombuffer(_canonical(header), np.uint8), **arrays)  # type: ignore[arg-type]
        return write_atomic(path, buffer.getvalue())

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Artefact:
        """Returns the artefact in a file.

        Raises:
            ValueError: there is no such file, or it is cut off, changed, of another format or inconsistent.
        """
        return _read(Path(path))

    def header(self) -> dict[str, Any]:
        """Returns all that is not an array, as JSON types; without the hash."""
        header: dict[str, Any] = {"format": FORMAT, "layers": len(self.layers)}
        for f in dataclasses.fields(self):
            value = getattr(self, f.name)
            if f.name != "layers" and not isinstance(value, np.ndarray):
                header[f.name] = dict(value) if isinstance(value, Mapping) else value
        header["action_rate_per_s"] = [r if np.isfinite(r) else None for r in self.action_rate_per_s]
        return header

    def _arrays(self) -> dict[str, np.ndarray]:
        arrays = {
            "observation_mean": self.mean,
            "observation_std": self.std,
            "golden_observation": self.golden_observation,
            "golden_action": self.golden_action,
        }
        for i, (weights, bias) in enumerate(self.layers):
            arrays[f"weights_{i}"], arrays[f"bias_{i}"] = weights, bias
        return arrays


def _read(path: Path) -> Artefact:
    if not path.is_file():
        raise ValueError(
            f"got no file at {path}; expected an exported policy ({FORMAT}); "
            "write one: mjx-cutting export RUN --out policy.npz"
        )
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size > BYTES_AT_MOST:
            raise ValueError(f"it unpacks to {size} bytes, more than {BYTES_AT_MOST}")
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        raw = arrays.pop("header")
        header = json.loads(raw.tobytes() if raw.dtype == np.uint8 else str(raw))
        found = header.get("format")
    except _UNREADABLE as error:
        raise ValueError(
            f"got a file {path} that cannot be read ({type(error).__name__}: {error}); expected a whole npz "
            f"file of format {FORMAT}; copy or export it again"
        ) from error
    except AttributeError as error:  # JSON, but not an object
        raise ValueError(
            f"got a header in {path} that is no object; expected {FORMAT}; export again"
        ) from error
    if found != FORMAT:
        raise ValueError(
            f"got format {found!r} in {path}; expected {FORMAT!r}; export the run folder that it belongs to: "
            "mjx-cutting export RUN --out policy.npz"
        )
    told = header.pop("sha256", None)
    try:
        actual = _digest(header, arrays)
    except (TypeError, ValueError) as error:
        raise ValueError(f"got content in {path} that cannot be hashed ({error}); export again") from error
    if told != actual:
        raise ValueError(
            f"got content in {path} with SHA-256 {actual}; expected {told}, which the file says of itself: "
            f"it "
            "was changed or damaged; copy or export it again"
        )
    return _assemble(header, arrays, path)


def _assemble(header: dict[str, Any], arrays: dict[str, Any], path: Path) -> Artefact:
    try:
        header.pop("format")
        count = header.pop("layers")
        rates = tuple(np.inf if r is None else r for r in header.pop("action_rate_per_s"))
        fields: dict[str, Any] = {name: tuple(v) if isinstance(v, list) else v for name, v in header.items()}
        return Artefact(
            mean=arrays.pop("observation_mean"),
            std=arrays.pop("observation_std"),
            layers=tuple((arrays.pop(f"weights_{i}"), arrays.pop(f"bias_{i}")) for i in range(count)),
            action_rate_per_s=rates,
            **arrays,
            **fields,
        )
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path} is whole but not a policy of format {FORMAT}: {error}") from error


def _check(a: Artefact) -> None:
    o, n = a.observation_size, a.action_size
    for prefix, size in (("observation", o), ("action", n)):
        for f in dataclasses.fields(a):
            if f.name.startswith(prefix + "_") and len(getattr(a, f.name)) != size:
                raise ValueError(
                    f"got {len(getattr(a, f.name))} entries in {f.name}; expected {size}, as many as names"
                )
    pairs = len(a.golden_action)
    expected = {
        "mean": (o,), "std": (o,),
        "golden_observation": (pairs, o), "golden_action": (pairs, n),
    }  # fmt: skip
    for name, shape in expected.items():
        if getattr(a, name).shape != shape:
            raise ValueError(f"got {name} of shape {getattr(a, name).shape}; expected {shape}")
    if not a.layers:
        raise ValueError("got no layers; expected at least one")
    widths = [o, *(b.shape[0] for _, b in a.layers[:-1] if b.ndim == 1), n]
    shapes = [(w.shape, b.shape) for w, b in a.layers]
    wanted = [((i, k), (k,)) for i, k in itertools.pairwise(widths)]
    if shapes != wanted:
        raise ValueError(f"got layers of shapes {shapes}; expected {wanted}")
    numbers = [a.mean, a.std, a.golden_observation, a.golden_action, *itertools.chain(*a.layers)]
    if not all(np.isfinite(x).all() for x in numbers):
        raise ValueError("got a weight, normaliser or golden value that is not finite; expected finite ones")
    rules = {
        "observation std above 0": bool(np.all(a.std > 0)),
        "observation_scales above 0": all(0 < x < np.inf for x in a.observation_scales),
        "clip above 0": 0 < a.clip < np.inf,
        f"an activation of {ACTIVATIONS}": a.activation in ACTIVATIONS,
        "action_low below action_high": all(x < y for x, y in zip(a.action_low, a.action_high, strict=True)),
        "action_low above 0 where action_log": all(
            x > 0 for x, log in zip(a.action_low, a.action_log, strict=True) if log
        ),
        "action_rate_per_s above 0": all(x > 0 for x in a.action_rate_per_s),
        "action_initial within the limits": all(
            x - 1e-6 * (z - x) <= y <= z + 1e-6 * (z - x)
            for x, y, z in zip(a.action_low, a.action_initial, a.action_high, strict=True)
        ),
        "policy_period_s above 0": a.policy_period_s > 0,
        "golden pairs, at least one": pairs > 0,
        "conventions that explain the gains": "gains" in a.conventions,
    }
    broken = [rule for rule, kept in rules.items() if not kept]
    if broken:
        raise ValueError(f"got a policy that breaks these rules: {'; '.join(broken)}; expected all to hold")


def _frozen(array: Any) -> np.ndarray:
    copy = np.array(array, dtype=np.float32, order="C")
    copy.flags.writeable = False
    return copy


def _canonical(header: Mapping[str, Any]) -> bytes:
    return json.dumps(header, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()


def _digest(header: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> str:
    digest = hashlib.sha256(_canonical(header))
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"\n{name}|{array.dtype.str}|{array.shape}|".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()
