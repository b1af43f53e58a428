# SPDX-License-Identifier: BSD-2-Clause
"""Groups of loops that share joints, and the lengths of these groups and of the robot."""

from collections.abc import Iterable, Sequence

import numpy as np
import pinocchio as pin

from ..arrays import Array
from .closures import Constraint, Distance, Rolling, frames_of, holds_points
from .tree import frame_named

#: Offsets that are smaller, relative to the bodies, are rounding of zero.
_SMALL = 1e-6


def loop_groups(
    model: pin.Model, closures: Sequence[Constraint]
) -> list[tuple[set[int], list[Constraint]]]:
    """(joints, closures) of each group; its joints move only one of the frames of a closure."""
    groups: list[tuple[set[int], list[Constraint]]] = []
    for closure in closures:
        joints = set[int]()  # none for a coupling
        for name in frames_of(closure):
            joints ^= set(model.supports[frame_named(model, name).parentJoint])
        members = [closure]
        # Groups that share a joint with this closure become one group with it.
        others = []
        for other_joints, other_members in groups:
            if joints.isdisjoint(other_joints):
                others.append((other_joints, other_members))
            else:
                joints |= other_joints
                members = other_members + members
        groups = [*others, (joints, members)]
    return groups


def longest_offset(
    model: pin.Model, joints: Iterable[int], closures: Iterable[Constraint], ground: bool = True
) -> float:
    """The largest distance of joints and closure frames on one body, [m]; 0 if negligible.

    Rod lengths and wheel radii count too. On the ground, frames count only of closures that fix the
    distance of their origins (not planes or rails). Without `ground` nothing on the ground counts.
    """
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
