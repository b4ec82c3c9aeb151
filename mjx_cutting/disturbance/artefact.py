"""The disturbance as one .npz file: arrays with their units in the names, and a JSON record beside them.

`meta` holds the format's name, axes, frame, diagnostics, warnings and provenance (data, model, versions). No
pickles: what is read is numbers and text. Written whole or not at all.
"""

from __future__ import annotations

import dataclasses
import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from mjx_cutting import _files
from mjx_cutting.disturbance.gp import DisturbanceGP

FORMAT = "mjx-cutting-disturbance/1"
_UNITS = {
    "frequency_hz": "Hz",
    "length": "1",
    "amplitude_n": "N",
    "trial_length": "1",
    "trial_amplitude_n": "N",
    "noise_std_n": "N",
    "common_std_n": "N, prior deviation of the common process, its constant bounded",
    "trial_std_n": "N, prior deviation of a trial's own process, its constant bounded",
    "weights_mean_n": "N, of [1, cos 2 pi j f t, sin 2 pi j f t], j = 1 .. J",
    "weights_factor_n": "N, C C' is the covariance of the common process's weights",
    "weights_trial_factor_n": "N, C C' is the covariance of a new trial's weights",
    "trial_means_n": "N, weights of each fitted trial",
    "scan_hz": "Hz",
    "scan_log_likelihood": "nats, pooled trials, axes scaled to unit spread",
    "slow_nodes_s": "s",
    "slow_length_s": "s, None where the shape does not drift",
    "start_s": "s",
    "span_s": "s",
    "sample_rate_hz": "Hz",
    "log_likelihood": "nats",
}
_ARRAYS = tuple(f.name for f in dataclasses.fields(DisturbanceGP) if str(f.type) == "Real")


def save(gp: DisturbanceGP, path: str | Path) -> Path:
    """Returns `path`, now holding the process; an older file is replaced in one step.

    Raises:
        ValueError: a name that does not end in .npz.
        OSError: it cannot be written; nothing is then left half written.
    """
    path = Path(path)
    if path.suffix != ".npz":
        raise ValueError(f"got {path.name}; expected a name that ends in .npz")
    record = {
        "format": FORMAT,
        "units": _UNITS,
        "frame": "process axes: x feed, y normal into the sheet, z tool axis; force on the tool",
    }
    for each in dataclasses.fields(gp):
        if each.name not in _ARRAYS:
            record[each.name] = plain(getattr(gp, each.name))
    buffer = io.BytesIO()
    arrays: dict[str, Any] = {name: np.asarray(getattr(gp, name), np.float64) for name in _ARRAYS}
    arrays["meta"] = np.asarray(json.dumps(record, allow_nan=False))
    np.savez_compressed(buffer, **arrays)
    return _files.write_atomic(path, buffer.getvalue())


def load(path: str | Path) -> DisturbanceGP:
    """Returns the process saved at `path`.

    Raises:
        FileNotFoundError: no such file.
        ValueError: not a file of this format, or one with a part missing.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: there is no such file; fit one with `mjx-cutting fit-gp DATASET`")
    try:
        with np.load(path, allow_pickle=False) as file:
            stored = {name: file[name] for name in file.files}
        meta = json.loads(str(stored.pop("meta")))
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(f"{path} is not a disturbance file ({error}); expected {FORMAT} in .npz") from error
    if not isinstance(meta, dict) or meta.get("format") != FORMAT:
        got = meta.get("format") if isinstance(meta, dict) else meta
        raise ValueError(f"{path} has format {got!r}; expected {FORMAT!r}. Fit it again with this version.")
    fields: dict[str, Any] = {}
    for each in dataclasses.fields(DisturbanceGP):
        source = stored if each.name in _ARRAYS else meta
        if each.name not in source:
            raise ValueError(f"{path} lacks {each.name!r}; the file is damaged: fit it again")
        fields[each.name] = source[each.name]
    fields["axes"], fields["warnings"] = tuple(fields["axes"]), tuple(fields["warnings"])
    return DisturbanceGP(**fields)


def plain(value: Any) -> Any:
    """Returns `value` as what JSON holds: arrays as lists, NumPy scalars as numbers, nan and inf as None."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    if isinstance(value, Path):
        return str(value)
    return value
