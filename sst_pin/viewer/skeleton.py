# SPDX-License-Identifier: BSD-2-Clause
"""The skeleton of a robot (joints, lines between them, ends of loops), and ellipsoids of inertia.

Sizes are relative to `size`, a length of the robot [m].
"""

from collections.abc import Iterator, Mapping, Sequence

import coal
import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..closed_chain import ClosedChain
from ..model.closures import Closure, Distance, Rolling
from ..model.tree import frame_named
from .rate_axes import RateAxis
from .scene_parts import GREY, Shape, along, homogeneous
from .triangles import ellipsoid, solid, tube

_JOINT = "#5C656E"
_END = "#B3261E"
_MASS = "#C98A2B"
#: Radii as shares of the robot's length.
BONE_RADIUS = 0.022
_JOINT_RADIUS = 0.055
_END_RADIUS = 0.04
#: Points of a body that are closer than this are one point, [m].
_SAME_POINT = 1e-9
#: Smallest square of a semi-axis of an ellipsoid, relative to the largest one; with zero the
#: ellipsoid would have no volume.
_THINNEST = 1e-4
#: Types of frames of fixed links and of points, such as a foot or a tool.
_POINTS = (pin.FrameType.BODY, pin.FrameType.OP_FRAME)


def skeleton(
    robot: ClosedChain, axes: Sequence[RateAxis], colours: Mapping[int, str], size: float
) -> Iterator[Shape]:
    """Lines between joints and other points of each body, joints, ends of loops, wheels.

    Args:
        robot: The robot.
        axes: The axis of each rate.
        colours: Colours of joints, by number; other joints are grey.
        size: A length of the robot, [m].
    """
    yield from _lines(robot, size)
    yield from _joints(robot.mechanism.model, axes, colours, size)
    yield from _ends_of_loops(robot, size)
    yield from _wheels(robot)


def _lines(robot: ClosedChain, size: float) -> Iterator[Shape]:
    """Lines from the joint of each body to its other points.

    The base has no joint: its lines start at the mean of its points.
    """
    for joint, points in enumerate(joined_points(robot)):
        hub = np.zeros(3)
        if joint == 0 and points:
            hub = np.mean(points, axis=0)
        for i, point in enumerate(points):
            if np.linalg.norm(point - hub) > _SAME_POINT:
                line = tube([hub, point], BONE_RADIUS * size)
                yield Shape(str(joint), "skeleton", f"bone_{i}", line, GREY)


def _joints(
    model: pin.Model, axes: Sequence[RateAxis], colours: Mapping[int, str], size: float
) -> Iterator[Shape]:
    """A cylinder about the axis of a hinge, a box along a slide, spheres for other joints."""
    r = _JOINT_RADIUS * size
    for joint in range(1, model.njoints):
        axes_of_joint = [axis for axis in axes if axis.joint == joint]
        colour = colours.get(joint, _JOINT)
        mover = joint
        at = np.eye(4)
        geometry: coal.ShapeBase = coal.Sphere(r)
        if len(axes_of_joint) == 1:
            (axis,) = axes_of_joint
            mover = axis.mover
            at = homogeneous(along(axis.direction), axis.origin)
            geometry = coal.Cylinder(r, 3 * r) if axis.turns else coal.Box(2 * r, 2 * r, 3 * r)
        name = f"joint_{model.names[joint]}"
        yield Shape(str(mover), "skeleton", name, solid(geometry), colour, at=at)


def _ends_of_loops(robot: ClosedChain, size: float) -> Iterator[Shape]:
    """Balls at the frames that closures connect."""
    ball = solid(coal.Sphere(_END_RADIUS * size))
    for end in _end_frames(robot):
        mover = str(end.parentJoint)
        at = end.placement.homogeneous
        yield Shape(mover, "skeleton", f"end_{end.name}", ball, _END, at=at)


def _wheels(robot: ClosedChain) -> Iterator[Shape]:
    """Wheels and balls of `Rolling` closures."""
    for closure in robot.closures:
        if isinstance(closure, Rolling):
            frame = frame_named(robot.mechanism.model, closure.wheel)
            r = closure.radius
            wheel = coal.Sphere(r) if closure.ball else coal.Cylinder(r, 0.1 * r)
            mover = str(frame.parentJoint)
            at = frame.placement.homogeneous
            name = f"wheel_{frame.name}"
            yield Shape(mover, "skeleton", name, solid(wheel), GREY, opacity=0.5, at=at)


def _end_frames(robot: ClosedChain) -> Iterator[pin.Frame]:
    """The frames that closures hold together, or at a constant distance."""
    for closure in robot.closures:
        if isinstance(closure, (Closure, Distance)):
            for name in (closure.frame_a, closure.frame_b):
                yield frame_named(robot.mechanism.model, name)


def joined_points(robot: ClosedChain) -> list[list[Array]]:
    """Points that each body connects: joints, ends of loops, feet; its mass centre if it has none.

    Returns:
        A list of points for each body, the base first. Points have the shape (3,), in the frame of
        the body's joint, [m].
    """
    model = robot.mechanism.model
    points: list[list[Array]] = [[] for _ in model.joints]

    # Joints on a body, and ends of loops.
    for joint in range(1, model.njoints):
        points[model.parents[joint]].append(model.jointPlacements[joint].translation)
    for end in _end_frames(robot):
        points[end.parentJoint].append(end.placement.translation)

    # Fixed links and points of moving bodies, unless another point is at the same place.
    for frame in model.frames:
        on_body = points[frame.parentJoint]
        point = frame.placement.translation
        is_known = any(np.linalg.norm(point - other) < _SAME_POINT for other in on_body)
        if frame.parentJoint and frame.type in _POINTS and not is_known:
            on_body.append(point)

    # The mass centre of a body with nothing but its joint.
    for joint in range(1, model.njoints):
        if not any(np.linalg.norm(point) > _SAME_POINT for point in points[joint]):
            points[joint].append(model.inertias[joint].lever)
    return points


def masses(model: pin.Model) -> Iterator[Shape]:
    """For each body, the homogeneous ellipsoid with the same mass m and inertia.

    An ellipsoid has the principal moments I_1 = m / 5 (a_2^2 + a_3^2), and so on. So the squares of
    its semi-axes are a_1^2 = 5 / (2 m) (I_2 + I_3 - I_1), and so on. The last factor is the sum of
    all moments minus 2 I_1.
    """
    for joint, inertia in enumerate(model.inertias):
        if inertia.mass <= 0 or joint == 0:
            continue
        moments, R = np.linalg.eigh(inertia.inertia)
        R[:, 2] *= np.sign(np.linalg.det(R))  # the axes become right-handed
        squares = 2.5 / inertia.mass * (moments.sum() - 2 * moments)
        if squares.max() <= 0:  # a point mass
            continue
        radii = np.sqrt(squares.clip(_THINNEST * squares.max()))
        at = homogeneous(R, inertia.lever)
        name = f"mass_{model.names[joint]}"
        mesh = ellipsoid(radii, fineness=2)
        yield Shape(str(joint), "inertia", name, mesh, _MASS, opacity=0.45, at=at)
