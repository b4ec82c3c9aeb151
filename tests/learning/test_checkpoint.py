import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.learning import checkpoint

CONFIG = {"envs": 4, "nested": {"rate": 0.5}}


def make_state():
    return {
        "weights": jnp.arange(6.0).reshape(2, 3) / 7,
        "flag": jnp.asarray(True),
        "count": jnp.asarray(3, jnp.int32),
        "raw_key": jax.random.PRNGKey(5),
        "typed_key": jax.random.key(7),
        "nothing": jnp.zeros((0, 3)),
        "tuple": (jnp.float32(1e-40), {"a/b.c": jnp.asarray([np.inf, -0.0], jnp.float32)}),
    }


def equal(a, b):
    def data(x):
        return np.asarray(jax.random.key_data(x) if jnp.issubdtype(x.dtype, jax.dtypes.prng_key) else x)

    pairs = zip(jax.tree_util.tree_leaves(a), jax.tree_util.tree_leaves(b), strict=True)
    return all(data(x).tobytes() == data(y).tobytes() and x.dtype == y.dtype for x, y in pairs)


def test_every_leaf_comes_back_bit_for_bit(tmp_path):
    state = make_state()
    folder = checkpoint.save(tmp_path, 12, state, CONFIG)
    assert checkpoint.find(tmp_path) == folder
    assert checkpoint.find(folder) == folder
    assert checkpoint.iteration_of(folder) == 12
    again = checkpoint.restore(folder, jax.eval_shape(lambda: state), CONFIG)
    assert equal(state, again)
    assert jax.tree_util.tree_structure(state) == jax.tree_util.tree_structure(again)


def test_only_the_newest_are_kept(tmp_path):
    for i in range(5):
        checkpoint.save(tmp_path, i, make_state(), CONFIG, keep=2)
    assert [checkpoint.iteration_of(p) for p in checkpoint.checkpoints(tmp_path)] == [3, 4]
    assert [p.name for p in (tmp_path / checkpoint.FOLDER).iterdir() if p.name.startswith(".")] == []


def test_truncated_or_changed_file_offers_the_previous_checkpoint(tmp_path):
    first = checkpoint.save(tmp_path, 1, make_state(), CONFIG)
    second = checkpoint.save(tmp_path, 2, make_state(), CONFIG)
    victim = max((p for p in (second / "state").rglob("*") if p.is_file()), key=lambda p: p.stat().st_size)
    whole = victim.read_bytes()
    for damage in (whole[: len(whole) // 2], whole[:-1] + bytes([whole[-1] ^ 1]), None):
        victim.unlink() if damage is None else victim.write_bytes(damage)
        with pytest.raises(ValueError, match="not whole") as error:
            checkpoint.restore(second, make_state(), CONFIG)
        assert str(first) in str(error.value)
        assert victim.name in str(error.value)
    assert equal(make_state(), checkpoint.restore(first, make_state(), CONFIG))


def test_only_checkpoint_broken_says_there_is_no_other(tmp_path):
    only = checkpoint.save(tmp_path, 1, make_state(), CONFIG)
    (only / checkpoint.MANIFEST).write_text("{")
    with pytest.raises(ValueError, match="start a new run"):
        checkpoint.restore(only, make_state(), CONFIG)


def test_other_version_is_refused(tmp_path):
    folder = checkpoint.save(tmp_path, 1, make_state(), CONFIG)
    manifest = json.loads((folder / checkpoint.MANIFEST).read_text())
    (folder / checkpoint.MANIFEST).write_text(json.dumps({**manifest, "format": "mjx-cutting-checkpoint/9"}))
    with pytest.raises(
        ValueError, match=r"format 'mjx-cutting-checkpoint/9'; expected 'mjx-cutting-checkpoint/1'"
    ):
        checkpoint.restore(folder, make_state(), CONFIG)


def test_other_settings_are_refused_by_name(tmp_path):
    folder = checkpoint.save(tmp_path, 1, make_state(), CONFIG)
    other = {"envs": 4, "nested": {"rate": 0.25}}
    with pytest.raises(ValueError, match=r"nested.rate: 0.5 in the checkpoint, 0.25 now"):
        checkpoint.restore(folder, make_state(), other)
    assert equal(make_state(), checkpoint.restore(folder, make_state(), other, may_differ=("nested.rate",)))


def test_other_leaves_are_refused(tmp_path):
    folder = checkpoint.save(tmp_path, 1, make_state(), CONFIG)
    with pytest.raises(ValueError, match="do not fit this state"):
        checkpoint.restore(folder, {**make_state(), "weights": jnp.zeros((2, 4))}, CONFIG)
    with pytest.raises(ValueError, match="do not fit this state"):
        checkpoint.restore(folder, {**make_state(), "zzz": jnp.zeros(2)}, CONFIG)


def test_folder_without_checkpoint_is_refused(tmp_path):
    with pytest.raises(ValueError, match="holds no checkpoint"):
        checkpoint.find(tmp_path)


def test_failed_write_leaves_the_earlier_one_whole(tmp_path, monkeypatch):
    first = checkpoint.save(tmp_path, 1, make_state(), CONFIG)

    def full(*args, **kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(checkpoint._files, "write_atomic", full)
    with pytest.raises(OSError, match="No space left"):
        checkpoint.save(tmp_path, 2, make_state(), CONFIG)
    assert checkpoint.checkpoints(tmp_path) == [first]
    assert sorted(p.name for p in (tmp_path / checkpoint.FOLDER).iterdir()) == [first.name]
    assert equal(make_state(), checkpoint.restore(first, make_state(), CONFIG))
