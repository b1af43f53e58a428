# SPDX-License-Identifier: BSD-2-Clause
"""Building blocks of the gallery: solids with mass and shape, and the tree that they hang on."""

from collections.abc import Sequence
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array
from ..model.closures import Closure, Constraint
from ..model.tree import frame_named
from .placements import HERE, shift

_GREY = np.array([0.55, 0.6, 0.65, 1.0])
_ORANGE = np.array([0.95, 0.55, 0.15, 1.0])
#: Colours of pins and balls of joints, of motors, and of the feet on the ground.
_STEEL = np.array([0.25, 0.28, 0.32, 1.0])
_MOTOR = np.array([0.1, 0.45, 0.7, 1.0])
_GROUND = np.array([0.4, 0.36, 0.32, 1.0])
#: Kinds of closures that are drawn as balls.
_BALLS = ("3d", "universal")


class Solid(NamedTuple):
    """A homogeneous solid, its inertia and its shape about its centre, placed on a body."""

    inertia: pin.Inertia
    shape: coal.ShapeBase
    at: pin.SE3


Solids = list[Solid]


def rods(mass: float, points: ArrayLike, radius: float) -> Solids:
    """Round rods of one radius along a line of points, shape (n, 3); total mass; SI units."""
    points = np.asarray(points, dtype=float)
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    solids = []
    for start, step, length in zip(points, steps, lengths, strict=False):
        inertia = pin.Inertia.FromCylinder(mass * length / lengths.sum(), radius, length)
        at = pin.SE3(_z_along(step), start + step / 2)
        solids.append(Solid(inertia, coal.Cylinder(radius, length), at))
    return solids


def rod(mass: float, end: ArrayLike, radius: float) -> Solids:
    """A round rod from the origin to a point."""
    return rods(mass, np.stack([np.zeros(3), end]), radius)


def bar(mass: float, length: float, radius: float) -> Solids:
    """A round rod from the origin along x."""
    return rod(mass, (length, 0, 0), radius)


def star(mass: float, points: ArrayLike, radius: float) -> Solids:
    """Rods of equal mass from the centre of some points to each of them; total mass."""
    ends = np.asarray(points, dtype=float)
    centre = ends.mean(axis=0)
    solids = []
    for end in ends:
        solids += rods(mass / len(ends), [centre, end], radius)
    return solids


def arc(mass: float, angle: float, radius: float, thickness: float) -> Solids:
    """Four rods along an arc about x that begins on the z axis; `thickness` is their radius."""
    turns = np.linspace(0, angle, 5)
    points = radius * np.stack([0 * turns, -np.sin(turns), np.cos(turns)], axis=1)
    return rods(mass, points, thickness)


def box(mass: float, size: ArrayLike, centre: ArrayLike = (0, 0, 0)) -> Solids:
    """A box along the axes, edges and centre of shape (3,)."""
    x, y, z = np.asarray(size, dtype=float)
    at = pin.SE3(np.eye(3), np.asarray(centre, dtype=float))
    return [Solid(pin.Inertia.FromBox(mass, x, y, z), coal.Box(x, y, z), at)]


def disc(mass: float, radius: float, thickness: float) -> Solids:
    """A round plate about the z axis, its centre at the origin; [kg], [m], [m]."""
    inertia = pin.Inertia.FromCylinder(mass, radius, thickness)
    return [Solid(inertia, coal.Cylinder(radius, thickness), HERE)]


def body(
    mass: float, centre: ArrayLike, moments: ArrayLike, points: ArrayLike, radius: float
) -> Solids:
    """A body of known inertia about its mass centre, drawn as rods along a line."""
    inertia = pin.Inertia(mass, shift(centre).translation, np.diag(moments))
    solids = []
    for solid in rods(1.0, points, radius):
        solids.append(solid._replace(inertia=pin.Inertia.Zero()))
    first = solids[0]
    solids[0] = first._replace(inertia=first.at.actInv(inertia))
    return solids


class Tree:
    """A Pinocchio tree under construction, weight along -z, with the shapes of its bodies.

    Each method adds a part or a number to the tree.
    """

    def __init__(self, name: str) -> None:
        self.model = pin.Model()
        self.visual_model = pin.GeometryModel()
        self.model.name = name

    def joint(
        self,
        name: str,
        kind: pin.JointModel,
        solids: Solids,
        parent: str = "universe",
        at: pin.SE3 = HERE,
    ) -> None:
        """Add a joint on its parent's body ("universe" is the base), and the body that it moves."""
        joint = self.model.addJoint(self.model.getJointId(parent), kind, at, name)
        for i, solid in enumerate(solids):
            self.model.appendBodyToJoint(joint, solid.inertia, solid.at)
            shape = pin.GeometryObject(f"{name}_{i}", joint, solid.at, solid.shape)
            shape.meshColor = _GREY
            self.visual_model.addGeometryObject(shape)

    def limits(self, name: str, low: float, high: float) -> None:
        """Limit the position of a joint with one rate, [rad] or [m]."""
        i = self.model.joints[self.model.getJointId(name)].idx_q
        self.model.lowerPositionLimit[i] = low
        self.model.upperPositionLimit[i] = high

    def hinge(
        self, name: str, solids: Solids, parent: str = "universe", at: pin.SE3 = HERE
    ) -> None:
        """Add a joint that turns about z, and its body."""
        self.joint(name, pin.JointModelRZ(), solids, parent, at)

    def frame(self, name: str, body: str, at: ArrayLike | pin.SE3) -> None:
        """Add a frame on a joint's body at a placement, or at an origin along the body's axes."""
        placement = at if isinstance(at, pin.SE3) else shift(at)
        joint = self.model.getJointId(body)
        self.model.addFrame(pin.Frame(name, joint, placement, pin.FrameType.OP_FRAME))

    def platform(self, body: str, at: ArrayLike | pin.SE3 = (0, 0, 0)) -> None:
        """Make a body the platform, with the frame "platform"."""
        self.frame("platform", body, at)
        for shape in self.visual_model.geometryObjects:
            if shape.parentJoint == self.model.getJointId(body):
                shape.meshColor = _ORANGE


