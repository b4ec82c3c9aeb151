"""Pictures and videos are made off-screen and show what they should."""

from __future__ import annotations

import numpy as np
import pytest

from mjx_cutting.sim import CuttingEnv, EnvConfig, render, scene
from mjx_cutting.sim.baseline import BaselinePolicy
from mjx_cutting.sim.traces import draw_traces

CONFIG = EnvConfig(approach_m=0.002, cut_m=0.02, materials=("foam",), depth_rate_m_s=0.02)


@pytest.fixture(scope="module")
def env():
    return CuttingEnv(CONFIG)


@pytest.fixture(scope="module")
def shots(env):
    return [shot for shot, _ in render.play(env, BaselinePolicy(CONFIG), every=2, limit=60)]


def test_a_still_shows_robot_sheet_and_traces(env, tmp_path):
    from PIL import Image

    path = render.render_still(env, BaselinePolicy(CONFIG), tmp_path / "still.png", at_s=1.0, size=(320, 240))
    picture = np.asarray(Image.open(path))
    assert picture.shape == (440, 320, 3)
    orange = (picture[:240, :, 0] > 180) & (picture[:240, :, 2] < 90)
    assert orange.sum() > 100  # the joints
    assert picture[240:].std() > 5.0
    assert list(tmp_path.iterdir()) == [path]


def test_the_kerf_grows_in_the_picture(env, shots):
    with scene.Scene(env, "foam", 320, 240, "cut") as drawn:
        first, last = drawn.draw(shots[2]), drawn.draw(shots[-1])
    assert np.abs(first.astype(int) - last.astype(int)).max() > 60
    runs = list(scene._runs(shots[-1].heights, env.plant.workpiece.material, 0.02))
    assert sum(last - first for first, last, _ in runs) == env.plant.workpiece.material.sum()
    levels = [tall for _, _, tall in runs]
    assert min(levels) < -0.0003 and max(levels) == pytest.approx(0.0)


@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
def test_a_video_is_written_whole(env, tmp_path, suffix):
    path = tmp_path / f"cut{suffix}"
    seen = []
    render.render_video(env, BaselinePolicy(CONFIG), path, size=(320, 120), every=20, say=seen.append)
    assert path.stat().st_size > 2000 and list(tmp_path.iterdir()) == [path]
    assert seen[0] == 0.0 and seen == sorted(seen)


def test_unknown_suffix_and_camera_are_refused(env, tmp_path):
    with pytest.raises(ValueError, match="name that ends in"):
        render.render_video(env, BaselinePolicy(CONFIG), tmp_path / "cut.avi")
    with pytest.raises(ValueError, match="at least 320 wide"):
        render.render_video(env, BaselinePolicy(CONFIG), tmp_path / "cut.mp4", size=(160, 120))
    with pytest.raises(ValueError, match="expected one of overview, cut"):
        scene.Scene(env, "foam", 64, 64, "side")


def test_a_machine_that_cannot_draw_is_told_so_at_every_attempt(env, monkeypatch):
    for name in ("MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    for _ in range(2):
        with pytest.raises(RuntimeError, match="neither EGL nor OSMesa is installed"):
            scene.Scene(env)


def test_traces_of_any_length(shots):
    for count in (1, 2, len(shots)):
        times = np.asarray([shot.time_s for shot in shots[:count]])
        values = np.asarray([shot.values for shot in shots[:count]])
        strip = draw_traces(times, values, 640, 180)
        assert strip.shape == (180, 640, 3) and strip.dtype == np.uint8
