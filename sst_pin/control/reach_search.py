# SPDX-License-Identifier: BSD-2-Clause
"""A breadth-first search for the poses on a grid that a frame reaches from a start."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..arrays import Array
from ..closed_chain import ClosedChain
from ..errors import InputError
from ..loops.frame_guide import FrameGuide
from ..progress import counted
from ..summaries import listed

#: Codes of the result for a pose: it is reached, or why not. Where several reasons were met, the
#: smallest code counts.
REACHED = 0
JOINT_LIMITS = 1
SINGULAR = 2
OUT_OF_REACH = 3
CUT_OFF = 4
#: Words for these codes.
REASONS = ("reached", "joint limits", "singular", "out of reach", "cut off")
#: Number of grid points that are tried from the start: the nearest ones, usually the corners of the
#: cell around it.
_CORNERS = 4
#: The shortest step on the path to a pose, as a part of this path; see `FrameGuide.follow`.
_SHORTEST = 2**-6


class _Attempt(NamedTuple):
    """A motion from a configuration q with closed loops to the pose at a point of the grid."""

    q: Array
    point: tuple[int, int]


def reached_from(
    q_start: Array, start_point: Array, poses: Array, chain: ClosedChain, guide: FrameGuide
) -> tuple[NDArray[np.int8], Array]:
    """Codes (see `REASONS`) and configurations of all poses, shapes (N, M) and (N, M, nq).

    The points of the grid around the start are tried from the start. Each pose that is reached adds
    its neighbours to a queue, with its configuration as the start of the motion to them.

    Args:
        q_start: Configuration at the start.
        start_point: The pose at the start, in steps of the grid along both axes, shape (2,).
        poses: Homogeneous matrices, shape (N, M, 4, 4).
        chain: The robot, for its limits.
        guide: Moves the frame along the prescribed components by the motors.
    """
    joints = _joints_beyond_limits(chain, q_start)
    if joints:
        raise InputError("start", f"outside the limits of {listed(joints)}")
    shape = (poses.shape[0], poses.shape[1])
    why = np.full(shape, CUT_OFF, dtype=np.int8)
    q = np.full((*shape, len(q_start)), np.nan)

    queue = deque[_Attempt]()
    for point in _nearest_points(start_point, shape):
        queue.append(_Attempt(q_start, point))

    def attempts() -> Iterator[_Attempt]:
        """The attempts of the queue, which grows during the loop."""
        while queue:
            yield queue.popleft()

    for attempt in counted(attempts(), "reach_map, poses tried"):
        point = attempt.point
        if why[point] == REACHED:
            continue
        end = guide.follow(attempt.q, pin.SE3(poses[point]), _SHORTEST)
        if end.singular:
            reason = SINGULAR
        elif end.missed:
            reason = OUT_OF_REACH
        elif _joints_beyond_limits(chain, end.q):
            reason = JOINT_LIMITS
        else:
            reason = REACHED
            q[point] = end.q
            for neighbour in _neighbours(point, shape):
                queue.append(_Attempt(end.q, neighbour))
        # A pose that is not reached may be tried from several neighbours. The smallest code counts.
        why[point] = min(why[point], reason)
    return why, q


def _nearest_points(start_point: Array, shape: tuple[int, int]) -> list[tuple[int, int]]:
    """The points of the grid that are nearest to a point, at most `_CORNERS`, nearest first."""
    distances = np.linalg.norm(np.indices(shape) - start_point[:, None, None], axis=0)
    in_order = np.argsort(distances, axis=None, kind="stable")
    points = []
    for k in in_order[:_CORNERS].tolist():
        points.append(divmod(k, shape[1]))  # row and column
    return points


def _joints_beyond_limits(chain: ClosedChain, q: Array) -> list[str]:
    """Joints that are beyond their limits at q."""
    joints: list[str] = []
    for finding in chain.check_limits(q):
        if not finding.singular:
            joints.extend(finding.joints)
    return joints


def _neighbours(point: tuple[int, int], shape: tuple[int, int]) -> Iterator[tuple[int, int]]:
    """The two, three or four neighbours of a point on a grid."""
    i, j = point
    for row, column in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)):
        if 0 <= row < shape[0] and 0 <= column < shape[1]:
            yield row, column
