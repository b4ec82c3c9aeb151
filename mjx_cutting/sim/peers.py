"""What anyone would use instead, for comparison in the same run.

* `GymCutting`: a Gymnasium-style environment on C MuJoCo, with the same control law and the same mechanistic
  force (8 angles a step, all teeth) in NumPy. One object is one environment; processes run several.
* `rollout_rate`: the bare dynamics in `mujoco.rollout` on threads, without control, force, sheet or sensor.

Written as such code is usually written: clear NumPy on small arrays, no tricks.
"""

from __future__ import annotations

import multiprocessing
import time
from typing import Any

import mujoco
import numpy as np
from mujoco import rollout

from mjx_cutting.sim import action as actions
from mjx_cutting.sim import observation, robot
from mjx_cutting.sim.config import EnvConfig
from mjx_cutting.sim.materials import MATERIALS


class GymCutting:
    """The cutting task as a Gymnasium-style environment; `step` returns obs, reward, ends and info."""

    def __init__(self, config: EnvConfig | None = None, seed: int = 0):
        self.config = config or EnvConfig()
        self.robot = robot.load()
        self.model = self.robot.model
        self.data = mujoco.MjData(self.model)
        self.rng = np.random.default_rng(seed)
        self.site = self.model.site("tcp").id
        self.saw = self.model.body("saw").id
        self.bounds = actions.limits(self.config)
        self.low, self.high = actions.internal_range(self.bounds)
        start = np.asarray([*self.config.start_m, self.config.surface_height_m])
        self.start_q = robot.solve_pose(self.robot, start)
        self.pitch = 2.0 * np.pi / self.config.teeth * np.arange(self.config.teeth)
        self.share = (np.arange(self.config.force_samples) + 0.5) / self.config.force_samples
        self.centres = (np.arange(round(self.config.path_m / self.config.cell_m)) + 0.5) * self.config.cell_m
        self.reset()

    def reset(self) -> np.ndarray:
        """First observation of a fresh episode."""
        config, rng = self.config, self.rng
        limits = MATERIALS[str(rng.choice(list(MATERIALS)))]
        k_tc = np.exp(rng.uniform(*np.log(limits.K_tc_n_mm2))) * 1e6
        k_te = np.exp(rng.uniform(*np.log(limits.K_te_n_mm))) * 1e3
        self.chip = np.array([k_tc, k_tc * rng.uniform(*limits.chip_ratio)])
        self.edge = np.array([k_te, k_te * np.exp(rng.uniform(*np.log(limits.edge_ratio)))])
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:] = self.start_q
        mujoco.mj_forward(self.model, self.data)
        self.frame = self.data.site_xmat[self.site].reshape(3, 3).copy()
        self.setpoint = np.asarray(actions.log_start(config))
        self.heights = np.where(self.centres > config.approach_m, 0.0, -limits.thickness_m)
        self.thickness = limits.thickness_m
        self.reference, self.angle, self.filtered = 0.0, rng.uniform(0.0, 2.0 * np.pi), np.zeros(3)
        self.keep = np.exp(-2.0 * np.pi * config.force_lowpass_hz * config.physics_step_s)
        return np.zeros(observation.SIZE, np.float32)

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """One policy step of 20 ms."""
        config = self.config
        target = self.low + 0.5 * (np.clip(action, -1.0, 1.0) + 1.0) * (self.high - self.low)
        most = np.asarray(self.bounds.rate) * config.policy_step_s
        before = self.setpoint
        self.setpoint = np.clip(before + np.clip(target - before, -most, most), self.low, self.high)
        gains, sink = np.exp(self.setpoint[:3]), (self.setpoint[4] - before[4]) / config.policy_step_s
        feed = config.nominal_feed_m_s * (1.0 + self.setpoint[3])
        removed, heard, load = 0.0, np.zeros(3), np.zeros(3)
        for k in range(config.substeps):
            depth = before[4] + sink * k * config.physics_step_s
            area, force, felt, error, velocity = self._physics(gains, feed, depth, sink)
            removed, heard, load = removed + area, heard + felt, load + force
        heard, load = heard / config.substeps, load / config.substeps
        volume = removed * config.kerf_m * 1e9
        dt = config.policy_step_s
        reward = config.reward_mrv_per_mm3 * volume - config.reward_time_per_s * dt
        reward -= dt * 1e6 * float(np.dot(config.reward_path_per_mm2_s, error * error))
        reward -= dt * float(np.dot(config.reward_force_per_n2_s, load * load))
        noise = self.rng.normal(size=3) * config.force_noise_n / np.sqrt(config.force_average_samples)
        parts = [[-velocity[1]], error, velocity, heard + noise, self.setpoint[3:], np.log(gains)]
        obs = (np.concatenate(parts) / observation.SCALES).astype(np.float32)
        return obs, float(reward), self.reference >= config.path_m, False, {}

    def _physics(
        self, gains: np.ndarray, feed: float, depth: float, sink: float
    ) -> tuple[float, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """One physics step: area removed, load, force felt, path error, velocity."""
        config, model, data = self.config, self.model, self.data
        mujoco.mj_step1(model, data)
        jacobian, mass = np.zeros((6, 7)), np.zeros((7, 7))
        mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], self.site)
        mujoco.mj_fullM(model, data, mass)
        tcp, frame = data.site_xpos[self.site], data.site_xmat[self.site].reshape(3, 3)
        x, y = config.start_m
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
        inverse = np.linalg.inv(mass)
        operational = np.linalg.inv(jacobian @ inverse @ jacobian.T)
        wish_rate = np.concatenate([linear, angular]) + config.null_damping_s * speed
        torque = (
            jacobian.T @ operational @ wish_rate - config.null_damping_s * mass @ data.qvel + data.qfrc_bias
        )
        data.ctrl[:] = np.clip(torque, -self.robot.torque_limit_nm, self.robot.torque_limit_nm)
        along, height = y - tcp[1], tcp[2] - config.surface_height_m
        area, ahead = self._remove(along, height)
        force = self._force(ahead, -speed[1])
        data.qfrc_applied[:] = jacobian[:3].T @ force
        mujoco.mj_step2(model, data)
        rate = jacobian[:3] @ data.qacc
        felt = force - self.robot.tool_mass_kg * rate
        self.filtered = self.keep * self.filtered + (1.0 - self.keep) * felt
        self.reference = min(self.reference + feed * config.physics_step_s, config.path_m)
        self.angle += 2.0 * np.pi * config.spindle_speed_rev_s * config.physics_step_s
        return area, force, self.filtered, error, speed[:3]

    def _remove(self, along: float, height: float) -> tuple[float, float]:
        """Area cut from the sheet and the depth of the material ahead."""
        config, radius = self.config, self.config.radius_m
        first = max(0, int((along - 0.02) / config.cell_m))
        window = slice(first, first + 40)
        apart, part = self.centres[window] - along, self.heights[window]
        above, near = part - height, np.maximum(apart - config.cell_m, 0.0)
        reached = (apart > -0.5 * config.cell_m) & (near * near <= above * (2.0 * radius - above))
        depth = float(np.max(np.where(reached, above, 0.0), initial=0.0))
        profile = height + radius - np.sqrt(np.maximum(radius**2 - apart * apart, 0.0))
        after = np.minimum(part, np.maximum(profile, -self.thickness))
        self.heights[window] = after
        return float(np.sum(part - after)) * config.cell_m, max(depth, 0.0)

    def _force(self, depth: float, speed: float) -> np.ndarray:
        """Mean cutting force over the step, base axes."""
        config = self.config
        leave = np.arccos(1.0 - min(depth / config.radius_m, 1.0))
        turn = 2.0 * np.pi * config.spindle_speed_rev_s * config.physics_step_s
        angle = np.mod(self.angle + turn * self.share[:, None] - self.pitch[None, :], 2.0 * np.pi)
        inside = angle < leave
        sine, cosine = np.sin(angle), np.cos(angle)
        chip = np.maximum(speed, 0.0) / (config.teeth * config.spindle_speed_rev_s) * sine
        tangential = config.kerf_m * (self.edge[0] + self.chip[0] * chip) * inside
        radial = config.kerf_m * (self.edge[1] + self.chip[1] * chip) * inside
        feed = np.mean(np.sum(-tangential * cosine - radial * sine, axis=1))
        normal = np.mean(np.sum(tangential * sine - radial * cosine, axis=1))
        return np.array([0.0, -feed, -normal])


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
