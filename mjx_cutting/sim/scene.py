"""The scene of a cut for an off-screen renderer or a viewer: robot, bench, sheet, kerf, trail and force.

The physics model has no sheet (the cut is a height field of the environment), so the scene is the same MJCF
with bench and sheet added. The bottom of the kerf is drawn stretch by stretch from the height field.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np

from mjx_cutting.sim import headless, robot
from mjx_cutting.sim.env import CuttingEnv
from mjx_cutting.sim.materials import MATERIALS

COLOURS = {
    "foam": (0.95, 0.90, 0.62, 1.0),
    "plastic": (0.35, 0.62, 0.88, 1.0),
    "cardboard": (0.80, 0.64, 0.42, 1.0),
    "mica": (0.72, 0.60, 0.52, 1.0),
    "aluminium": (0.78, 0.80, 0.83, 1.0),
    "model": (0.70, 0.70, 0.70, 1.0),
}
NEWTON_M = 0.006
"""Length of the force arrow per newton, m; it is drawn from the hub of the saw, where it can be seen."""
SHADOW_PIXELS = 2048
"""Side of the shadow map: where OpenGL runs in software, MuJoCo's 4096 take most of the time of a picture."""
CAP_M = 2e-4
"""Thickness of the dark layer at the bottom of the kerf, m."""
HALF_WIDTH_M = 0.055
"""Half the drawn width of the sheet, m."""


@dataclass
class Snapshot:
    """What one picture shows.

    Fields: `q` [7]; `tcp_m` [3]; `heights` [cells]; `force_n` [3] observed, base axes; `time_s`; `values` of
    the traces, in order of `traces.NAMES`; `totals` sums over the episode so far, by name, with "terminated"
    and "truncated".
    """

    q: np.ndarray
    tcp_m: np.ndarray
    heights: np.ndarray
    force_n: np.ndarray
    time_s: float
    values: tuple[float, ...]
    totals: dict[str, float] = field(default_factory=dict)


@dataclass
class Scene:
    """An off-screen scene of one environment.

    Arguments:
        env: the environment.
        material: name of the sheet.
        width, height: of a picture, pixels.
        camera: "overview" or "cut" (close to the saw, moving with it).
    """

    env: CuttingEnv
    material: str = "aluminium"
    width: int = 960
    height: int = 720
    camera: str = "overview"
    _trail: deque[np.ndarray] = field(default_factory=lambda: deque(maxlen=400))

    def __post_init__(self) -> None:
        if self.camera not in _CAMERAS:
            raise ValueError(f"camera is {self.camera!r}; expected one of {', '.join(_CAMERAS)}")
        headless.required()
        self._model = scene_model(self.env, self.material)
        self._data = mujoco.MjData(self._model)
        try:
            self._renderer = mujoco.Renderer(self._model, self.height, self.width, max_geom=3000)
        except (mujoco.FatalError, RuntimeError) as error:
            raise RuntimeError(
                f"no off-screen OpenGL ({error}); {headless.INSTALL} and set MUJOCO_GL to egl or osmesa "
                "before Python starts"
            ) from error
        self._view = mujoco.MjvCamera()

    def follow(self, shot: Snapshot) -> None:
        """Add the tool's place to the trail."""
        self._trail.append(shot.tcp_m.copy())

    def draw(self, shot: Snapshot) -> np.ndarray:
        """[height, width, 3] picture, uint8."""
        self._data.qpos[:] = shot.q
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        _CAMERAS[self.camera](self._view, self.env, shot)
        self._renderer.update_scene(self._data, self._view)
        self.follow(shot)
        add_cut(self._renderer.scene, self.env, self.material, shot, list(self._trail))
        return self._renderer.render()

    def close(self) -> None:
        """Give the OpenGL context back."""
        self._renderer.close()

    def __enter__(self) -> Scene:
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()


def scene_model(env: CuttingEnv, material: str) -> Any:
    """The robot's model with bench, sheet and clamps."""
    config = env.config
    spec = mujoco.MjSpec.from_file(str(robot.asset_path()))
    spec.visual.quality.shadowsize = SHADOW_PIXELS
    thickness = _thickness(material)
    x, start = config.start_m
    top = config.surface_height_m
    middle, half = start - config.approach_m - 0.5 * config.cut_m, 0.5 * config.cut_m
    box = mujoco.mjtGeom.mjGEOM_BOX
    world = spec.worldbody
    bench = 0.5 * (top - thickness + 0.4)
    world.add_geom(
        type=box,
        size=[0.11, half + 0.05, bench],
        pos=[x, middle, top - thickness - bench],
        material="bench",
        group=1,
    )
    gap = 0.5 * config.kerf_m
    for side in (-1.0, 1.0):
        wide = 0.5 * (HALF_WIDTH_M - gap)
        place = [x + side * (gap + wide), middle, top - 0.5 * thickness]
        world.add_geom(
            type=box, size=[wide, half, 0.5 * thickness], pos=place, rgba=COLOURS[material], group=1
        )
        for end in (-0.7, 0.7):
            clamp = [x + side * (HALF_WIDTH_M + 0.004), middle + end * half, top + 0.002]
            world.add_geom(type=box, size=[0.012, 0.014, 0.006], pos=clamp, material="dark", group=1)
    return spec.compile()