def joint_shapes(
    tree: Tree, closures: Sequence[Constraint], motors: Sequence[str]
) -> list[pin.GeometryObject]:
    """Pins, balls and sleeves for the joints and closures, and feet on the ground, without mass."""
    # Sizes are multiples of r, the thickness of the links at a joint.
    model = tree.model
    links = tree.visual_model
    shapes: list[pin.GeometryObject] = []
    home = model.referenceConfigurations["home"]
    thicknesses = _thicknesses(links, model.njoints)

    def add(name: str, joint: int, at: pin.SE3, shape: coal.ShapeBase, colour: Array) -> None:
        part = pin.GeometryObject(f"joint_{len(shapes)}_{name}", joint, at, shape)
        part.meshColor = colour
        shapes.append(part)

    # Joints of the tree.
    for number in range(1, model.njoints):
        joint = model.joints[number]
        name = model.names[number]
        parent = model.parents[number]
        placement = model.jointPlacements[number]
        colour = _MOTOR if name in motors else _STEEL
        r = thicknesses[number]
        data = joint.createData()
        joint.calc(data, home)
        S = np.reshape(data.S, (6, joint.nv))  # twists [linear; angular] of the joint's rates
        only_rotates = bool((np.linalg.norm(S[3:], axis=0) > 0).all()) and joint.nv < 6
        origin = HERE
        if joint.nv == 1 and only_rotates:  # a pin, where the links are
            axis = S[3:, 0]
            origin = shift(_nearest_on_axis(axis, links, number))
            along_axis = pin.SE3(_z_along(axis), np.zeros(3))
            add(name, number, origin * along_axis, coal.Cylinder(1.3 * r, 5 * r), colour)
        elif joint.nv == 1 and parent == 0:  # a rail on the ground
            axis = S[:3, 0]
            at = placement * pin.SE3(_z_along(axis), axis * home[joint.idx_q])
            add(name, parent, at, coal.Cylinder(0.8 * r, 24 * r), colour)
        elif joint.nv == 1:  # a sleeve about a rod
            at = placement * pin.SE3(_z_along(S[:3, 0]), np.zeros(3))
            add(name, parent, at, coal.Cylinder(1.6 * r, 8 * r), colour)
        elif only_rotates:  # a ball or a universal joint
            add(name, number, origin, coal.Sphere(1.7 * r), colour)
        if parent == 0 and only_rotates:
            foot = coal.Box(4 * r, 4 * r, 4 * r)
            add("ground", 0, placement * data.M * origin, foot, _GROUND)

    # Closures; a distance has no shape.
    for closure in closures:
        if not isinstance(closure, Closure):
            continue
        frame = frame_named(model, closure.frame_a)
        r = thicknesses[frame.parentJoint]
        if closure.kind in _BALLS:
            shape = coal.Sphere(1.7 * r)
        elif closure.kind in ("hinge", "cylindrical"):
            shape = coal.Cylinder(1.3 * r, 5 * r)
        else:
            continue
        add(closure.frame_a, frame.parentJoint, frame.placement, shape, _STEEL)
    return shapes


def _thicknesses(shapes: pin.GeometryModel, joints: int) -> Array:
    """Largest half thickness of each body's links, at most twice the median, (joints,), [m]."""
    halves: list[list[float]] = [[] for _ in range(joints)]
    for body in shapes.geometryObjects:
        shape = body.geometry
        size = shape.halfSide if isinstance(shape, coal.Box) else (shape.radius, shape.halfLength)
        halves[body.parentJoint].append(float(min(size)))
    usual = float(np.median(np.concatenate(halves)))
    return np.array([min(max(of_body, default=usual), 2 * usual) for of_body in halves])


def _nearest_on_axis(axis: Array, shapes: pin.GeometryModel, joint: int) -> Array:
    """The point of an axis through the body's origin that is closest to an end of a link."""
    ends = []
    for body in shapes.geometryObjects:
        if body.parentJoint == joint and isinstance(body.geometry, coal.Cylinder):
            half = body.geometry.halfLength
            ends += [body.placement.act(np.array([0, 0, z])) for z in (-half, half)]
    if not ends:
        return np.zeros(3)
    along = np.array(ends) @ axis
    off = np.linalg.norm(np.array(ends) - along[:, None] * axis, axis=1)
    return np.asarray(along[np.argmin(off.round(9))] * axis)


def _z_along(axis: Array) -> Array:
    """A rotation that brings z to an axis, shape (3, 3)."""
    return pin.Quaternion.FromTwoVectors(np.array([0.0, 0, 1]), axis).matrix()
