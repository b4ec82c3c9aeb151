"""Stills, videos and the interactive view of one episode: the scene of the cut with traces below it."""

from __future__ import annotations

import io
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import jax
import mujoco
import numpy as np

from mjx_cutting import _files, _platform
from mjx_cutting.sim.env import CuttingEnv, EnvState
from mjx_cutting.sim.scene import Scene, Snapshot, add_cut, scene_model
from mjx_cutting.sim.traces import draw_traces

MIN_WIDTH = 320
"""Narrowest picture that has room for the traces, pixels."""


def take(env: CuttingEnv, state: EnvState) -> Snapshot:
    """What a picture of a single environment's state shows."""
    sim = state.pipeline_state
    scales = np.asarray(env.observation_scales)
    values = np.asarray(state.obs) * scales
    error = float(np.linalg.norm(values[1:4]))
    traces = (
        *values[7:10],
        1e3 * error,
        1e3 * float(values[11]),
        env.config.nominal_feed_m_s * 1e3 * (1.0 + float(values[10])),
        float(state.info["episode_sums"]["mrv_mm3"]),
    )
    return Snapshot(
        q=np.asarray(sim.q, float),
        tcp_m=np.asarray(sim.tcp_m, float),
        heights=np.asarray(sim.heights, float),
        force_n=values[7:10].astype(float),
        time_s=float(sim.time_s),
        values=tuple(float(v) for v in traces),
        totals={
            **{name: float(value) for name, value in state.info["episode_sums"].items()},
            "terminated": float(state.info["terminated"]),
            "truncated": float(state.info["truncated"]),
        },
    )


def tell(shot: Snapshot, material: str) -> dict[str, Any]:
    """What an episode came to, from its last snapshot: means over the time in contact, sums, how it ended."""
    sums = shot.totals
    contact = max(sums["contact_s"], 1e-9)
    if sums["completed"]:
        ended = "completed"
    elif sums["failed"]:
        ended = "failed"
    else:
        ended = "out of time" if sums["truncated"] else "not ended"
    return {
        "material": material,
        "ended": ended,
        "time_s": shot.time_s,
        "contact_s": sums["contact_s"],
        "path_deviation_mm": sums["contact_error_mm_s"] / contact,
        "load_n": sums["contact_load_n_s"] / contact,
        "mrv_mm3": sums["mrv_mm3"],
        "reward": sums["reward"],
    }


def play(
    env: CuttingEnv, policy: Callable[[Any], Any], seed: int = 0, every: int = 1, limit: int | None = None
) -> Iterator[tuple[Snapshot, str]]:
    """Snapshots of one episode under `policy` (observation to action), and the name of its sheet."""
    jit = _platform.jit if env.config.engine == "mjx" else jax.jit
    reset, step = jit(env.reset), jit(lambda state: env.step(state, policy(state.obs)))
    state = reset(jax.random.key(seed))
    material = env.config.materials[int(state.info["material"])]
    for count in range(limit or env.config.max_episode_steps):
        if count % every == 0:
            yield take(env, state), material
        state = step(state)
        if float(state.done) > 0.0:
            break
    yield take(env, state), material


def render_video(
    env: CuttingEnv,
    policy: Callable[[Any], Any],
    path: str | Path,
    *,
    seed: int = 0,
    camera: str = "cut",
    size: tuple[int, int] = (960, 540),
    every: int = 2,
    speed: float = 1.0,
    say: Callable[[float], None] = lambda time_s: None,
    keep: Callable[[tuple[Snapshot, str]], None] = lambda shot: None,
) -> Path:
    """Path of a video (.mp4 or .gif) of one episode, with traces below the picture.

    Arguments:
        policy: observation [15] to action [5].
        size: width and height of the robot's picture, pixels; the traces come below.
        every: policy steps per picture.
        speed: 1 is real time.
        say: called with the simulated time of each picture.
        keep: called with each picture's snapshot and the name of the sheet.

    Raises:
        ValueError: a suffix other than .mp4 or .gif, or a size that is too narrow or odd.
        ImportError: the extra "video" is not installed.
    """
    path = Path(path)
    if path.suffix not in (".mp4", ".gif"):
        raise ValueError(
            f"the video is to be written to {path.name}; expected a name that ends in .mp4 or .gif"
        )
    if size[0] < MIN_WIDTH or size[0] % 2 or size[1] % 2:
        raise ValueError(f"size is {size}; expected even numbers, at least {MIN_WIDTH} wide for the traces")
    mediapy = _mediapy()
    rate = speed / (every * env.config.policy_step_s)
    width, height = size
    shape = (height + _TRACE_HEIGHT, width)
    frames = _frames(env, policy, seed, every, camera, size, say, keep)
    part = path.with_name(path.stem + ".part" + path.suffix)
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        if path.suffix == ".gif":
            mediapy.write_video(part, list(frames), fps=rate, codec="gif")
        else:
            with mediapy.VideoWriter(part, shape=shape, fps=rate, crf=20) as writer:
                for frame in frames:
                    writer.add_image(frame)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
    return path


