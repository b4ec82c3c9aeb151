"""How the robot answers a force on the tool: an affine map, found once per physics step.

The plant differs from the controller's model by a point mass dm at the saw's centre of mass, where the sensor
carries it (the payload error):

    (M + dm Jc^T Jc) qdd = tau - h - dm Jc^T (Jc_dot qd - g) + J_v^T F

With M = L L^T, B = L^-1 Jc^T and G = 1 + dm B^T B (3 x 3) the inverse is L^-T (1 - dm B G^-1 B^T) L^-1
(Woodbury), so qdd = qdd_0 + A F with A = (M + dm Jc^T Jc)^-1 J_v^T. The cutting force then needs nothing more
of the dynamics. Holds while 1 + dm B^T B stays positive definite: dm above minus the effective mass there.
"""

from __future__ import annotations

from typing import NamedTuple

from mjx_cutting.sim import cholesky
from mjx_cutting.sim.chain import Drift
from mjx_cutting.sim.controller import Control, weigh
from mjx_cutting.sim.vectors import Scalar, Vector, add, dot, minus, mul, plus, scale


class Answer(NamedTuple):
    """Accelerations of joints and of the saw's centre of mass as functions of the force on the tool.

    Fields: `free` 7 scalars and `com_free_m_s2` without a force; `per_force` three columns of 7 scalars and
    `com_per_force` three vectors, per newton along each base axis.
    """

    free: list[Scalar]
    per_force: list[list[Scalar]]
    com_free_m_s2: Vector
    com_per_force: list[Vector]

    def accelerate(self, force_n: Vector) -> tuple[list[Scalar], Vector]:
        """Joint accelerations and acceleration of the saw's centre of mass under `force_n`, base axes."""
        joints = [
            add(free, dot([column[i] for column in self.per_force], force_n))
            for i, free in enumerate(self.free)
        ]
        return joints, plus(self.com_free_m_s2, weigh(self.com_per_force, list(force_n)))


def answer(
    columns: list[Vector], drift: Drift, control: Control, payload_kg: Scalar, gravity_m_s2: Vector
) -> Answer:
    """The map at the present state.

    Arguments:
        columns: 7 columns of the Jacobian of the saw's centre of mass.
        drift, control: of the controller's model, with the torques asked.
        payload_kg: error dm of the saw's mass.
        gravity_m_s2: base axes.
    """
    inner = [cholesky.forward(control.lower, [column[k] for column in columns]) for k in range(3)]
    stretched = [
        [add(1.0 if i == j else 0.0, mul(payload_kg, dot(inner[i], inner[j]))) for j in range(i + 1)]
        for i in range(3)
    ]
    inner_factor = cholesky.factor(stretched)

    def solve(reduced: list[Scalar]) -> list[Scalar]:
        """(M + dm Jc^T Jc)^-1 b from L^-1 b."""
        weights = cholesky.solve(inner_factor, [dot(row, reduced) for row in inner])
        weights = [mul(payload_kg, w) for w in weights]
        left = [add(y, mul(-1.0, dot(weights, [row[i] for row in inner]))) for i, y in enumerate(reduced)]
        return cholesky.backward(control.lower, left)

    pull = scale(payload_kg, minus(gravity_m_s2, drift.com_m_s2))
    right = [
        tau - h + dot(column, pull)
        for tau, h, column in zip(control.torque_nm, drift.bias, columns, strict=True)
    ]
    free = solve(cholesky.forward(control.lower, right))
    per_force = [solve(row) for row in control.rows]
    return Answer(
        free=free,
        per_force=per_force,
        com_free_m_s2=plus(drift.com_m_s2, weigh(columns, free)),
        com_per_force=[weigh(columns, column) for column in per_force],
    )
