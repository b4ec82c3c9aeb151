"""The rolling dump holds the states before the break, for the environments that broke."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.sim.guard import RollingDump

BATCH = 16


def test_it_writes_the_states_before_the_break(step, state, tmp_path):
    dump = RollingDump(tmp_path / "nan", keep=3)
    action = jnp.zeros((BATCH, 5))
    positions = []
    for _ in range(4):
        state = step(state, action)
        positions.append(np.asarray(state.pipeline_state.q))
        assert dump(state, action) is None
    broken = positions[-1].copy()
    broken[[2, 7]] = np.nan
    state = step(state.replace(pipeline_state=state.pipeline_state._replace(q=jnp.asarray(broken))), action)
    path = dump(state, action)
    assert path == tmp_path / "nan" / "nan-0.npz"
    with np.load(path) as content:
        np.testing.assert_array_equal(content["environments"], [2, 7])
        q = next(content[name] for name in content.files if name.endswith(".q"))
        np.testing.assert_array_equal(q, np.stack(positions[-3:])[:, [2, 7]])
        assert content["action"].shape == (3, 2, 5)


def test_it_stops_after_enough_dumps(step, state, tmp_path):
    dump = RollingDump(tmp_path, keep=1, most=1)
    action = jnp.zeros((BATCH, 5))
    poisoned = state.replace(pipeline_state=jax.tree.map(lambda x: x, state.pipeline_state))
    bad = np.asarray(state.pipeline_state.q) * np.nan
    poisoned = poisoned.replace(pipeline_state=state.pipeline_state._replace(q=jnp.asarray(bad)))
    after = step(poisoned, action)
    assert dump(after, action) is None  # nothing kept yet
    assert dump(after, action) is not None
    assert dump(after, action) is None
    assert len(list(tmp_path.iterdir())) == 1


def test_bad_sizes_are_refused(tmp_path):
    with pytest.raises(ValueError, match="at least 1"):
        RollingDump(tmp_path, keep=0)
