"""A file that is cut off, changed or foreign is refused with a message, never half understood."""

from __future__ import annotations

import dataclasses
import itertools
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from mjx_cutting.deploy.artefact import Artefact
from mjx_cutting.deploy.export import build
from mjx_cutting.learning.policy import Policy


@pytest.fixture
def written(policy: Policy, tmp_path: Path) -> Path:
    return build(policy, pairs=4).save(tmp_path / "policy.npz")


def members(path: Path) -> dict[str, np.ndarray]:
    with np.load(path, allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


def rewrite(path: Path, arrays: dict[str, np.ndarray]) -> Path:
    np.savez(path, **arrays)  # type: ignore[arg-type]
    return path


def test_what_is_saved_is_read_back(policy: Policy, tmp_path: Path) -> None:
    first = build(policy, pairs=4)
    second = Artefact.load(first.save(tmp_path / "policy.npz"))
    assert first.sha256 == second.sha256
    for field in dataclasses.fields(first):
        a, b = getattr(first, field.name), getattr(second, field.name)
        if field.name == "provenance":
            a = json.loads(json.dumps(a))
        if isinstance(a, np.ndarray):
            np.testing.assert_array_equal(a, b)
        elif field.name == "layers":
            for x, y in zip(itertools.chain(*a), itertools.chain(*b), strict=True):
                np.testing.assert_array_equal(x, y)
        else:
            assert a == b, field.name


def test_arrays_cannot_be_written_to(written: Path) -> None:
    read = Artefact.load(written)
    with pytest.raises(ValueError, match="read-only"):
        read.layers[0][0][0, 0] = 1.0


def test_no_pickle_inside(written: Path) -> None:
    assert all(array.dtype.kind in "fu" for array in members(written).values())


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.999])
def test_cut_off_file(written: Path, share: float) -> None:
    data = written.read_bytes()
    written.write_bytes(data[: int(share * len(data))])
    with pytest.raises(ValueError, match=r"cannot be read .* copy or export it again"):
        Artefact.load(written)


def test_flipped_bytes_are_refused_or_harmless(written: Path) -> None:
    expected, data = Artefact.load(written).sha256, written.read_bytes()
    draw = np.random.default_rng(0)
    refused = 0
    for position in draw.integers(0, len(data), 300):
        changed = bytearray(data)
        changed[position] ^= int(draw.integers(1, 256))
        written.write_bytes(bytes(changed))
        try:
            assert Artefact.load(written).sha256 == expected  # a byte that carries no content (a date, ...)
        except ValueError:
            refused += 1
    assert refused > 250


def test_random_bytes_are_refused(tmp_path: Path) -> None:
    draw = np.random.default_rng(1)
    for size in (0, 1, 100, 10_000):
        path = tmp_path / "policy.npz"
        path.write_bytes(draw.bytes(size))
        with pytest.raises(ValueError, match="cannot be read"):
            Artefact.load(path)


def test_changed_weight_is_noticed(written: Path) -> None:
    arrays = members(written)
    arrays["weights_0"] = arrays["weights_0"] + np.float32(1e-6)
    with pytest.raises(ValueError, match=r"SHA-256 .* was changed or damaged"):
        Artefact.load(rewrite(written, arrays))


def test_changed_limit_is_noticed(written: Path) -> None:
    arrays = members(written)
    header = json.loads(arrays["header"].tobytes())
    header["action_high"][4] = 0.02
    arrays["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
    with pytest.raises(ValueError, match="was changed or damaged"):
        Artefact.load(rewrite(written, arrays))


def test_added_member_is_noticed(written: Path) -> None:
    arrays = {**members(written), "extra": np.zeros(3, np.float32)}
    with pytest.raises(ValueError, match="was changed or damaged"):
        Artefact.load(rewrite(written, arrays))


def test_training_file_is_told_from_an_export(policy: Policy, tmp_path: Path) -> None:
    policy.save(tmp_path / "policy.npz")
    with pytest.raises(
        ValueError, match=r"trained-policy.*expected 'mjx-cutting-policy/1'.*mjx-cutting export"
    ):
        Artefact.load(tmp_path / "policy.npz")


def test_missing_file_and_folder(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"got no file at .* mjx-cutting export RUN"):
        Artefact.load(tmp_path / "none.npz")
    with pytest.raises(ValueError, match="got no file at"):
        Artefact.load(tmp_path)


def test_zip_bomb_is_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "policy.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("header.npy", b"\0" * (70 * 2**20))
    with pytest.raises(ValueError, match=r"unpacks to .* more than"):
        Artefact.load(tmp_path / "policy.npz")


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"std": np.zeros(15)}, "std above 0"),
        ({"observation_scales": (0.0,) * 15}, "observation_scales above 0"),
        ({"mean": np.zeros(14)}, r"mean of shape \(14,\); expected \(15,\)"),
        ({"clip": 0.0}, "clip above 0"),
        ({"activation": "gelu"}, "an activation of"),
        ({"action_low": (50.0, 50.0, 50.0, 2.0, 0.0)}, "action_low below action_high"),
        ({"action_log": (True, True, True, True, False)}, "above 0 where action_log"),
        ({"action_rate_per_s": (0.0,) * 5}, "action_rate_per_s above 0"),
        ({"action_initial": (1.0, 100.0, 100.0, 0.0, 0.0)}, "within the limits"),
        ({"policy_period_s": 0.0}, "policy_period_s above 0"),
        ({"golden_observation": np.zeros((0, 15)), "golden_action": np.zeros((0, 5))}, "at least one"),
        ({"observation_units": ("m",)}, "1 entries in observation_units; expected 15"),
        ({"layers": ()}, "no layers"),
        ({"layers": ((np.zeros((15, 4)), np.zeros(5)),)}, "layers of shapes"),
        ({"layers": ((np.full((15, 5), np.inf), np.zeros(5)),)}, "not finite"),
        ({"conventions": {}}, "explain the gains"),
    ],
)
def test_inconsistent_content(policy: Policy, change: dict[str, object], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        dataclasses.replace(build(policy, pairs=4), **change)  # type: ignore[arg-type]
