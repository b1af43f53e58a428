# SPDX-License-Identifier: BSD-2-Clause
"""Drawings beside the bodies: skeleton, masses, rods; axes, frames, arrows of forces."""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..closed_chain import ClosedChain
from ..description.colours import HUES
from ..model.appearance import PLATFORM, DrawnFrame
from ..model.closures import Brake, Closure, Coupling, Distance, Rolling, frames_of
from ..model.contacts import Rope
from ..model.lines import LineForce
from ..model.tree import frame_named
from .scene_parts import Arrow, Dot, Label, Mesh, Pull, Shape, Strut, Touch, along, homogeneous
from .triangles import arrow, circle, ellipsoid, solid, tube

_BONE = "#8A9199"
_JOINT = "#5C656E"
_END = "#B3261E"
_MASS = "#C98A2B"
_FORCE = "#263238"
_CONTACT = "#00796B"
#: Colours of the axes x, y, z of a frame.
_XYZ = ("#C0392B", "#27AE60", "#2E5FA8")
#: Radii as shares of the robot's length.
_BONE_RADIUS = 0.022
_JOINT_RADIUS = 0.055
_END_RADIUS = 0.04
#: Radius of the point of a contact, and of a sphere that would hide the arrow of its contact, as
#: shares of the largest arrow's scale.
_CONTACT_RADIUS = 0.08
_HIDING = 0.2
#: Turns of the coil of a spring.
_TURNS = 8
#: Frames of fixed links and of points, such as a foot or a tool.
_ENDS = (pin.FrameType.BODY, pin.FrameType.OP_FRAME)


class Axis(NamedTuple):
    """The axis of one rate of a joint."""

    joint: int
    mover: int  #: Number of the joint whose body carries the axis.
    turns: bool  #: Whether the joint turns about it rather than sliding along it.
    direction: Array  #: Unit vector in the axes of this body.
    origin: Array  #: A point of it on this body, close to the joint's frame (at position 0), [m].


def axes_of(model: pin.Model, data: pin.Data, q: Array) -> list[Axis]:
    """The axis of each rate, in the order of v.

    The axis of a joint with one rate is fixed to its parent's body. Axes of other joints are drawn
    on the body that the joint moves, for the configuration q.
    """
    J = pin.computeJointJacobians(model, data, q).reshape(6, -1)
    axes = []
    for number in range(1, model.njoints):
        joint = model.joints[number]
        single = joint.nv == 1
        mover = int(model.parents[number]) if single else number
        place = data.oMi[mover]
        joint_origin = data.oMi[number].translation
        for k in range(joint.idx_v, joint.idx_v + joint.nv):
            # The twist of a rate of 1, at the origin of the joint's frame.
            w = J[3:, k]
            v = J[:3, k] + np.cross(w, joint_origin)
            turns = bool(np.linalg.norm(w) > 1e-9)
            if turns:
                direction = w
                origin = place.actInv(joint_origin + np.cross(w, v) / (w @ w))
            else:
                direction = v
                origin = model.jointPlacements[number].translation if single else np.zeros(3)
            direction = place.rotation.T @ (direction / np.linalg.norm(direction))
            axes.append(Axis(number, mover, turns, direction, origin))
    return axes


def skeleton(
    robot: ClosedChain, axes: Sequence[Axis], colours: Mapping[int, str], size: float
) -> Iterator[Shape]:
    """Joints, lines from each to the other points of its body, ends of loops, wheels.

    `axes` has the axis of each rate, `colours` the colours of joints by number.
    """
    # Lines from the joint of a body, or for the base from their middle.
    model = robot.mechanism.model
    for joint, points in enumerate(joined_points(robot)):
        hub = np.mean(points, axis=0) if joint == 0 and points else np.zeros(3)
        for i, point in enumerate(points):
            if np.linalg.norm(point - hub) > 1e-9:
                line = tube([hub, point], _BONE_RADIUS * size)
                yield Shape(str(joint), "skeleton", f"bone_{i}", line, _BONE)
    # Joints: a cylinder about the axis of a hinge, a box along a slide, spheres for others.
    for joint in range(1, model.njoints):
        of_joint = [axis for axis in axes if axis.joint == joint]
        colour = colours.get(joint, _JOINT)
        r = _JOINT_RADIUS * size
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
    # Ends of loops, and wheels.
    ball = solid(coal.Sphere(_END_RADIUS * size))
    for end in _ends(robot):
        mover = str(end.parentJoint)
        at = end.placement.homogeneous
        yield Shape(mover, "skeleton", f"end_{end.name}", ball, _END, at=at)
    for closure in robot.closures:
        if isinstance(closure, Rolling):
            frame = frame_named(model, closure.wheel)
            r = closure.radius
            wheel = coal.Sphere(r) if closure.ball else coal.Cylinder(r, 0.1 * r)
            mover = str(frame.parentJoint)
            at = frame.placement.homogeneous
            yield Shape(mover, "skeleton", f"wheel_{frame.name}", solid(wheel), _BONE, 0.5, at)


