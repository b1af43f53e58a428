# SPDX-License-Identifier: BSD-2-Clause
"""The drawing of a robot without shapes: joints, lines between them, masses."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import coal
import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..chain.closed_chain import ClosedChain
from ..chain.closures import Closure, Distance, Rolling
from ..chain.lines import LineForce
from ..chain.tree import frame_named
from ..description.colours import HUES
from .joints import Axis
from .scene_parts import Shape, Strut, along, homogeneous
from .triangles import Mesh, ellipsoid, solid, tube

_BONE, _JOINT, _END, _MASS = "#8A9199", "#5C656E", "#B3261E", "#C98A2B"
#: Radii as shares of the robot's length.
_BONE_RADIUS, _JOINT_RADIUS, _END_RADIUS = 0.022, 0.055, 0.04
#: Turns of the coil of a spring.
_TURNS = 8
#: Frames of fixed links and of points, such as a foot or a tool.
_ENDS = (pin.FrameType.BODY, pin.FrameType.OP_FRAME)


def skeleton(
    robot: ClosedChain, axes: Sequence[Axis], colours: Mapping[int, str], size: float
) -> Iterator[Shape]:
    """Joints, straight lines from each to what follows on the same body, ends of the loops.

    `axes` are those of all rates, `colours` those of joints by number.
    """
    model = robot.mechanism.model
    for joint, points in enumerate(points_of(robot)):
        hub = np.mean(points, axis=0) if joint == 0 and points else np.zeros(3)
        for i, point in enumerate(points):
            if np.linalg.norm(point - hub) > 1e-9:
                line = tube([hub, point], _BONE_RADIUS * size)
                yield Shape(str(joint), "skeleton", f"bone_{i}", line, _BONE)
    for joint in range(1, model.njoints):
        own = [axis for axis in axes if axis.joint == joint]
        colour, r = colours.get(joint, _JOINT), _JOINT_RADIUS * size
        carrier, at = joint, np.eye(4)
        drawn: coal.ShapeBase = coal.Sphere(r)
        if len(own) == 1:
            (axis,) = own
            carrier, at = axis.mover, homogeneous(along(axis.direction), axis.origin)
            drawn = coal.Cylinder(r, 3 * r) if axis.turns else coal.Box(2 * r, 2 * r, 3 * r)
        name = f"joint_{model.names[joint]}"
        yield Shape(str(carrier), "skeleton", name, solid(drawn), colour, at=at)
    for closure in robot.closures:
        if isinstance(closure, (Closure, Distance)):
            for name in (closure.frame_a, closure.frame_b):
                frame = frame_named(model, name)
                mesh = solid(coal.Sphere(_END_RADIUS * size))
                at = frame.placement.homogeneous
                yield Shape(str(frame.parentJoint), "skeleton", f"end_{name}", mesh, _END, at=at)
        elif isinstance(closure, Rolling):
            frame, r = frame_named(model, closure.wheel), closure.radius
            wheel = coal.Sphere(r) if closure.ball else coal.Cylinder(r, 0.1 * r)
            at = frame.placement.homogeneous
            mover, name = str(frame.parentJoint), f"wheel_{closure.wheel}"
            yield Shape(mover, "skeleton", name, solid(wheel), _BONE, 0.5, at)


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
        radii = np.sqrt(squares.clip(1e-4 * squares.max()))
        at = homogeneous(R, inertia.lever)
        name = f"mass_{model.names[joint]}"
        yield Shape(str(joint), "inertia", name, ellipsoid(radii, 2), _MASS, 0.45, at)


def struts(robot: ClosedChain, axes: Sequence[Axis], size: float) -> Iterator[Strut]:
    """Rods of `Distance` closures, forces along lines, and rails of sliding joints."""
    line = tube([(0, 0, 0), (0, 0, 1)], _BONE_RADIUS * size)
    rods = [closure for closure in robot.closures if isinstance(closure, Distance)]
    drawn: list[tuple[Distance | LineForce, Shape]] = list(_lines(robot, size))
    drawn += [(x, Shape(f"rod_{k}", "bodies", "rod", line, _BONE)) for k, x in enumerate(rods)]
    for ends, shape in drawn:
        frames = [frame_named(robot.mechanism.model, name) for name in (ends.frame_a, ends.frame_b)]
        a, b = (int(frame.parentJoint) for frame in frames)
        points = np.array([frame.placement.translation for frame in frames])
        yield Strut(shape, (a, b), points)
    thin = Mesh(line.vertices * (0.6, 0.6, 1), line.faces)
    for axis in axes:
        if not axis.turns and axis.mover != axis.joint:
            shape = Shape(f"rail_{axis.joint}", "skeleton", "rail", thin, _BONE)
            yield Strut(shape, (axis.mover, axis.joint), np.stack([axis.origin, np.zeros(3)]))


def _lines(robot: ClosedChain, size: float) -> Iterator[tuple[LineForce, Shape]]:
    """A motor on a line as a cylinder with its rod, a spring as a coil, others as a thin line."""
    r, z = _BONE_RADIUS * size, np.linspace(0, 1, 12 * _TURNS + 1)
    turn = 2 * np.pi * _TURNS * z
    coil = np.stack([2 * r * np.cos(turn), 2 * r * np.sin(turn), z], axis=1)
    for k, line in enumerate(robot.forces):
        motors, colour = np.flatnonzero(robot.mechanism.lines.motors[k]), _BONE
        mesh = tube([(0, 0, 0), (0, 0, 1)], 0.4 * r)
        if len(motors):
            ends = [(0, 0, x) for x in (0, 0.6, 0.6, 1)]
            mesh, colour = tube(ends, [1.8 * r, 1.8 * r, 0.8 * r, 0.8 * r]), HUES[motors[0] % 6]
        elif line.stiffness:
            mesh = tube(coil, 0.4 * r, 6)
        yield line, Shape(f"line_{k}", "bodies", f"line {line}", mesh, colour)


def points_of(robot: ClosedChain) -> list[list[Array]]:
    """Points that each body connects: joints, ends of loops, feet; without these its mass centre.

    They are in the axes of the body's joint, those of the base first.
    """
    model = robot.mechanism.model
    points: list[list[Array]] = [[] for _ in model.joints]
    for joint in range(1, model.njoints):
        points[model.parents[joint]].append(model.jointPlacements[joint].translation)
    for closure in robot.closures:
        if isinstance(closure, (Closure, Distance)):
            for name in (closure.frame_a, closure.frame_b):
                frame = frame_named(model, name)
                points[frame.parentJoint].append(frame.placement.translation)
    for frame in model.frames:
        own, point = points[frame.parentJoint], frame.placement.translation
        seen = any(np.linalg.norm(point - other) < 1e-9 for other in own)
        if frame.parentJoint and frame.type in _ENDS and not seen:
            own.append(point)
    for joint in range(1, model.njoints):
        if not any(np.linalg.norm(p) > 1e-9 for p in points[joint]):
            points[joint].append(model.inertias[joint].lever)
    return points
