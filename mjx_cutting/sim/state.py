"""What an environment remembers: the state of an episode, and its shape for a trainer."""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import jax
from jax import Array

from mjx_cutting.sim import randomize, robot
from mjx_cutting.sim.substep import Body, Conditions
from mjx_cutting.sim.vectors import Vector


class SimState(NamedTuple):
    """Everything that an episode remembers, one environment.

    Fields: `q`, `qd` [7]; `heights` [cells] of the sheet, m; `setpoint` [5] (logarithm of the gains, feed
    adjustment, depth); `reference_m` along the path; `angle_rad` of the spindle; `memory` of the force model;
    `draw` of the disturbance; `filtered_n` [3]; `cut_length_m`, `time_s`; `tcp_m` [3]; `key`; `episode` what
    was drawn at reset.
    """

    q: Array
    qd: Array
    heights: Array
    setpoint: Array
    reference_m: Array
    angle_rad: Array
    memory: Any
    draw: Any
    filtered_n: Array
    cut_length_m: Array
    time_s: Array
    tcp_m: Array
    key: Array
    episode: randomize.Episode


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class EnvState:
    """State of an environment, shaped as brax's training expects it.

    Fields: `pipeline_state` a `SimState`; `obs` [15]; `reward`, `done` []; `metrics` amounts of this step;
    `info` the clean observation, how the episode ended, and sums over the episode.
    """

    pipeline_state: SimState
    obs: Array
    reward: Array
    done: Array
    metrics: dict[str, Array]
    info: dict[str, Any]

    def replace(self, **changes: Any) -> EnvState:
        """The same state with some fields changed."""
        return dataclasses.replace(self, **changes)


METRICS = (
    "mrv_mm3", "contact_s", "contact_load_n_s", "contact_error_mm_s", "progress_m", "saturated_s",
    "completed", "failed", "nan",
)  # fmt: skip
"""Amounts of one policy step; sums over an episode give volume, time in contact, and means over contact."""


def body_of(sim: SimState, part: tuple[Array, ...]) -> Body:
    """What moves at 500 Hz, as scalars, from the state and the window `part` of its sheet."""
    return Body(
        q=tuple(sim.q[i] for i in range(robot.JOINTS)),
        qd=tuple(sim.qd[i] for i in range(robot.JOINTS)),
        reference_m=sim.reference_m,
        angle_rad=sim.angle_rad,
        part=part,
        filtered_n=split(sim.filtered_n),
        cut_length_m=sim.cut_length_m,
        time_s=sim.time_s,
    )


def conditions_of(episode: randomize.Episode) -> Conditions:
    """The scalars of an episode that act at 500 Hz."""
    return Conditions(
        material=episode.material,
        thickness_m=episode.thickness_m,
        sheet_height_m=episode.sheet_height_m,
        sheet_slope=episode.sheet_slope,
        payload_kg=episode.payload_kg,
    )


def split(vector: Array) -> Vector:
    """[3] as three scalars."""
    return (vector[0], vector[1], vector[2])