def _ends(robot: ClosedChain) -> Iterator[pin.Frame]:
    """The frames that closures hold together or at a distance."""
    for closure in robot.closures:
        if isinstance(closure, (Closure, Distance)):
            for name in (closure.frame_a, closure.frame_b):
                yield frame_named(robot.mechanism.model, name)


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
    """Rods of `Distance` closures, ropes, forces along lines, and rails of sliding joints."""
    # What is drawn between two frames, with its shape.
    line = tube([(0, 0, 0), (0, 0, 1)], _BONE_RADIUS * size)
    rods = [closure for closure in robot.closures if isinstance(closure, Distance)]
    drawn: list[tuple[Distance | LineForce | Rope, Shape]] = list(_lines(robot, size))
    for k, rod in enumerate(rods):
        drawn.append((rod, Shape(f"rod_{k}", "bodies", "rod", line, _BONE)))
    cord = Mesh(line.vertices * (0.3, 0.3, 1), line.faces)
    for k, rope in enumerate(robot.mechanism.contacts.ropes):
        drawn.append((rope, Shape(f"rope_{k}", "bodies", f"rope {rope}", cord, _BONE)))
    for ends, shape in drawn:
        a = frame_named(robot.mechanism.model, ends.frame_a)
        b = frame_named(robot.mechanism.model, ends.frame_b)
        points = np.stack([a.placement.translation, b.placement.translation])
        yield Strut(shape, (int(a.parentJoint), int(b.parentJoint)), points)
    # Rails, from the axis of a slide to its body.
    thin = Mesh(line.vertices * (0.6, 0.6, 1), line.faces)
    for axis in axes:
        if not axis.turns and axis.mover != axis.joint:
            shape = Shape(f"rail_{axis.joint}", "skeleton", "rail", thin, _BONE)
            yield Strut(shape, (axis.mover, axis.joint), np.stack([axis.origin, np.zeros(3)]))


def _lines(robot: ClosedChain, size: float) -> Iterator[tuple[LineForce, Shape]]:
    """A motor on a line as a cylinder with its rod, a spring as a coil, others as a thin line."""
    r = _BONE_RADIUS * size
    z = np.linspace(0, 1, 12 * _TURNS + 1)
    coil = 2 * r * circle(2 * np.pi * _TURNS * z) + np.outer(z, (0, 0, 1))
    for k, line in enumerate(robot.lines):
        motors = np.flatnonzero(robot.mechanism.lines.actuation[k])
        colour = _BONE
        mesh = tube([(0, 0, 0), (0, 0, 1)], 0.4 * r)
        if len(motors):
            ends = [(0, 0, x) for x in (0, 0.6, 0.6, 1)]
            mesh = tube(ends, [1.8 * r, 1.8 * r, 0.8 * r, 0.8 * r])
            colour = HUES[motors[0] % 6]
        elif line.stiffness:
            mesh = tube(coil, 0.4 * r, 6)
        yield line, Shape(f"line_{k}", "bodies", f"line {line}", mesh, colour)


def joined_points(robot: ClosedChain) -> list[list[Array]]:
    """Points that each body connects: joints, ends of loops, feet; or its mass centre if none.

    Positions are in the frame of the body's joint; the points of the base come first.
    """
    model = robot.mechanism.model
    points: list[list[Array]] = [[] for _ in model.joints]
    for joint in range(1, model.njoints):
        points[model.parents[joint]].append(model.jointPlacements[joint].translation)
    for end in _ends(robot):
        points[end.parentJoint].append(end.placement.translation)
    for frame in model.frames:
        on_body = points[frame.parentJoint]
        point = frame.placement.translation
        seen = any(np.linalg.norm(point - other) < 1e-9 for other in on_body)
        if frame.parentJoint and frame.type in _ENDS and not seen:
            on_body.append(point)
    for joint in range(1, model.njoints):
        if not any(np.linalg.norm(p) > 1e-9 for p in points[joint]):
            points[joint].append(model.inertias[joint].lever)
    return points


def arrows_of(
    model: pin.Model, data: pin.Data, axes: list[Axis], B: Array, size: float
) -> Iterator[Arrow]:
    """Arrows of the motor torques, at the joints that the motors act on by B, shape (nv, motors).

    `data` is at the configuration of the axes; `size` is the length of the largest arrow, [m].
    """
    turn = np.linspace(0, np.radians(250), 40)
    torque = arrow(circle([*turn, turn[-1] + 0.6]), 0.055)
    force = arrow(np.outer((0, 0.7, 1), (0, 0, 2.0)), 0.055)
    driven = [axes[i] for i in np.flatnonzero(B.any(axis=1))]
    places_of_motors = np.array([data.oMi[axis.mover].act(axis.origin) for axis in driven])
    for i, motor in np.argwhere(B):
        axis = axes[i]
        share = B[i, motor] / np.abs(B[:, motor]).max()
        R = along(axis.direction)
        origin = axis.origin
        place = data.oMi[axis.mover].act(origin)
        distances = np.linalg.norm(places_of_motors - place, axis=1)
        if not axis.turns:  # beside what slides
            origin = origin + 0.35 * size * R[:, 0]
        elif (
            np.count_nonzero(distances < 0.1 * size) > 1
        ):  # motors that meet, as of spherical robots
            origin = origin - 0.93 * size * axis.direction
        matrix = homogeneous(size * R, origin)
        name = f"{motor + 1}_{model.names[axis.joint]}"
        if axis.turns:
            mesh = torque
            mirror = (1.0, -1.0, 1.0)
        else:
            mesh = force
            mirror = (1.0, 1.0, -1.0)
        colour = HUES[motor % len(HUES)]
        shape = Shape(str(axis.mover), "torques", name, mesh, colour, at=matrix)
        yield Arrow(shape, int(motor), float(share), mirror)


