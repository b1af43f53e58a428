# SPDX-License-Identifier: BSD-2-Clause
"""Building blocks of the gallery: solids with mass and shape, and the tree that they hang on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

#: From a plane of motion, x to the right and y up, to the base, where z points up.
UPRIGHT = pin.SE3(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), np.zeros(3))
_GREY, _ORANGE = np.array([0.55, 0.6, 0.65, 1.0]), np.array([0.95, 0.55, 0.15, 1.0])


class Solid(NamedTuple):
    """A homogeneous solid on a body.

    Attributes:
        inertia: In the axes of the shape, about its centre.
        shape: Centred at its placement.
        at: Placement in the frame of the body's joint.
    """

    inertia: pin.Inertia
    shape: coal.ShapeBase
    at: pin.SE3


def rods(mass: float, points: ArrayLike, radius: float) -> list[Solid]:
    """Round rods of one radius along a line, points of shape (n, 3); a mass for all; SI units."""
    points = np.asarray(points, dtype=float)
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    solids = []
    for start, step, length in zip(points, steps, lengths, strict=False):
        turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0, 1]), step).matrix()
        inertia = pin.Inertia.FromCylinder(mass * length / lengths.sum(), radius, length)
        shape = coal.Cylinder(radius, length)
        solids.append(Solid(inertia, shape, pin.SE3(turn, start + step / 2)))
    return solids


def rod(mass: float, end: ArrayLike, radius: float) -> list[Solid]:
    """A round rod from the origin to a point."""
    return rods(mass, np.stack([np.zeros(3), end]), radius)


def star(mass: float, points: Sequence[Array], radius: float) -> list[Solid]:
    """Rods from the centre of some points to each of them, equally heavy; a mass for all."""
    centre = np.mean(points, axis=0)
    share = mass / len(points)
    return [solid for point in points for solid in rods(share, [centre, point], radius)]


def arc(mass: float, angle: float, radius: float, thickness: float) -> list[Solid]:
    """Four rods of a thickness, their radius, along a circle about x, from the z axis on."""
    turns = np.linspace(0, angle, 5)
    points = radius * np.stack([0 * turns, -np.sin(turns), np.cos(turns)], axis=1)
    return rods(mass, points, thickness)


def box(mass: float, size: ArrayLike, centre: ArrayLike = (0, 0, 0)) -> list[Solid]:
    """A box along the axes, edges and centre of shape (3,)."""
    x, y, z = np.asarray(size, dtype=float)
    at = pin.SE3(np.eye(3), np.asarray(centre, dtype=float))
    return [Solid(pin.Inertia.FromBox(mass, x, y, z), coal.Box(x, y, z), at)]


def disc(mass: float, radius: float, thickness: float) -> list[Solid]:
    """A round plate about the z axis, its centre at the origin; [kg], [m], [m]."""
    inertia = pin.Inertia.FromCylinder(mass, radius, thickness)
    return [Solid(inertia, coal.Cylinder(radius, thickness), pin.SE3.Identity())]


class Tree:
    """A Pinocchio tree under construction, weight along -z, with the shapes of its bodies."""

    def __init__(self, name: str) -> None:
        self.model, self.visual_model = pin.Model(), pin.GeometryModel()
        self.model.name = name

    def joint(
        self,
        name: str,
        kind: pin.JointModel,
        solids: Sequence[Solid],
        parent: str = "universe",
        at: pin.SE3 | None = None,
    ) -> None:
        """Add a joint and the body that it moves.

        `parent` is the joint whose body bears it, "universe" for the base; `at` its placement
        there, at the parent's joint by default.
        """
        at = pin.SE3.Identity() if at is None else at
        joint = self.model.addJoint(self.model.getJointId(parent), kind, at, name)
        for i, solid in enumerate(solids):
            self.model.appendBodyToJoint(joint, solid.inertia, solid.at)
            shape = pin.GeometryObject(f"{name}_{i}", joint, solid.at, solid.shape)
            shape.meshColor = _GREY
            self.visual_model.addGeometryObject(shape)

    def frame(self, name: str, body: str, at: ArrayLike | pin.SE3) -> None:
        """Add a frame on the body of a joint, "universe" for the base.

        `at` is its placement, or its origin where it keeps the body's axes, shape (3,).
        """
        placement = at if isinstance(at, pin.SE3) else shift(at)
        joint = self.model.getJointId(body)
        self.model.addFrame(pin.Frame(name, joint, placement, pin.FrameType.OP_FRAME))

    def platform(self, body: str, at: ArrayLike | pin.SE3 = (0, 0, 0)) -> None:
        """Make a body the platform, with the frame "platform"."""
        self.frame("platform", body, at)
        for shape in self.visual_model.geometryObjects:
            if shape.parentJoint == self.model.getJointId(body):
                shape.meshColor = _ORANGE


def shift(origin: ArrayLike) -> pin.SE3:
    """A placement that does not turn; shape (2,) or (3,), [m]."""
    x, y, *z = np.asarray(origin, dtype=float)
    return pin.SE3(np.eye(3), np.array([x, y, *(z or [0.0])]))


def planar(x: float, y: float, angle: float) -> pin.SE3:
    """A placement in the plane of x and y; [m], [m], [rad]."""
    return pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, angle), np.array([x, y, 0.0]))


def turned_x(angle: float) -> pin.SE3:
    """A turn about x, [rad]."""
    return pin.SE3(pin.rpy.rpyToMatrix(angle, 0.0, 0.0), np.zeros(3))


def circle(radius: float, angles: ArrayLike, height: float = 0.0) -> Array:
    """Points on a circle about z, shape (n, 3); [m], [rad]."""
    angles = np.asarray(angles, dtype=float)
    return np.stack(
        [radius * np.cos(angles), radius * np.sin(angles), np.full(len(angles), height)], axis=1
    )
