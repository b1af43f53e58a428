# SPDX-License-Identifier: BSD-2-Clause
"""Shapes without mass for the joints and closures of a robot: pins, balls, sleeves, rails, feet."""

from collections.abc import Sequence
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..model.closures import Closure, Constraint
from ..model.tree import frame_named
from .placements import HERE, rotation_z_to, shift

#: Colours of joints, of motors, and of the feet on the ground.
_STEEL = np.array([0.25, 0.28, 0.32, 1.0])
_MOTOR = np.array([0.1, 0.45, 0.7, 1.0])
_GROUND = np.array([0.4, 0.36, 0.32, 1.0])
#: Kinds of closures that are drawn as balls, and as pins.
_BALLS = ("3d", "universal")
_PINS = ("hinge", "cylindrical")


class _Part(NamedTuple):
    """A shape on the body of a joint, 0 for the base."""

    body: int
    at: pin.SE3
    shape: coal.ShapeBase


def joint_shapes(
    model: pin.Model,
    links: pin.GeometryModel,
    closures: Sequence[Constraint],
    motors: Sequence[str],
) -> list[pin.GeometryObject]:
    """Pins, balls and sleeves for the joints and closures, and feet on the ground.

    Sizes are multiples of the radius of the links at the joint.

    Args:
        model: The tree, with the configuration `home`.
        links: The shapes of its links, which give the sizes of the joints.
        closures: The closures.
        motors: Names of the joints with a motor, which have another colour.
    """
    shapes: list[pin.GeometryObject] = []

    def add(name: str, part: _Part, colour: Array) -> None:
        """Add a shape with a colour, under a name with a number."""
        full_name = f"joint_{len(shapes)}_{name}"
        shape = pin.GeometryObject(full_name, part.body, part.at, part.shape)
        shape.meshColor = colour
        shapes.append(shape)

    radii = _link_radii(links, model.njoints)
    for number in range(1, model.njoints):
        r = radii[number]
        name = model.names[number]
        joint_part = _joint_part(model, links, number, r)
        if joint_part is not None:
            add(name, joint_part, _MOTOR if name in motors else _STEEL)
        foot = _foot(model, links, number, r)
        if foot is not None:
            add("ground", foot, _GROUND)
    for closure in closures:
        if isinstance(closure, Closure):  # a distance has no shape
            frame = frame_named(model, closure.frame_a)
            closure_part = _closure_part(closure, frame, radii[frame.parentJoint])
            if closure_part is not None:
                add(closure.frame_a, closure_part, _STEEL)
    return shapes


def _twists(model: pin.Model, number: int) -> Array:
    """Twists [linear; angular] of the rates of a joint at home, shape (6, rates)."""
    joint = model.joints[number]
    data = joint.createData()
    joint.calc(data, model.referenceConfigurations["home"])
    return np.reshape(data.S, (6, joint.nv))


def _only_turns(model: pin.Model, number: int) -> bool:
    """Whether a joint is a hinge, a universal joint or a ball: all its rates turn its body."""
    angular = _twists(model, number)[3:]
    return bool((np.linalg.norm(angular, axis=0) > 0).all())


def _joint_part(model: pin.Model, links: pin.GeometryModel, number: int, r: float) -> _Part | None:
    """The shape of a joint, with sizes in multiples of the radius r of its links; else None.

    Free-flyers and planar joints have no shape.
    """
    joint = model.joints[number]
    parent = model.parents[number]
    placement = model.jointPlacements[number]
    twists = _twists(model, number)
    if _only_turns(model, number):
        if joint.nv == 1:  # a pin, where the links are
            at = _pin_centre(model, links, number) * _along(twists[3:, 0])
            return _Part(number, at, coal.Cylinder(1.3 * r, 5 * r))
        return _Part(number, HERE, coal.Sphere(1.7 * r))  # a ball or a universal joint
    if joint.nv > 1:
        return None
    axis = twists[:3, 0]
    if parent == 0:  # a rail on the ground
        position = model.referenceConfigurations["home"][joint.idx_q]
        at = placement * shift(axis * position) * _along(axis)
        return _Part(parent, at, coal.Cylinder(0.8 * r, 24 * r))
    return _Part(parent, placement * _along(axis), coal.Cylinder(1.6 * r, 8 * r))  # a sleeve


def _foot(model: pin.Model, links: pin.GeometryModel, number: int, r: float) -> _Part | None:
    """A foot on the ground at a joint of the base that only turns; else None."""
    if model.parents[number] != 0 or not _only_turns(model, number):
        return None
    joint = model.joints[number]
    data = joint.createData()
    joint.calc(data, model.referenceConfigurations["home"])
    at = model.jointPlacements[number] * data.M
    if joint.nv == 1:
        at = at * _pin_centre(model, links, number)
    return _Part(0, at, coal.Box(4 * r, 4 * r, 4 * r))


def _closure_part(closure: Closure, frame: pin.Frame, r: float) -> _Part | None:
    """The shape of a closure at its frame A; None for kinds without one."""
    if closure.kind in _BALLS:
        return _Part(frame.parentJoint, frame.placement, coal.Sphere(1.7 * r))
    if closure.kind in _PINS:
        return _Part(frame.parentJoint, frame.placement, coal.Cylinder(1.3 * r, 5 * r))
    return None


def _along(axis: Array) -> pin.SE3:
    """A placement at the origin whose z axis is along an axis."""
    return pin.SE3(rotation_z_to(axis), np.zeros(3))


def _pin_centre(model: pin.Model, links: pin.GeometryModel, number: int) -> pin.SE3:
    """The place of a hinge's pin on its body: the point of the axis nearest to the end of a link.

    The axis passes through the body's origin. Links are cylinders along their own z axes.
    """
    axis = _twists(model, number)[3:, 0]
    ends: list[Array] = []
    for link in links.geometryObjects:
        if link.parentJoint == number and isinstance(link.geometry, coal.Cylinder):
            half = link.geometry.halfLength
            ends.append(link.placement.act(np.array([0, 0, -half])))
            ends.append(link.placement.act(np.array([0, 0, half])))
    if not ends:
        return HERE
    along_axis = np.array(ends) @ axis
    distances = np.linalg.norm(np.array(ends) - along_axis[:, None] * axis, axis=1)
    # Rounded, so that rounding errors do not decide between ends at the same distance: the first
    # one is taken.
    nearest = np.argmin(distances.round(9))
    return shift(along_axis[nearest] * axis)


def _link_radii(links: pin.GeometryModel, joints: int) -> Array:
    """Radius of the thickest link of each body, at most twice the median, shape (joints,), [m].

    The radius of a box, and of a flat disc, is half of its least size.
    """
    radii_of_bodies: list[list[float]] = [[] for _ in range(joints)]
    for link in links.geometryObjects:
        shape = link.geometry
        size = shape.halfSide if isinstance(shape, coal.Box) else (shape.radius, shape.halfLength)
        radii_of_bodies[link.parentJoint].append(float(min(size)))
    median = float(np.median(np.concatenate(radii_of_bodies)))
    thickest = [max(radii, default=median) for radii in radii_of_bodies]
    return np.minimum(thickest, 2 * median)
