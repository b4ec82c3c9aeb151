"""From a STATE to what the policy observes, by the names in the policy's file.

Speed, path error and velocity are those of the newest STATE; the force is the mean of the last samples, as in
training; feed adjustment, depth and stiffness are the present set-points.
"""

from __future__ import annotations

from collections.abc import Sequence

from mjx_cutting.deploy.artefact import Artefact
from mjx_cutting.deploy.protocol import State

# isort: split
import numpy as np

ACTIONS = ("stiffness_x", "stiffness_y", "stiffness_z", "feed_adjustment", "depth")
NAMES = (
    "speed_along_path", "path_error_x", "path_error_y", "path_error_z", "velocity_x", "velocity_y",
    "velocity_z", "force_x", "force_y", "force_z", "feed_adjustment", "depth", "log_stiffness_x",
    "log_stiffness_y", "log_stiffness_z",
)  # fmt: skip


class Observer:
    """Builds the observation of a policy.

    Arguments:
        artefact: the policy.

    Raises:
        ValueError: an observation of it is none of `NAMES`, or its actions are not `ACTIONS` in that order.
    """

    def __init__(self, artefact: Artefact):
        unknown = [name for name in artefact.observation_names if name not in NAMES]
        if unknown:
            raise ValueError(
                f"got a policy that observes {', '.join(unknown)}; expected observations of: "
                f"{', '.join(NAMES)}; a STATE packet carries no others"
            )
        if artefact.action_names != ACTIONS:
            raise ValueError(
                f"got a policy with the actions {', '.join(artefact.action_names)}; expected "
                f"{', '.join(ACTIONS)}, which a COMMAND packet carries"
            )
        self._order = [NAMES.index(name) for name in artefact.observation_names]

    def __call__(
        self, state: State, forces_n: Sequence[tuple[float, float, float]], set_point: np.ndarray
    ) -> np.ndarray:
        """Returns [observation], physical values in the artefact's order.

        Arguments: state; forces_n, the last samples, at least one; set_point [5].
        """
        count = len(forces_n)
        all_ = np.array(
            (
                state.speed_along_m_s, *state.path_error_m, *state.velocity_m_s,
                *(sum(axis) / count for axis in zip(*forces_n, strict=True)),
                set_point[3], set_point[4], *np.log(set_point[:3]),
            )
        )  # fmt: skip
        return all_[self._order]
