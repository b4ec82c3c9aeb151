"""What anyone would use instead, for comparison in the same run.

* `GymCutting`: a Gymnasium-style environment on C MuJoCo, with the same task in NumPy: episodes drawn by the
  same function, the same control law, force, sheet, sensor, reward and endings. One object is one
  environment; processes run several. tests/sim/test_peers.py compares it with `CuttingEnv` step by step.
* `rollout_rate`: the bare dynamics in `mujoco.rollout` on threads, without control, force, sheet or sensor.

Written as such code is usually written: clear NumPy on small arrays, no tricks.
"""

from __future__ import annotations

import copy
import math
import multiprocessing
import time
from typing import Any, NamedTuple

import jax
import mujoco
import numpy as np
from mujoco import rollout

from mjx_cutting.sim import action as actions
from mjx_cutting.sim import observation, randomize, robot
from mjx_cutting.sim.config import EnvConfig


class _Instant(NamedTuple):
    """One physics step, base axes: the cut, the force on the tool and as felt, and the control cycle."""

    area_m2: float
    depth_m: float
    load_n: np.ndarray
    felt_n: np.ndarray
    error_m: np.ndarray
    velocity_m_s: np.ndarray


class GymCutting:
    """The cutting task as a Gymnasium-style environment; `step` returns obs, reward, ends and info.

    Disturbances and force models with effects are not in it.
    """

    def __init__(self, config: EnvConfig | None = None, seed: int = 0):
        self.config = config = config or EnvConfig()
        self.robot = robot.load()
        self.model = copy.copy(self.robot.model)
        self.data = mujoco.MjData(self.model)
        self.rng = np.random.default_rng(seed)
        self.key = jax.random.key(seed)
        self.draw = jax.jit(lambda key: randomize.draw(key, config))
        self.tcp, self.com = self.model.site("tcp").id, self.model.site("saw_com").id
        self.saw = self.model.body("saw").id
        self.bounds = actions.limits(config)
        self.low, self.high = actions.internal_range(self.bounds)
        self.start_m = np.array([*config.start_m, config.surface_height_m - config.depth_m[0]])
        self.start_q = robot.solve_pose(self.robot, self.start_m)
        self.pitch = 2.0 * np.pi / config.teeth * np.arange(config.teeth)
        self.turn = 2.0 * np.pi * config.spindle_speed_rev_s * config.physics_step_s
        self.centres = (np.arange(round(config.path_m / config.cell_m)) + 0.5) * config.cell_m
        hz = config.force_lowpass_hz
        self.keep = np.exp(-2.0 * np.pi * hz * config.physics_step_s) if hz > 0.0 else 0.0
        self.reset()

    def reset(self, episode: randomize.Episode | None = None) -> np.ndarray:
        """First observation of a fresh episode, [15]; of the conditions given, where they are."""
        config, data = self.config, self.data
        if episode is None:
            self.key, key = jax.random.split(self.key)
            episode = self.draw(key)
        self.episode = episode = jax.tree.map(lambda leaf: np.asarray(leaf, float), episode)
        material = episode.material
        self.chip = np.array([material.K_tc_n_m2, material.K_rc_n_m2])
        self.edge = np.array([material.K_te_n_m, material.K_re_n_m])
        self.payload, self.gain_factor = float(episode.payload_kg), episode.gain_factor
        self.sheet_height, self.sheet_slope = float(episode.sheet_height_m), float(episode.sheet_slope)
        self.model.body_mass[self.saw] = self.robot.model.body_mass[self.saw] + self.payload
        mujoco.mj_setConst(self.model, data)
        mujoco.mj_resetData(self.model, data)
        data.qpos[:] = self.start_q
        mujoco.mj_forward(self.model, data)
        self.frame = data.site_xmat[self.tcp].reshape(3, 3).copy()
        self.setpoint = np.asarray(actions.log_start(config))
        self.thickness, self.angle = float(episode.thickness_m), float(episode.spindle_angle_rad)
        self.heights = np.where(self.centres > config.approach_m, 0.0, -self.thickness)
        self.reference, self.steps, self.filtered = 0.0, 0, np.zeros(3)
        return self._observe(np.zeros(3), np.zeros(3), np.zeros(3))

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """One policy step of 20 ms."""
        config, dt = self.config, self.config.policy_step_s
        target = self.low + 0.5 * (np.clip(action, -1.0, 1.0) + 1.0) * (self.high - self.low)
        most = np.asarray(self.bounds.rate) * dt
        before = self.setpoint
        self.setpoint = np.clip(before + np.clip(target - before, -most, most), self.low, self.high)
        gains, sink = np.exp(self.setpoint[:3]), (self.setpoint[4] - before[4]) / dt
        feed = config.nominal_feed_m_s * (1.0 + self.setpoint[3])
        each = []
        for k in range(config.substeps):
            depth = before[4] + sink * k * config.physics_step_s
            each.append(self._physics(gains * self.gain_factor, feed, depth, sink))
        self.steps += 1
        errors, loads = np.array([one.error_m for one in each]), np.array([one.load_n for one in each])
        heard = np.mean([one.felt_n for one in each[-config.force_average_samples :]], axis=0)
        volume = sum(one.area_m2 for one in each) * config.kerf_m * 1e9
        path = dt * 1e6 * float(np.dot(config.reward_path_per_mm2_s, np.mean(errors**2, axis=0)))
        force = dt * float(np.dot(config.reward_force_per_n2_s, np.mean(loads, axis=0) ** 2))
        obs = self._observe(heard, errors[-1], each[-1].velocity_m_s)
        failed = self._failed(errors, loads, max(one.depth_m for one in each)) or not np.isfinite(obs).all()
        cut = config.reward_mrv_per_mm3 * volume
        reward = cut - config.reward_time_per_s * dt - path - force + config.failure_reward * failed
        terminated = failed or self.reference >= config.path_m - 1e-6
        truncated = self.steps >= config.max_episode_steps and not terminated
        info = {"reward_mrv": cut, "reward_path": -path, "reward_force": -force, "failed": failed}
        return obs, float(reward), bool(terminated), truncated, info

    def _observe(self, force: np.ndarray, error: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        config, limit = self.config, np.asarray(self.config.force_range_n)
        noise = self.rng.normal(size=3) * config.force_noise_n / np.sqrt(config.force_average_samples)
        force = np.clip(force + noise + self.episode.bias_n, -limit, limit)
        parts = (-velocity[1:2], error, velocity, force, self.setpoint[3:], self.setpoint[:3])
        return (np.concatenate(parts) / observation.SCALES).astype(np.float32)

    def _failed(self, errors: np.ndarray, loads: np.ndarray, depth: float) -> bool:
        config, arm, q, qd = self.config, self.robot, self.data.qpos, self.data.qvel
        far = np.linalg.norm(errors, axis=1).max() > config.max_deviation_m
        hard = np.linalg.norm(loads, axis=1).max() > config.max_force_n
        limits = np.any((q < arm.lower_rad) | (q > arm.upper_rad) | (abs(qd) > arm.velocity_limit_rad_s))
        return bool(far or hard or limits or depth > config.max_depth_m)

    def _physics(self, gains: np.ndarray, feed: float, depth: float, sink: float) -> _Instant:
        """One physics step toward set-points."""
        config, model, data = self.config, self.model, self.data
        mujoco.mj_step1(model, data)
        jacobian, com, com_rate, mass = (np.zeros((n, 7)) for n in (6, 3, 3, 7))
        mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], self.tcp)
        mujoco.mj_jacSite(model, data, com, None, self.com)
        mujoco.mj_jacDot(model, data, com_rate, None, data.site_xpos[self.com], self.saw)
        mujoco.mj_fullM(model, data, mass)
        # The controller's model knows nothing of the error of the saw's mass.
        drift, gravity = com_rate @ data.qvel, model.opt.gravity
        mass -= self.payload * com.T @ com
        bias = data.qfrc_bias - self.payload * com.T @ (drift - gravity)
        tcp, frame = data.site_xpos[self.tcp], data.site_xmat[self.tcp].reshape(3, 3)
        x, y = config.start_m
        if self.reference >= config.path_m:
            feed = 0.0
        wish = np.array([x, y - self.reference, config.surface_height_m - depth])
        speed = jacobian @ data.qvel
        twist = self.frame @ frame.T
        tilt = 0.5 * np.array(
            [twist[2, 1] - twist[1, 2], twist[0, 2] - twist[2, 0], twist[1, 0] - twist[0, 1]]
        )
        stiff = config.orientation_stiffness_s2
        error = wish - tcp
        linear = gains * error + 2.0 * np.sqrt(gains) * (np.array([0.0, -feed, -sink]) - speed[:3])
        angular = stiff * tilt - 2.0 * np.sqrt(stiff) * speed[3:]
        operational = np.linalg.inv(jacobian @ np.linalg.inv(mass) @ jacobian.T)
        wish_rate = np.concatenate([linear, angular]) + config.null_damping_s * speed
        torque = jacobian.T @ (operational @ wish_rate) - config.null_damping_s * (mass @ data.qvel) + bias
        limit = self.robot.torque_limit_nm
        data.ctrl[:] = np.minimum(np.maximum(torque, -limit), limit)
        along = float(y - tcp[1])
        height = float(tcp[2]) - config.surface_height_m - self.sheet_height - self.sheet_slope * along
        area, ahead = self._remove(along, height)
        force = self._force(*self._arc(along, height, ahead), -speed[1])
        data.qfrc_applied[:] = jacobian[:3].T @ force
        mujoco.mj_step2(model, data)
        carried = self.robot.tool_mass_kg + self.payload
        felt = force - carried * (com @ data.qacc + drift)
        held = felt + carried * gravity
        felt = felt + tilt[[1, 2, 0]] * held[[2, 0, 1]] - tilt[[2, 0, 1]] * held[[1, 2, 0]]
        self.filtered = self.keep * self.filtered + (1.0 - self.keep) * felt
        self.reference = min(self.reference + feed * config.physics_step_s, config.path_m)
        self.angle += self.turn
        return _Instant(area, ahead, force, self.filtered, error, speed[:3])

    def _remove(self, along: float, height: float) -> tuple[float, float]:
        """Area cut from the sheet and the depth of the material ahead."""
        config, radius = self.config, self.config.radius_m
        first = max(0, int((along - 0.02) / config.cell_m))
        window = slice(first, first + 40)
        apart, part = self.centres[window] - along, self.heights[window].copy()
        above, near = part - height, np.maximum(apart - config.cell_m, 0.0)
        reached = (apart > -0.5 * config.cell_m) & (near * near <= above * (2.0 * radius - above))
        depth = float(np.max(np.where(reached, above, 0.0), initial=0.0))
        profile = height + radius - np.sqrt(np.maximum(radius**2 - apart * apart, 0.0))
        after = np.minimum(part, np.maximum(profile, -self.thickness))
        self.heights[window] = after
        return float(np.sum(part - after)) * config.cell_m, max(depth, 0.0)

    def _arc(self, along: float, height: float, depth: float) -> tuple[float, float]:
        """Angles between which the teeth are in the sheet, for material `depth` deep ahead."""
        config, radius = self.config, self.config.radius_m
        under = math.acos(1.0 - min(max(-self.thickness - height, 0.0) / radius, 1.0))
        begin, end = (
            math.asin(min(max(edge - along, 0.0) / radius, 1.0))
            for edge in (config.approach_m, config.path_m)
        )
        return max(under, begin), min(math.acos(1.0 - min(depth / radius, 1.0)), end)

    def _force(self, enter: float, leave: float, speed: float) -> np.ndarray:
        """Mean cutting force over the step, base axes: integrated over what each tooth sweeps in the arc."""
        config = self.config
        if leave <= enter:
            return np.zeros(3)
        start = np.mod(self.angle - self.pitch + self.turn, 2.0 * np.pi) - self.turn
        ends = np.minimum(np.maximum([start, start + self.turn], enter), leave)
        sines, cosines, span = np.sin(ends), np.cos(ends), np.sum(ends[1] - ends[0])
        cosine, sine = np.sum(sines[1] - sines[0]), np.sum(cosines[0] - cosines[1])
        mixed = 0.5 * np.sum(sines[1] ** 2 - sines[0] ** 2)
        square = 0.5 * (span - np.sum(sines[1] * cosines[1] - sines[0] * cosines[0]))
        chip = max(speed, 0.0) / (config.teeth * config.spindle_speed_rev_s)
        (k_te, k_re), (tangential, radial) = self.edge, self.chip * chip
        feed = -(k_te * cosine + tangential * mixed + k_re * sine + radial * square)
        normal = k_te * sine + tangential * square - k_re * cosine - radial * mixed
        return config.kerf_m / self.turn * np.array([0.0, -feed, -normal])


