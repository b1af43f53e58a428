# SPDX-License-Identifier: BSD-2-Clause
"""Building blocks of the gallery: solids with mass and shape, and the tree that they hang on."""

from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .placements import HERE, rotation_z_to, shift

#: Colours of links and of platforms.
_GREY = np.array([0.55, 0.6, 0.65, 1.0])
_ORANGE = np.array([0.95, 0.55, 0.15, 1.0])


class Solid(NamedTuple):
    """A shape with an inertia, placed on a body.

    Attributes:
        inertia: Inertia in the frame of the shape.
        shape: The shape, centred at the origin of its frame.
        at: Placement of the frame of the shape on the body.
    """

    inertia: pin.Inertia
    shape: coal.ShapeBase
    at: pin.SE3


Solids = list[Solid]


def rods(mass: float, points: ArrayLike, radius: float) -> Solids:
    """Round rods from each point to the next one, as a polyline; SI units.

    `points` has the shape (n, 3). `mass` is that of all rods together.
    """
    points = np.asarray(points, dtype=float)
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    solids = []
    for start, step, length in zip(points, steps, lengths, strict=False):
        inertia = pin.Inertia.FromCylinder(mass * length / lengths.sum(), radius, length)
        at = pin.SE3(rotation_z_to(step), start + step / 2)
        solids.append(Solid(inertia, coal.Cylinder(radius, length), at))
    return solids


def rod(mass: float, end: ArrayLike, radius: float) -> Solids:
    """A round rod from the origin to a point `end`, shape (3,)."""
    return rods(mass, np.stack([np.zeros(3), end]), radius)


def bar(mass: float, length: float, radius: float) -> Solids:
    """A round rod from the origin along x."""
    return rod(mass, (length, 0, 0), radius)


def star(mass: float, points: ArrayLike, radius: float) -> Solids:
    """Rods of equal mass from the centre of some points, shape (n, 3), to each of the points.

    `mass` is that of all rods together.
    """
    ends = np.asarray(points, dtype=float)
    centre = ends.mean(axis=0)
    solids = []
    for end in ends:
        solids += rods(mass / len(ends), [centre, end], radius)
    return solids


def arc(mass: float, angle: float, radius: float, thickness: float) -> Solids:
    """Four rods along an arc of a circle about the x axis.

    The arc begins on the z axis and turns by `angle`, [rad], positive towards -y. `radius` is that
    of the circle, `thickness` that of the rods, [m]. `mass` is that of all rods together.
    """
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
    """A body of known inertia, drawn as massless rods along a polyline of points, shape (n, 3).

    `moments` are the principal moments of inertia about the mass centre, along the body's axes.
    """
    inertia = pin.Inertia(mass, shift(centre).translation, np.diag(moments))
    massless = [solid._replace(inertia=pin.Inertia.Zero()) for solid in rods(1.0, points, radius)]
    # The first rod carries the whole inertia, which must be in the frame of this rod.
    first = massless[0]
    return [first._replace(inertia=first.at.actInv(inertia)), *massless[1:]]


class Tree:
    """A Pinocchio tree under construction, weight along -z, with the shapes of its bodies."""

    def __init__(self, name: str) -> None:
        self.model = pin.Model()
        self.visual_model = pin.GeometryModel()
        self.model.name = name

    def add_joint(
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

    def set_limits(self, name: str, low: float, high: float) -> None:
        """Limit the position of a joint with one rate, [rad] or [m]."""
        i = self.model.joints[self.model.getJointId(name)].idx_q
        self.model.lowerPositionLimit[i] = low
        self.model.upperPositionLimit[i] = high

    def add_hinge(
        self, name: str, solids: Solids, parent: str = "universe", at: pin.SE3 = HERE
    ) -> None:
        """Add a joint that turns about z, and its body."""
        self.add_joint(name, pin.JointModelRZ(), solids, parent, at)

    def add_frame(self, name: str, body: str, at: ArrayLike | pin.SE3) -> None:
        """Add a frame on a joint's body, at a placement, or at a point with the body's axes."""
        placement = at if isinstance(at, pin.SE3) else shift(at)
        joint = self.model.getJointId(body)
        self.model.addFrame(pin.Frame(name, joint, placement, pin.FrameType.OP_FRAME))

    def make_platform(self, body: str, at: ArrayLike | pin.SE3 = (0, 0, 0)) -> None:
        """Make a body the platform: add the frame "platform" and colour the body's shapes."""
        self.add_frame("platform", body, at)
        for shape in self.visual_model.geometryObjects:
            if shape.parentJoint == self.model.getJointId(body):
                shape.meshColor = _ORANGE