def render_still(
    env: CuttingEnv,
    policy: Callable[[Any], Any],
    path: str | Path,
    *,
    seed: int = 0,
    camera: str = "overview",
    size: tuple[int, int] = (960, 540),
    at_s: float = 10.0,
) -> Path:
    """Path of a picture (.png) of one episode `at_s` seconds after its start, with the traces so far.

    Raises:
        ValueError: a suffix other than .png.
    """
    from PIL import Image

    path = Path(path)
    if path.suffix != ".png":
        raise ValueError(f"the picture is to be written to {path.name}; expected a name that ends in .png")
    limit = round(at_s * env.config.policy_rate_hz)
    frame = None
    history: list[Snapshot] = []
    shots = list(play(env, policy, seed, every=2, limit=limit))
    with Scene(env, shots[0][1], size[0], size[1], camera) as scene:
        for shot, _ in shots:
            history.append(shot)
            scene.follow(shot)
        frame = _compose(scene.draw(shots[-1][0]), history)
    buffer = io.BytesIO()
    Image.fromarray(frame).save(buffer, format="png")
    return _files.write_atomic(path, buffer.getvalue())


def view(env: CuttingEnv, policy: Callable[[Any], Any], seed: int = 0) -> None:
    """Show one episode in MuJoCo's interactive viewer, in real time; returns when it is closed."""
    from mujoco import viewer

    shots = play(env, policy, seed)
    first, material = next(shots)
    model = scene_model(env, material)
    data = mujoco.MjData(model)
    data.qpos[:] = first.q
    mujoco.mj_forward(model, data)
    trail: list[np.ndarray] = []
    with viewer.launch_passive(model, data) as window:
        for shot, _ in shots:
            start = time.perf_counter()
            if not window.is_running():
                return
            trail.append(shot.tcp_m)
            with window.lock():
                data.qpos[:] = shot.q
                mujoco.mj_forward(model, data)
                window.user_scn.ngeom = 0
                add_cut(window.user_scn, env, material, shot, trail[-400:])
            window.sync()
            time.sleep(max(0.0, env.config.policy_step_s - (time.perf_counter() - start)))
        while window.is_running():
            time.sleep(0.1)


_TRACE_HEIGHT = 200


def _frames(
    env: CuttingEnv,
    policy: Callable[[Any], Any],
    seed: int,
    every: int,
    camera: str,
    size: tuple[int, int],
    say: Callable[[float], None],
    keep: Callable[[tuple[Snapshot, str]], None],
) -> Iterator[np.ndarray]:
    scene: Scene | None = None
    history: list[Snapshot] = []
    try:
        for shot, material in play(env, policy, seed, every):
            if scene is None:
                scene = Scene(env, material, size[0], size[1], camera)
            history.append(shot)
            say(shot.time_s)
            keep((shot, material))
            yield _compose(scene.draw(shot), history)
    finally:
        if scene is not None:
            scene.close()


def _compose(picture: np.ndarray, history: Sequence[Snapshot]) -> np.ndarray:
    times = np.asarray([shot.time_s for shot in history])
    values = np.asarray([shot.values for shot in history])
    return np.concatenate([picture, draw_traces(times, values, picture.shape[1], _TRACE_HEIGHT)], axis=0)


def _mediapy() -> Any:
    try:
        import imageio_ffmpeg  # type: ignore[import-untyped]
        import mediapy
    except ImportError as error:
        raise ImportError(
            'a video needs the packages of the extra "video"; install with: pip install "mjx-cutting[video]"'
        ) from error
    mediapy.set_ffmpeg(imageio_ffmpeg.get_ffmpeg_exe())
    return mediapy