_STEPS = 100  # policy steps between two looks at the clock: the best stretch counts, as for ours


def gym_rate(processes: int, seconds: float, config: EnvConfig | None = None) -> float:
    """Physics steps per second of `processes` Gymnasium-style environments, one process each."""
    context = multiprocessing.get_context("spawn")
    with context.Pool(processes) as pool:
        counts = pool.starmap(_gym_worker, [(config, seed, seconds) for seed in range(processes)])
    return float(sum(counts))


def _gym_worker(config: EnvConfig | None, seed: int, seconds: float) -> float:
    env = GymCutting(config, seed)
    rng = np.random.default_rng(seed)
    for _ in range(5):
        env.step(rng.uniform(-1.0, 1.0, 5))
    best, begin = 0.0, time.perf_counter()
    while time.perf_counter() - begin < seconds:
        start = time.perf_counter()
        for _ in range(_STEPS):
            _, _, terminated, _, _ = env.step(rng.uniform(-1.0, 1.0, 5))
            if terminated:
                env.reset()
        best = max(best, _STEPS * env.config.substeps / (time.perf_counter() - start))
    return best


def rollout_rate(threads: int, seconds: float, batch: int = 64, steps: int = 100) -> float:
    """Physics steps per second of the bare arm in `mujoco.rollout` on `threads` threads."""
    own = robot.load()
    data = [mujoco.MjData(own.model) for _ in range(threads)]
    state = np.zeros((batch, mujoco.mj_stateSize(own.model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    state[:, 1 : 1 + own.model.nq] = robot.WORKING_POSE_RAD
    control = np.zeros((batch, steps, own.model.nu))
    with rollout.Rollout(nthread=threads) as pool:
        pool.rollout([own.model] * batch, data, state, control)
        best, begin = 0.0, time.perf_counter()
        while time.perf_counter() - begin < seconds:
            start = time.perf_counter()
            pool.rollout([own.model] * batch, data, state, control)
            best = max(best, batch * steps / (time.perf_counter() - start))
        return best
