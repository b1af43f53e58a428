# SPDX-License-Identifier: BSD-2-Clause
"""Moving the closed robot by hand, up to where it can go."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import SSTError, WorkspaceError
from ..sst.check import LARGEST_CONDITION, SMALLEST_SINE
from ..sst.platform_motion import orientation
from ..sst.robot import SST

Array = NDArray[np.float64]

#: Of one step on the way, [rad]; a joint that turns further than `_JUMP` in it has changed its
#: assembly.
_STEP, _JUMP = np.radians(1.0), 0.5


class Pose(NamedTuple):
    """Where the robot stands.

    Attributes:
        q: Joint coordinates, shape (9,), [rad].
        stopped: Why it went no further; empty when it arrived.
    """

    q: Array
    stopped: str = ""


def angles_of(R: Array) -> Array:
    """theta, phi, psi of an orientation of the star, as `orientation` takes them, [rad]."""
    s = R[:, 0]
    theta, phi = np.arctan2(s[1], s[0]), np.arctan2(np.hypot(s[0], s[1]), s[2])
    turn = orientation(theta, phi).T @ R  # about x
    return np.array((theta, phi, np.arctan2(turn[2, 1], turn[1, 1])))


def move_star(robot: SST, q: Array, goal: ArrayLike) -> Pose:
    """Turn the star by inverse kinematics, keeping the branches of the legs.

    Args:
        robot: The SST.
        q: Where it stands, shape (9,).
        goal: theta, phi, psi to go to, [rad].
    """
    branch = robot.branch(q)

    def solve(angles: Array, _: Array) -> Array:
        return robot.inverse_kinematics(orientation(*angles), branch)

    return _walk(robot, q, angles_of(robot.platform_orientation(q)), goal, solve)


def move_motors(robot: SST, q: Array, goal: ArrayLike) -> Pose:
    """Turn the motors by direct kinematics, keeping the assembly.

    Args:
        robot: The SST.
        q: Where it stands, shape (9,).
        goal: gamma_1..3 to go to, [rad].
    """
    return _walk(robot, q, q[::3], goal, robot.forward_kinematics)


def _walk(
    robot: SST,
    q: Array,
    start: Array,
    goal: ArrayLike,
    solve: Callable[[Array, Array], Array],
) -> Pose:
    """From one set of coordinates to another in small steps, as far as they lead."""
    way = np.asarray(goal, dtype=float) - start
    steps = max(1, int(np.ceil(np.abs(way).max() / _STEP)))
    for share in np.arange(1, steps + 1) / steps:
        try:
            q = _continued(robot, q, solve(start + share * way, q))
        except SSTError as error:
            return Pose(q, str(error))
    return Pose(q)


def _continued(robot: SST, before: Array, q: Array) -> Array:
    """The next pose on a way, its angles without jumps of a turn.

    Raises:
        WorkspaceError: When the way ends here.
    """
    turned = (q - before + np.pi) % (2 * np.pi) - np.pi
    near = robot.singularities(q)
    if near.first_kind < SMALLEST_SINE:
        leg = int(np.abs(np.sin(q[1::3])).argmin()) + 1
        raise WorkspaceError(f"boundary of the workspace: leg {leg} lies flat on its arc")
    if near.condition_number > LARGEST_CONDITION:
        raise WorkspaceError("singularity: the motors lose hold of the star")
    if np.abs(turned).max() > _JUMP:
        raise WorkspaceError("this assembly ends here")
    return before + turned
