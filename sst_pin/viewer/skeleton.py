# SPDX-License-Identifier: BSD-2-Clause
"""The skeleton of a robot: its joints, lines between them, ends of loops; ellipsoids of masses."""

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
#: Points of a body that are closer are one point, [m].
_SAME_POINT = 1e-9
#: The least square of a semi-axis of an ellipsoid, relative to the largest, so that it has volume.
_THINNEST = 1e-4
#: Frames of fixed links and of points, such as a foot or a tool.
_ENDS = (pin.FrameType.BODY, pin.FrameType.OP_FRAME)


def skeleton(
    robot: ClosedChain, axes: Sequence[RateAxis], colours: Mapping[int, str], size: float
) -> Iterator[Shape]:
    """Joints, lines from each to the other points of its body, ends of loops, wheels.

    `axes` has the axis of each rate, `colours` the colours of joints by number.
    """
    yield from _lines(robot, size)
    yield from _joints(robot.mechanism.model, axes, colours, size)
    yield from _ends_of_loops(robot, size)
    yield from _wheels(robot)


def _lines(robot: ClosedChain, size: float) -> Iterator[Shape]:
    """Lines from the joint of each body, or for the base from the middle of its points."""
    for joint, points in enumerate(joined_points(robot)):
        hub = np.mean(points, axis=0) if joint == 0 and points else np.zeros(3)
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
        of_joint = [axis for axis in axes if axis.joint == joint]
        colour = colours.get(joint, _JOINT)
        carrier = joint
        at = np.eye(4)
        drawn: coal.ShapeBase = coal.Sphere(r)
        if len(of_joint) == 1:
            (axis,) = of_joint
            carrier = axis.mover
            at = homogeneous(along(axis.direction), axis.origin)
            drawn = coal.Cylinder(r, 3 * r) if axis.turns else coal.Box(2 * r, 2 * r, 3 * r)
        name = f"joint_{model.names[joint]}"
        yield Shape(str(carrier), "skeleton", name, solid(drawn), colour, at=at)


def _ends_of_loops(robot: ClosedChain, size: float) -> Iterator[Shape]:
    """Balls at the frames that closures connect."""
    ball = solid(coal.Sphere(_END_RADIUS * size))
    for end in _end_frames(robot):
        mover = str(end.parentJoint)
        at = end.placement.homogeneous
        yield Shape(mover, "skeleton", f"end_{end.name}", ball, _END, at=at)


def _wheels(robot: ClosedChain) -> Iterator[Shape]:
    """Wheels and balls that roll."""
    for closure in robot.closures:
        if isinstance(closure, Rolling):
            frame = frame_named(robot.mechanism.model, closure.wheel)
            r = closure.radius
            wheel = coal.Sphere(r) if closure.ball else coal.Cylinder(r, 0.1 * r)
            mover = str(frame.parentJoint)
            at = frame.placement.homogeneous
            yield Shape(mover, "skeleton", f"wheel_{frame.name}", solid(wheel), GREY, 0.5, at)


def _end_frames(robot: ClosedChain) -> Iterator[pin.Frame]:
    """The frames that closures hold together or at a distance."""
    for closure in robot.closures:
        if isinstance(closure, (Closure, Distance)):
            for name in (closure.frame_a, closure.frame_b):
                yield frame_named(robot.mechanism.model, name)


def joined_points(robot: ClosedChain) -> list[list[Array]]:
    """Points that each body connects: joints, ends of loops, feet; or its mass centre if none.

    Positions are in the frame of the body's joint; the points of the base come first.
    """
    model = robot.mechanism.model
    points: list[list[Array]] = [[] for _ in model.joints]

    # Joints on a body, and ends of loops.
    for joint in range(1, model.njoints):
        points[model.parents[joint]].append(model.jointPlacements[joint].translation)
    for end in _end_frames(robot):
        points[end.parentJoint].append(end.placement.translation)

    # Fixed links and points of moving bodies, where no point is yet.
    for frame in model.frames:
        on_body = points[frame.parentJoint]
        point = frame.placement.translation
        is_known = any(np.linalg.norm(point - other) < _SAME_POINT for other in on_body)
        if frame.parentJoint and frame.type in _ENDS and not is_known:
            on_body.append(point)

    # The mass centre of a body with nothing but its joint.
    for joint in range(1, model.njoints):
        if not any(np.linalg.norm(point) > _SAME_POINT for point in points[joint]):
            points[joint].append(model.inertias[joint].lever)
    return points


def masses(model: pin.Model) -> Iterator[Shape]:
    """The homogeneous ellipsoid of the same mass and inertia as each body.

    Its semi-axes a_i follow from the principal moments of inertia,
    a_1^2 = 5 / (2 m) (I_2 + I_3 - I_1), and so on.
    """
    for joint, inertia in enumerate(model.inertias):
        if inertia.mass <= 0 or joint == 0:
            continue
        moments, R = np.linalg.eigh(inertia.inertia)
        R[:, 2] *= np.sign(np.linalg.det(R))
        squares = 2.5 / inertia.mass * (moments.sum() - 2 * moments)
        if squares.max() <= 0:  # a point
            continue
        radii = np.sqrt(squares.clip(_THINNEST * squares.max()))
        at = homogeneous(R, inertia.lever)
        name = f"mass_{model.names[joint]}"
        yield Shape(str(joint), "inertia", name, ellipsoid(radii, 2), _MASS, 0.45, at)
