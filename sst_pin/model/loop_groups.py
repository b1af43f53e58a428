# SPDX-License-Identifier: BSD-2-Clause
"""Groups of loops that share joints, and the largest offset in a group or in a robot.

The offsets are the lengths by which errors, rates and rows of Phi in metres are divided. So
thresholds are free of units and hold for small and large robots.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from .closures import Constraint, Distance, Rolling, frames_of, holds_points
from .tree import frame_named

#: An offset that is smaller, relative to the size of the bodies, is zero that a file with six
#: digits has rounded.
_SMALL = 1e-6


class LoopGroup(NamedTuple):
    """Loops that share joints."""

    #: Indices of the joints of the loops.
    joints: set[int]
    closures: list[Constraint]


def loop_groups(model: pin.Model, closures: Sequence[Constraint]) -> list[LoopGroup]:
    """The groups of loops of a tree with closures.

    Two loops are in one group if they share a joint, also by way of other loops.
    """
    groups: list[LoopGroup] = []
    for closure in closures:
        joints = _joints_of_loop(model, closure)
        # Groups that share a joint with this loop become one group with it.
        sharing = [group for group in groups if not joints.isdisjoint(group.joints)]
        groups = [group for group in groups if joints.isdisjoint(group.joints)]
        members = [member for group in sharing for member in group.closures]
        all_joints = joints.union(*(group.joints for group in sharing))
        groups.append(LoopGroup(all_joints, [*members, closure]))
    return groups


def _joints_of_loop(model: pin.Model, closure: Constraint) -> set[int]:
    """The joints that move one frame of a closure, but not the other one; none for a coupling."""
    joints = set[int]()
    for name in frames_of(closure):
        # `supports` are the joints that move a body. Those of both frames cancel.
        joints ^= set(model.supports[frame_named(model, name).parentJoint])
    return joints


def longest_offset(
    model: pin.Model, joints: Iterable[int], closures: Iterable[Constraint], ground: bool = True
) -> float:
    """The largest distance of two points on one body, [m]; 0 if it is rounding of zero.

    The points are the origins of the joints and of the frames of the closures. Lengths of rods and
    radii of wheels count too.

    Args:
        model: The tree.
        joints: Indices of the joints that count.
        closures: The closures that count.
        ground: Whether points on the ground count. Even then, a frame on the ground counts only if
            its closure fixes the distance of the two origins: the frame of a rail, for instance,
            may be anywhere on it.
    """
    # The points on each body, in its axes, by the index of its joint. The origin is its own joint.
    points: dict[int, list[Array]] = {j: [np.zeros(3)] for j in joints}
    size_of_bodies = max((_size(model.inertias[j]) for j in points), default=0.0)
    for j in list(points):
        points.setdefault(model.parents[j], []).append(model.jointPlacements[j].translation)
    lengths = [0.0]
    for closure in closures:
        for name in frames_of(closure):
            frame = frame_named(model, name)
            if frame.parentJoint or holds_points(closure):
                points.setdefault(frame.parentJoint, []).append(frame.placement.translation)
        if isinstance(closure, Distance):
            lengths.append(closure.distance)
        elif isinstance(closure, Rolling):
            lengths.append(closure.radius)
    if not ground:
        points.pop(0, None)
    for points_of_body in map(np.array, points.values()):
        differences = points_of_body[:, None] - points_of_body  # of all pairs
        lengths.append(float(np.linalg.norm(differences, axis=-1).max()))
    longest = max(lengths)
    return longest if longest > _SMALL * size_of_bodies else 0.0


def _size(body: pin.Inertia) -> float:
    """Distance of the mass centre from the joint, or the radius of gyration if larger, [m].

    Without mass there is no radius of gyration.
    """
    # The trace of the inertia is twice the integral of the squared distance from the mass centre.
    square = np.trace(body.inertia) / 2 / body.mass if body.mass > 0 else 0.0
    return float(max(np.linalg.norm(body.lever), np.sqrt(max(square, 0.0))))
