# SPDX-License-Identifier: BSD-2-Clause
"""Groups of loops that share joints, and the lengths of these groups and of the robot.

Lengths make numbers free of units: errors, rates and rows of Phi in metres are divided by the
length of their group, so that thresholds hold for small and large robots.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from .closures import Constraint, Distance, Rolling, frames_of, holds_points
from .tree import frame_named

#: Offsets that are smaller, relative to the bodies, are rounding of zero in files with six digits.
_SMALL = 1e-6


class LoopGroup(NamedTuple):
    """Loops that share joints."""

    #: Indices of the joints of the loops.
    joints: set[int]
    closures: list[Constraint]


def loop_groups(model: pin.Model, closures: Sequence[Constraint]) -> list[LoopGroup]:
    """The groups of loops of a tree with closures.

    The joints of a loop are those that move one of the two frames of its closure, but not both.
    """
    groups: list[LoopGroup] = []
    for closure in closures:
        joints = set[int]()  # none for a coupling
        for name in frames_of(closure):
            joints ^= set(model.supports[frame_named(model, name).parentJoint])
        members = [closure]
        # Groups that share a joint with this closure become one group with it.
        others = []
        for group in groups:
            if joints.isdisjoint(group.joints):
                others.append(group)
            else:
                joints |= group.joints
                members = group.closures + members
        groups = [*others, LoopGroup(joints, members)]
    return groups


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
        ground: Whether points on the ground count. Of frames on the ground, only those of closures
            that fix the distance of their origins do: a frame of a plane or rail may be anywhere
            on it.
    """
    # The points on each body, in its axes, by the index of its joint. Its own joint is at zero.
    points: dict[int, list[Array]] = {j: [np.zeros(3)] for j in joints}
    size = max((_size(model.inertias[j]) for j in points), default=0.0)
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
    for of_body in map(np.array, points.values()):
        lengths.append(float(np.linalg.norm(of_body[:, None] - of_body, axis=-1).max()))
    return max(lengths) if max(lengths) > _SMALL * size else 0.0


def _size(body: pin.Inertia) -> float:
    """Distance of the mass centre, or the radius of gyration (0 without mass) if larger, [m]."""
    square = np.trace(body.inertia) / 2 / body.mass if body.mass > 0 else 0.0
    return float(max(np.linalg.norm(body.lever), np.sqrt(max(square, 0.0))))