def pulls_of(robot: ClosedChain, size: float) -> Iterator[Pull]:
    """Arrows of the forces of `reactions`: of parents on children in joints, of A on B in closures.

    `size` is the length of the largest arrow, [m].
    """
    model = robot.mechanism.model
    mesh = arrow(np.outer((0, 0.7, 1), (0, 0, 2.0)), 0.04)
    places = [(j, np.eye(4)) for j in range(1, model.njoints)]
    for closure in robot.closures:
        if isinstance(closure, (Coupling, Brake)):  # which have no place
            places.append((0, np.zeros((4, 4))))
        else:
            frame = frame_named(model, frames_of(closure)[1])
            places.append((frame.parentJoint, frame.placement.homogeneous))
    for k, (joint, at) in enumerate(places):
        if at.any():
            largest = at @ np.diag([size, size, size, 1.0])
            shape = Shape(str(joint), "reactions", f"{k}", mesh, _FORCE, at=largest)
            yield Pull(shape, len(robot.motor_names) + 3 * k)


def touches_of(robot: ClosedChain) -> list[Touch]:
    """The places of all contacts, in their order."""
    model = robot.mechanism.model
    touches = []
    for k, contact in enumerate(robot.mechanism.contacts.points):
        touch = Touch(
            node=f"contact_{k}",
            frame=frame_named(model, contact.frame),
            ground=frame_named(model, contact.ground),
            radius=contact.radius,
        )
        touches.append(touch)
    return touches


def contact_shapes(touches: Sequence[Touch]) -> Iterator[Shape]:
    """The spheres of contacts."""
    for touch in touches:
        if touch.radius > 0:
            mover = str(touch.frame.parentJoint)
            at = touch.frame.placement.homogeneous
            ball = solid(coal.Sphere(touch.radius))
            yield Shape(mover, "contacts", f"sphere_{touch.node}", ball, _BONE, 0.5, at)


def contact_forces_of(touches: Sequence[Touch], first: int, size: float) -> Iterator[Pull | Dot]:
    """A point and an arrow for each contact that acts: the force of the ground on the body.

    The arrow starts at the point; at a large sphere it ends there, because the sphere would hide
    it. `first` is the index of the first force in the effort, `size` the scale of the largest
    arrow.
    """
    length = 2.0
    mesh = arrow(np.outer((0, 0.7, 1), (0, 0, length)), 0.04)
    ball = solid(coal.Sphere(_CONTACT_RADIUS * size))
    largest = np.diag([size, size, size, 1.0])
    for k, touch in enumerate(touches):
        force = Shape(touch.node, "contacts", "force", mesh, _CONTACT, at=largest)
        start = length if touch.radius > _HIDING * size else 0.0
        yield Pull(force, first + 3 * k, start)
        yield Dot(Shape(touch.node, "contacts", "point", ball, _CONTACT), first + 3 * k)


def labelled(
    robot: ClosedChain, axes: Sequence[Axis], point: DrawnFrame | None, size: float
) -> tuple[list[Shape], list[Label]]:
    """Axes of the joints and frames, with their labels; the path of `point` is drawn."""
    shapes = list[Shape]()
    labels = list[Label]()
    appearance = robot.appearance
    length = appearance.axis_length * size
    line = arrow(np.outer((0, 0.95, 1), (0, 0, length)), 0.007 * size)
    for i, (axis, (name, colour)) in enumerate(zip(axes, appearance.axes, strict=True)):
        mover = str(axis.mover)
        at = homogeneous(along(axis.direction), axis.origin)
        tip = 1.06 * length * axis.direction
        shapes.append(Shape(mover, "axes", f"{name}_{i}", line, colour, at=at))
        labels.append(Label(name, colour, "axes", mover, axis.origin + tip))
    triad = [arrow(np.outer((0, 0.75, 1), 0.17 * size * x), 0.006 * size) for x in np.eye(3)]
    for name, joint, place, colour in appearance.frames:
        for letter, mesh, shade in zip("xyz", triad, _XYZ, strict=True):
            at = place.homogeneous
            shapes.append(Shape(str(joint), "frames", f"{name}_{letter}", mesh, shade, at=at))
        tip = place.act(np.array((0, 0, 0.2 * size)))
        labels.append(Label(name, colour, "frames", str(joint), tip))
    if point is not None and point.name != PLATFORM:  # which is seen without its name
        name, joint, place, colour = point
        labels.append(Label(name, colour, "trail", str(joint), 1.2 * place.translation))
    return shapes, labels