def add_cut(scene: Any, env: CuttingEnv, material: str, shot: Snapshot, trail: Sequence[np.ndarray]) -> None:
    """Bottom of the kerf, trail of the tool before the sheet and force arrow, as geoms of `scene`."""
    config, piece = env.config, env.plant.workpiece
    x, start = config.start_m
    top, thickness = config.surface_height_m, _thickness(material)
    plain = np.asarray(COLOURS[material])
    for first, last, tall in _runs(shot.heights, piece.material, thickness):
        if tall <= -thickness + 1e-6:
            continue
        low = piece.origin_m + first * piece.cell_m
        high = piece.origin_m + last * piece.cell_m
        dark = CAP_M if -thickness + CAP_M < tall < -1e-6 else 0.0  # a dark bottom shows the kerf
        layers = ((-thickness, tall - dark, plain), (tall - dark, tall, plain * [0.55, 0.55, 0.55, 1.0]))
        for below, above, colour in layers[: 2 if dark else 1]:
            size = [0.5 * config.kerf_m, 0.5 * (high - low), 0.5 * (above - below)]
            place = [x, start - 0.5 * (low + high), top + 0.5 * (above + below)]
            _geom(scene, mujoco.mjtGeom.mjGEOM_BOX, size, place, colour)
    edge_m = start - config.approach_m
    approach = [tcp for tcp in trail if tcp[1] > edge_m]  # over the sheet the kerf shows the way
    for before, after in zip(approach[:-1:4], approach[4::4], strict=False):
        _connect(scene, mujoco.mjtGeom.mjGEOM_CAPSULE, 0.0006, before, after, (0.1, 0.55, 0.25, 1.0))
    hub = shot.tcp_m + [0.0, 0.0, config.radius_m]
    tip = hub + NEWTON_M * shot.force_n
    if np.linalg.norm(shot.force_n) > 0.3:
        _connect(scene, mujoco.mjtGeom.mjGEOM_ARROW, 0.004, hub, tip, (0.85, 0.1, 0.1, 1.0))


def _runs(heights: np.ndarray, material: np.ndarray, thickness: float) -> Iterator[tuple[int, int, float]]:
    """Stretches of cells of one height (to 20 um): first cell, one past the last, height."""
    cells = np.flatnonzero(material)
    first, last = int(cells[0]), int(cells[-1]) + 1
    level = np.round(heights / 2e-5)
    start = first
    for cell in range(first + 1, last + 1):
        if cell == last or level[cell] != level[start]:
            yield start, cell, float(heights[start:cell].mean())
            start = cell


def _geom(scene: Any, kind: Any, size: Sequence[float], place: Sequence[float], colour: Any) -> None:
    if scene.ngeom >= scene.maxgeom:
        return
    mujoco.mjv_initGeom(
        scene.geoms[scene.ngeom], kind, np.asarray(size, float), np.asarray(place, float), np.eye(3).ravel(),
        np.asarray(colour, np.float32),
    )  # fmt: skip
    scene.ngeom += 1


def _connect(scene: Any, kind: Any, radius: float, start: np.ndarray, end: np.ndarray, colour: Any) -> None:
    if scene.ngeom >= scene.maxgeom:
        return
    _geom(scene, kind, [radius, 0.0, 0.0], [0.0, 0.0, 0.0], colour)
    mujoco.mjv_connector(scene.geoms[scene.ngeom - 1], kind, radius, start, end)


def _overview(view: Any, env: CuttingEnv, shot: Snapshot) -> None:
    view.lookat[:] = [0.30, 0.10, 0.30]
    view.distance, view.azimuth, view.elevation = 1.75, 215.0, -18.0


def _close(view: Any, env: CuttingEnv, shot: Snapshot) -> None:
    view.lookat[:] = shot.tcp_m + [0.0, 0.03, 0.015]
    view.distance, view.azimuth, view.elevation = 0.29, 240.0, -32.0


_CAMERAS = {"overview": _overview, "cut": _close}


def _thickness(material: str) -> float:
    return MATERIALS["aluminium" if material not in MATERIALS else material].thickness_m
