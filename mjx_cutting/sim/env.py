"""The cutting environment: a robot guides a saw through a sheet along a straight path.

One `step` is one policy step of 20 ms: set-points move toward the action, ten physics steps run in a
`lax.scan`, and observation (15), reward and ending follow. `reset` and `step` are pure and describe a single
environment; batch them with `jax.vmap`, or use `wrapper.TrainingWrapper`, which also resets.

    env = CuttingEnv(EnvConfig())
    state = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), 256))
    state = jax.jit(jax.vmap(env.step))(state, jnp.zeros((256, env.action_size)))
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jax import Array

from mjx_cutting.cutting import ForceModel
from mjx_cutting.sim import action as actions
from mjx_cutting.sim import force as forces
from mjx_cutting.sim import observation, randomize, reward, robot, termination
from mjx_cutting.sim.config import EnvConfig
from mjx_cutting.sim.state import METRICS, EnvState, SimState, body_of, conditions_of, split
from mjx_cutting.sim.substep import Body, Conditions, Orders, Plant, Sums
from mjx_cutting.sim.vectors import Vector, constant


class CuttingEnv:
    """Robotic cutting of a sheet.

    Arguments:
        config: every number; default `EnvConfig()`.
        model: force model whose effects (and, for a slitting saw, whose tool) are used; its constants only
            where `config.materials` names "model". None: the base model.
        disturbance: a `PeriodicPosterior` for the disturbance modes; None only with mode "none".

    Raises:
        ValueError: a mode without a disturbance, materials "model" without a model, or effects that do not
        fit the saw.
    """

    def __init__(
        self, config: EnvConfig | None = None, model: ForceModel | None = None, disturbance: Any = None
    ):
        self.config = config = config or EnvConfig()
        if config.disturbance_mode != "none" and disturbance is None:
            raise ValueError(
                f"disturbance_mode is {config.disturbance_mode!r} but no disturbance is given; expected a "
                'PeriodicPosterior (mjx-cutting fit-gp makes one), or mode "none"'
            )
        self.robot = robot.load()
        self._given_material = None if model is None else model.material
        # Traced only, for its complaint about materials that cannot be drawn.
        jax.eval_shape(lambda key: randomize.draw(key, config, self._given_material), jax.random.key(0))
        self.model = forces.saw_model(config, model)
        self._start_q = robot.solve_pose(
            self.robot, np.asarray([*config.start_m, config.surface_height_m - config.depth_m[0]])
        )
        self.plant = Plant(config, self.robot, self.model, self._engine(), self._held_frame(), disturbance)
        self.disturbance = disturbance
        self._bounds = actions.limits(config)

    # -- what a trainer or exporter asks

    @property
    def observation_size(self) -> int:
        """15."""
        return observation.SIZE

    @property
    def action_size(self) -> int:
        """5."""
        return actions.SIZE

    @property
    def action_limits(self) -> actions.ActionLimits:
        """Physical low, high and rate of each action."""
        return self._bounds

    @property
    def observation_names(self) -> tuple[str, ...]:
        """Names of the 15 observations."""
        return observation.NAMES

    @property
    def observation_units(self) -> tuple[str, ...]:
        """Units of the physical values."""
        return observation.UNITS

    @property
    def observation_scales(self) -> tuple[float, ...]:
        """observation = physical value / scale."""
        return observation.SCALES

    @property
    def dt(self) -> float:
        """Length of a policy step, s."""
        return self.config.policy_step_s

    @property
    def unwrapped(self) -> CuttingEnv:
        """The environment itself."""
        return self

    @property
    def backend(self) -> str:
        """ "mjx"."""
        return "mjx"

    # -- the two functions

    def reset(self, key: Array) -> EnvState:
        """A fresh episode: robot at the path's start, uncut sheet, new conditions drawn from `key`."""
        config = self.config
        key, draw_key, gp_key, noise_key = jax.random.split(key, 4)
        episode = randomize.draw(draw_key, config, self._given_material)
        gp = None
        if self.disturbance is not None and config.disturbance_mode != "none":
            gp = self.disturbance.draw(gp_key, mode=config.disturbance_draw)
        zero = jnp.zeros((), float)
        setpoint = jnp.asarray(actions.log_start(config), float)
        start = np.asarray([*config.start_m, config.surface_height_m - config.depth_m[0]])
        sim = SimState(
            q=jnp.asarray(self._start_q, float),
            qd=jnp.zeros(robot.JOINTS, float),
            heights=self.plant.workpiece.fresh(episode.thickness_m),
            setpoint=setpoint,
            reference_m=zero,
            angle_rad=episode.spindle_angle_rad,
            memory=forces.memory(self.model),
            draw=gp,
            filtered_n=jnp.zeros(3, float),
            cut_length_m=zero,
            time_s=zero,
            tcp_m=jnp.asarray(start, float),
            key=key,
            episode=episode,
        )
        force = self._noise(noise_key) + episode.bias_n
        obs = observation.observe(
            zero, jnp.zeros(3), jnp.zeros(3), force, setpoint[3], setpoint[4], jnp.exp(setpoint[:3])
        )
        false = jnp.zeros((), bool)
        return EnvState(
            pipeline_state=sim,
            obs=obs,
            reward=zero,
            done=zero,
            metrics=dict.fromkeys((*reward.TERMS, *METRICS), zero),
            info={
                "clean_obs": obs,
                "terminal_obs": obs,
                "terminated": false,
                "truncated": false,
                "material": episode.material_index,
                "episode_sums": dict.fromkeys(("reward", "steps", *METRICS), zero),
            },
        )

    def step(self, state: EnvState, action: Array) -> EnvState:
        """One policy step under `action` [5] in [-1, 1]; values outside are clipped."""
        config, sim = self.config, state.pipeline_state
        key, noise_key, gp_key = jax.random.split(sim.key, 3)
        setpoint = actions.follow(sim.setpoint, action, self._bounds, config.policy_step_s)
        first = self.plant.workpiece.window_at(config.start_m[1] - sim.tcp_m[1])
        part, window_m = self.plant.workpiece.take(sim.heights, first)
        gains = jnp.exp(setpoint[:3])
        orders = Orders(
            stiffness_s2=split(gains * sim.episode.gain_factor),
            feed_m_s=config.nominal_feed_m_s * (1.0 + setpoint[3]),
            depth_m=sim.setpoint[4],
            sink_m_s=(setpoint[4] - sim.setpoint[4]) / config.policy_step_s,
            window_m=window_m,
        )
        body, sums, memory, draw = self._substeps(
            body_of(sim, part), sim.memory, sim.draw, orders, conditions_of(sim.episode), gp_key
        )
        after = SimState(
            q=jnp.stack(body.q),
            qd=jnp.stack(body.qd),
            heights=self.plant.workpiece.put(sim.heights, body.part, first),
            setpoint=setpoint,
            reference_m=jnp.asarray(body.reference_m),
            angle_rad=jnp.asarray(body.angle_rad),
            memory=memory,
            draw=draw,
            filtered_n=jnp.stack(body.filtered_n),
            cut_length_m=jnp.asarray(body.cut_length_m),
            time_s=jnp.asarray(body.time_s),
            tcp_m=jnp.stack(sums.tcp_m),
            key=key,
            episode=sim.episode,
        )
        velocity, error = jnp.stack(sums.velocity_m_s), jnp.stack(sums.error_m)
        measured = self._measure(jnp.stack(sums.sensed_n), noise_key, sim.episode)
        disturbed = self._measure(
            jnp.stack(sums.sensed_n) + jnp.stack(sums.disturbance_n), noise_key, sim.episode
        )
        clean, obs = (
            observation.observe(-velocity[1], error, velocity, force, setpoint[3], setpoint[4], gains)
            for force in (measured, disturbed)
        )
        return self._conclude(state, after, body, sums, clean, obs)

    def _substeps(
        self, body: Body, memory: Any, draw: Any, orders: Orders, conditions: Conditions, key: Array
    ) -> tuple[Body, Sums, Any, Any]:
        """All physics steps of a policy step."""
        config, disturbance = self.config, self.disturbance
        active = config.disturbance_mode != "none"
        zero = jnp.zeros((), float)
        noise = None
        if active and config.disturbance_draw == "function_noise":
            noise = jax.random.normal(key, (config.substeps, 3)) * disturbance.noise_std_n

        def one(carry: tuple[Body, Sums, Any, Any], each: tuple[Array, Any]) -> tuple[Any, None]:
            body, sums, memory, draw = carry
            k, extra = each
            force: Vector = (zero, zero, zero)
            if active:
                value = disturbance.value(draw)
                force = split(value if extra is None else value + extra)
                draw = disturbance.advance(draw, config.physics_step_s)
            body, sums, memory = self.plant.advance(body, sums, memory, orders, conditions, k, force)
            return (body, sums, memory, draw), None

        steps = jnp.arange(config.substeps, dtype=float)
        (body, sums, memory, draw), _ = jax.lax.scan(one, (body, Sums.zero(), memory, draw), (steps, noise))
        return body, sums, memory, draw

    def _conclude(
        self, before: EnvState, sim: SimState, body: Body, sums: Sums, clean: Array, obs: Array
    ) -> EnvState:
        """Reward, ending and metrics; a state that is not finite is masked."""
        config, dt = self.config, self.config.policy_step_s
        volume_mm3 = sums.removed_m2 * config.kerf_m * 1e9
        finite = jnp.isfinite(jnp.sum(sim.q) + jnp.sum(sim.qd) + jnp.sum(obs) + volume_mm3)
        end = termination.judge(
            config,
            self.robot,
            reference_m=sim.reference_m,
            time_s=sim.time_s,
            deviation_m=jnp.sqrt(sums.worst_error_m2),
            depth_m=jnp.asarray(sums.worst_depth_m),
            force_n=jnp.sqrt(sums.worst_load_n2),
            q=body.q,
            qd=body.qd,
            finite=finite,
        )
        parts = reward.terms(
            config,
            volume_mm3,
            [1e6 * e for e in sums.error_squared_m2],
            [f * f for f in sums.load_n],
            end.failed,
        )
        parts = {
            name: jnp.where(finite | (name == "reward_failure"), value, 0.0) for name, value in parts.items()
        }
        share = dt / config.substeps
        metrics = {
            "mrv_mm3": volume_mm3,
            "contact_s": sums.contact * share,
            "contact_load_n_s": sums.contact_load_n * share,
            "contact_error_mm_s": sums.contact_error_m * (1e3 * share),
            "progress_m": sim.reference_m - before.pipeline_state.reference_m,
            "saturated_s": sums.saturated * share,
            "completed": end.completed.astype(float),
            "failed": end.failed.astype(float),
        }
        metrics = {name: jnp.where(finite, value, 0.0) for name, value in metrics.items()}
        metrics["failed"] = end.failed.astype(float)
        metrics["nan"] = 1.0 - finite.astype(float)
        value = sum(parts[name] for name in reward.TERMS)
        obs, clean = (jnp.where(finite, x, before.obs) for x in (obs, clean))
        amounts = {"reward": value, "steps": jnp.ones((), float), **metrics}
        sums_before = before.info["episode_sums"]
        info = dict(
            before.info,
            clean_obs=clean,
            terminal_obs=obs,
            terminated=end.terminated,
            truncated=end.truncated,
            episode_sums={name: sums_before[name] + amounts[name] for name in sums_before},
        )
        return before.replace(
            pipeline_state=sim,
            obs=obs,
            reward=jnp.asarray(value),
            done=(end.terminated | end.truncated).astype(float),
            metrics={**before.metrics, **parts, **metrics},
            info=info,
        )

    def _noise(self, key: Array) -> Array:
        """[3] noise of the mean of the force samples in one observation."""
        scale = np.asarray(self.config.force_noise_n) / np.sqrt(self.config.force_average_samples)
        return jax.random.normal(key, (3,)) * jnp.asarray(scale, float)

    def _measure(self, force: Array, key: Array, episode: randomize.Episode) -> Array:
        limit = jnp.asarray(self.config.force_range_n, float)
        return jnp.clip(force + self._noise(key) + episode.bias_n, -limit, limit)

    def _engine(self) -> Any:
        """MJX, or None where the plant computes the dynamics inside its own kernel."""
        if self.config.engine != "mjx":
            return None
        from mjx_cutting.sim.mjx_engine import MjxEngine

        return MjxEngine(self.robot)

    def _held_frame(self) -> Any:
        """Orientation of the tool frame at the path's start, as constants."""
        data = mujoco.MjData(self.robot.model)
        data.qpos[:] = robot.WORKING_POSE_RAD
        mujoco.mj_kinematics(self.robot.model, data)
        columns = np.round(data.site("tcp").xmat.reshape(3, 3), 9)
        return tuple(constant(columns[:, k]) for k in range(3))
