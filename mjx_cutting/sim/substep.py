"""One physics step: control, cutting, removal, sensor, and the robot's motion.

Everything is elementwise over environments, so each stage compiles to one loop (see `kernel`). The order
within a step of length dt: the pose of the last step is read; torques follow; the force that the saw meets at
that pose acts; velocity, then position are integrated (semi-implicit Euler, as MuJoCo's default).

The sensor sits between flange and saw and was zeroed in free space at the working orientation, so it reads
F - m a + tilt x (F + m (g - a)): the load on the saw, its inertia, and its weight as it tilts.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import jax.numpy as jnp

from mjx_cutting.cutting import Cut, ForceModel, Material
from mjx_cutting.sim import chain
from mjx_cutting.sim.chain import Drift, Inertia
from mjx_cutting.sim.config import EnvConfig
from mjx_cutting.sim.controller import Command, Control, control
from mjx_cutting.sim.force import base_force, from_process, is_plain, modelled_force
from mjx_cutting.sim.kernel import one_kernel
from mjx_cutting.sim.plant import Answer, answer
from mjx_cutting.sim.robot import Robot
from mjx_cutting.sim.vectors import Frame, Scalar, Vector, constant, cross, dot, minus, plus, scale
from mjx_cutting.sim.workpiece import Engagement, Workpiece


class Body(NamedTuple):
    """What moves at 500 Hz, as scalars.

    Fields: `q`, `qd` 7 scalars each; `reference_m` along the path; `angle_rad` of the spindle; `part` the
    window of the height field, one scalar a cell; `filtered_n` 3 scalars, state of the sensor's low-pass;
    `cut_length_m`; `time_s`.
    """

    q: tuple[Scalar, ...]
    qd: tuple[Scalar, ...]
    reference_m: Scalar
    angle_rad: Scalar
    part: tuple[Scalar, ...]
    filtered_n: Vector
    cut_length_m: Scalar
    time_s: Scalar


class Conditions(NamedTuple):
    """The scalars of an episode that act at 500 Hz (see `randomize.Episode`)."""

    material: Material
    thickness_m: Scalar
    sheet_height_m: Scalar
    sheet_slope: Scalar
    payload_kg: Scalar


class Orders(NamedTuple):
    """Set-points held during a policy step.

    Fields: `stiffness_s2` realised, 3 scalars; `feed_m_s`; `depth_m` at the step's start and `sink_m_s` its
    rate; `window_m` path position of the first cell's centre.
    """

    stiffness_s2: Vector
    feed_m_s: Scalar
    depth_m: Scalar
    sink_m_s: Scalar
    window_m: Scalar


class Sums(NamedTuple):
    """What a policy step adds up over its physics steps; base axes.

    Fields: `removed_m2`; `contact`, `saturated` counts; `load_n` on the tool, `sensed_n`, `disturbance_n`,
    `error_squared_m2` means, 3 scalars each (`sensed_n` and `disturbance_n` over the last samples only);
    `contact_load_n`, `contact_error_m` sums of magnitudes in contact; `worst_error_m2`, `worst_load_n2`
    largest squares; `worst_depth_m` of engagement; `tcp_m`, `velocity_m_s`, `error_m` (reference minus
    actual) of the last control cycle.
    """

    removed_m2: Scalar
    contact: Scalar
    saturated: Scalar
    load_n: Vector
    sensed_n: Vector
    disturbance_n: Vector
    error_squared_m2: Vector
    contact_load_n: Scalar
    contact_error_m: Scalar
    worst_error_m2: Scalar
    worst_load_n2: Scalar
    worst_depth_m: Scalar
    tcp_m: Vector
    velocity_m_s: Vector
    error_m: Vector

    @classmethod
    def zero(cls) -> Sums:
        """Nothing added up yet."""
        zero = jnp.zeros((), float)
        vector = (zero,) * 3
        means, motion = (vector,) * 4, (vector,) * 3
        return cls(zero, zero, zero, *means, zero, zero, zero, zero, zero, *motion)


class Motion(NamedTuple):
    """Where the tool is and where it should be, base frame.

    Fields: `tcp_m`, `velocity_m_s`, `error_m` (reference minus actual), `tilt_rad`; `saturated`; `feed_m_s`
    of the reference.
    """

    tcp_m: Vector
    velocity_m_s: Vector
    error_m: Vector
    tilt_rad: Vector
    saturated: Scalar
    feed_m_s: Scalar


class Contact(NamedTuple):
    """What the saw meets, and what it leaves.

    Fields: `engagement`; `along_m` path position; `part` the window after the cut; `removed_m2`.
    """

    engagement: Engagement
    along_m: Scalar
    part: tuple[Scalar, ...]
    removed_m2: Scalar


class Plant:
    """The static parts of a physics step."""

    def __init__(
        self, config: EnvConfig, robot: Robot, model: ForceModel, engine: Any, frame: Frame, disturbance: Any
    ):
        self.config, self.robot, self.model, self.engine = config, robot, model, engine
        self.frame, self.disturbance = frame, disturbance
        self.workpiece = Workpiece(config)
        hz = config.force_lowpass_hz
        self.keep = math.exp(-2.0 * math.pi * hz * config.physics_step_s) if hz > 0.0 else 0.0
        # A kernel of its own keeps whatever computes the disturbance from being fused into a long one.
        self._turn = one_kernel(from_process)
        self._drift = one_kernel(self.drift)
        self._steer = one_kernel(self.steer)
        self._answer = one_kernel(self.answer)
        self._meet = one_kernel(self.meet)
        self._force = one_kernel(self.force)
        self._move = one_kernel(self.move)
        self._add = one_kernel(self.add)

    def advance(
        self,
        body: Body,
        sums: Sums,
        memory: Any,
        orders: Orders,
        conditions: Conditions,
        k: Scalar,
        disturbance: Vector,
    ) -> tuple[Body, Sums, Any]:
        """The `k`-th physics step; `memory` is the force model's, `disturbance` in process axes."""
        config, inertia = self.config, None
        if config.disturbance_mode != "none":
            disturbance = self._turn(disturbance)
        if self.engine is None:
            drift = self._drift(body.q, body.qd)
        else:
            inertia, drift = self.engine.evaluate(list(body.q), list(body.qd))
        motion, control, columns = self._steer(
            body.q, body.qd, body.reference_m, orders, k, drift.bias, inertia
        )
        answer = self._answer(columns, drift, control, conditions.payload_kg)
        contact = self._meet(body.part, orders.window_m, motion.tcp_m, conditions)
        cut = self.cut(body, motion, contact)
        if is_plain(self.model):
            process = sensed = self._force(conditions.material, cut)
        else:
            model = ForceModel(self.model.tool, conditions.material, self.model.effects)
            memory, process, sensed = modelled_force(
                model, memory, cut, config.physics_step_s, config.force_samples
            )
        touching, depth = contact.engagement.contact, contact.engagement.depth_m
        body, load, disturbed = self._move(
            body._replace(part=()),
            motion,
            answer,
            touching,
            conditions.payload_kg,
            process,
            sensed,
            disturbance,
        )
        sums = self._add(
            sums, motion, touching, depth, contact.removed_m2, load, body.filtered_n, disturbed, k
        )
        return body._replace(part=contact.part), sums, memory

    def drift(self, q: tuple[Scalar, ...], qd: tuple[Scalar, ...]) -> Drift:
        """Bias torques of the controller's model."""
        return chain.drift(self.robot, list(q), list(qd))

    def steer(
        self,
        q: tuple[Scalar, ...],
        qd: tuple[Scalar, ...],
        reference_m: Scalar,
        orders: Orders,
        k: Scalar,
        bias: list[Scalar],
        inertia: Inertia | None,
    ) -> tuple[Motion, Control, list[Vector]]:
        """Torques, and the Jacobian columns of the saw's centre of mass."""
        config, robot = self.config, self.robot
        if inertia is None:
            inertia = chain.inertia(robot, list(q))
        depth = orders.depth_m + orders.sink_m_s * (k * config.physics_step_s)
        position = (
            config.start_m[0],
            config.start_m[1] - reference_m,
            config.surface_height_m - depth,
        )
        feed = jnp.where(reference_m < config.path_m, orders.feed_m_s, 0.0)
        steer = control(
            inertia,
            bias,
            list(qd),
            Command(position, (0.0, -feed, -orders.sink_m_s), orders.stiffness_s2, self.frame),
            orientation_stiffness_s2=config.orientation_stiffness_s2,
            null_damping_s=config.null_damping_s,
            torque_limit_nm=robot.torque_limit_nm.tolist(),
        )
        motion = Motion(
            tcp_m=inertia.tcp_m,
            velocity_m_s=steer.velocity_m_s,
            error_m=minus(position, inertia.tcp_m),
            tilt_rad=steer.tilt_rad,
            saturated=steer.saturated,
            feed_m_s=feed,
        )
        return motion, steer, inertia.com_linear

    def answer(self, columns: list[Vector], drift: Drift, control: Control, payload_kg: Scalar) -> Answer:
        """How the plant, with its payload error, answers a force."""
        return answer(columns, drift, control, payload_kg, constant(self.robot.gravity_m_s2))

    def meet(
        self, part: tuple[Scalar, ...], window_m: Scalar, tcp_m: Vector, conditions: Conditions
    ) -> Contact:
        """What the saw meets with its lowest point at `tcp_m`, and the sheet after the cut."""
        config = self.config
        along = config.start_m[1] - tcp_m[1]
        surface = config.surface_height_m + conditions.sheet_height_m + conditions.sheet_slope * along
        height = tcp_m[2] - surface
        engagement = self.workpiece.meet(part, window_m, along, height, conditions.thickness_m)
        after, removed = self.workpiece.remove(part, window_m, along, height, conditions.thickness_m)
        return Contact(engagement, along, after, removed)

    def cut(self, body: Body, motion: Motion, contact: Contact) -> Cut:
        """Conditions of the cut at the start of the step."""
        return Cut(
            angle_rad=body.angle_rad,
            spindle_speed_rev_s=jnp.asarray(self.config.spindle_speed_rev_s, float),
            feed_speed_m_s=-motion.velocity_m_s[1],
            radial_depth_m=contact.engagement.depth_m,
            axial_width_m=jnp.asarray(self.config.kerf_m, float),
            entry_rad=contact.engagement.entry_rad,
            exit_rad=contact.engagement.exit_rad,
            position_m=contact.along_m,
            cut_length_m=body.cut_length_m,
            time_s=body.time_s,
            clock_s=body.time_s,
        )

    def force(self, material: Material, cut: Cut) -> Vector:
        """Mean force of the base model over the step, process axes."""
        config = self.config
        return base_force(self.model.tool, material, cut, config.physics_step_s, config.spindle_speed_rev_s)

    def move(
        self,
        body: Body,
        motion: Motion,
        answer: Answer,
        touching: Scalar,
        payload_kg: Scalar,
        process: Vector,
        sensed: Vector,
        disturbance: Vector,
    ) -> tuple[Body, Vector, Vector]:
        """Integrate under the force (process axes) and read the sensor; load and disturbance, base axes."""
        config, robot, dt = self.config, self.robot, self.config.physics_step_s
        disturbed = scale(1.0 if config.disturbance_in_air else touching, disturbance)
        load = from_process(process)
        if config.disturbance_mode == "dynamics":
            load = plus(load, disturbed)
        qdd, com_rate = answer.accelerate(load)
        qd = tuple(v + dt * a for v, a in zip(body.qd, qdd, strict=True))
        q = tuple(p + dt * v for p, v in zip(body.q, qd, strict=True))
        carried = robot.tool_mass_kg + payload_kg
        felt = minus(from_process(sensed), scale(carried, com_rate))
        weight = scale(carried, constant(robot.gravity_m_s2))
        felt = plus(felt, cross(motion.tilt_rad, plus(felt, weight)))
        speed = jnp.maximum(-motion.velocity_m_s[1], 0.0)
        after = Body(
            q=q,
            qd=qd,
            reference_m=jnp.minimum(body.reference_m + dt * motion.feed_m_s, config.path_m),
            angle_rad=_wrap(body.angle_rad + 2.0 * math.pi * config.spindle_speed_rev_s * dt),
            part=(),
            filtered_n=plus(scale(self.keep, body.filtered_n), scale(1.0 - self.keep, felt)),
            cut_length_m=body.cut_length_m + dt * speed * touching,
            time_s=body.time_s + dt,
        )
        return after, load, disturbed

    def add(
        self,
        sums: Sums,
        motion: Motion,
        touching: Scalar,
        depth_m: Scalar,
        removed_m2: Scalar,
        load: Vector,
        sensed: Vector,
        disturbance: Vector,
        k: Scalar,
    ) -> Sums:
        """The sums with one more physics step."""
        count, last = self.config.substeps, self.config.force_average_samples
        heard = jnp.where(k >= count - last, 1.0 / last, 0.0)
        squares: Vector = tuple(e * e for e in motion.error_m)  # type: ignore[assignment]
        distance2, load2 = squares[0] + squares[1] + squares[2], dot(load, load)
        return Sums(
            removed_m2=sums.removed_m2 + removed_m2,
            contact=sums.contact + touching,
            saturated=sums.saturated + motion.saturated,
            load_n=plus(sums.load_n, scale(1.0 / count, load)),
            sensed_n=plus(sums.sensed_n, scale(heard, sensed)),
            disturbance_n=plus(sums.disturbance_n, scale(heard, disturbance)),
            error_squared_m2=plus(sums.error_squared_m2, scale(1.0 / count, squares)),
            contact_load_n=sums.contact_load_n + touching * jnp.sqrt(load2),
            contact_error_m=sums.contact_error_m + touching * jnp.sqrt(distance2),
            worst_error_m2=jnp.maximum(sums.worst_error_m2, distance2),
            worst_load_n2=jnp.maximum(sums.worst_load_n2, load2),
            worst_depth_m=jnp.maximum(sums.worst_depth_m, depth_m),
            tcp_m=motion.tcp_m,
            velocity_m_s=motion.velocity_m_s,
            error_m=motion.error_m,
        )


def _wrap(angle: Scalar) -> Scalar:
    return angle - 2.0 * math.pi * jnp.floor(angle * (0.5 / math.pi))
