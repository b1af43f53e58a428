# SPDX-License-Identifier: BSD-2-Clause
"""Parts of a scene: shapes, arrows, struts and labels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ..arrays import Array
from .triangles import Mesh

#: Colours of the axes x, y, z of a frame.
AXES = ("#C0392B", "#27AE60", "#2E5FA8")
_SMALLEST = 1e-3  # a scale of zero has no normals


class Shape(NamedTuple):
    """A mesh.

    Attributes:
        mover: Body that it moves with: number of a joint, "0" for the base, or name of a strut.
        layer: Name of the group that is shown and hidden together.
        name: Its own within both.
        mesh: In the axes of `at`.
        colour: Colour as "#rrggbb".
        opacity: 1 is opaque.
        at: Placement on what it moves with, homogeneous.
    """

    mover: str
    layer: str
    name: str
    mesh: Mesh
    colour: str
    opacity: float = 1.0
    at: Array = np.eye(4)

    @property
    def node(self) -> str:
        """Path of the shape in the tree of the scene."""
        return f"{self.mover}/{self.layer}/{self.name.replace('/', '_')}"


class Arrow(NamedTuple):
    """Torque of a motor at a joint: a shape whose size shows it.

    Attributes:
        shape: At the largest torque or force.
        motor: Its index in tau.
        share: Share of the motor's torque that acts here; the motor's largest share is 1.
        mirror: Diagonal of what turns the arrow round.
    """

    shape: Shape
    motor: int
    share: float
    mirror: tuple[float, float, float]

    def at(self, effort: Array) -> Array:
        """Placement of the arrow, with its size and sense.

        Args:
            effort: Motor torques as shares of the largest, shape (motors,).
        """
        size = self.share * effort[self.motor]
        scale = max(abs(size), _SMALLEST) * np.array(self.mirror if size < 0 else (1.0, 1.0, 1.0))
        return np.asarray(self.shape.at @ np.diag([*scale, 1.0]))


class Pull(NamedTuple):
    """Force in a joint or closure: an arrow along z whose size and direction show it.

    Attributes:
        shape: At the largest force, in the axes of the force.
        first: Index of the first of its three components in the effort.
    """

    shape: Shape
    first: int

    def at(self, effort: Array) -> Array:
        """Placement of the arrow.

        Args:
            effort: Motor torques, then all forces, as shares of the largest.
        """
        force = effort[self.first : self.first + 3]
        size = max(float(np.linalg.norm(force)), _SMALLEST)
        matrix = homogeneous(size * along(force / size), np.zeros(3))
        return np.asarray(self.shape.at @ matrix)


class Strut(NamedTuple):
    """A straight line between two points that move: its shape is one unit long, along z.

    Attributes:
        shape: Its mover is the strut's own name.
        joints: Whose bodies the ends are on.
        points: The ends on these bodies, shape (2, 3), [m].
    """

    shape: Shape
    joints: tuple[int, int]
    points: Array

    def at(self, poses: Array) -> Array:
        """Placement of the strut.

        Args:
            poses: Placements of all joints, homogeneous, shape (joints, 4, 4).
        """
        start, end = (
            poses[joint, :3, :3] @ point + poses[joint, :3, 3]
            for joint, point in zip(self.joints, self.points, strict=True)
        )
        length = max(float(np.linalg.norm(end - start)), 1e-9)
        matrix = homogeneous(along((end - start) / length), start)
        matrix[:3, 2] *= length
        return matrix


class Label(NamedTuple):
    """A word in the scene.

    Attributes:
        text: Text; digits or one letter after "_" are an index, as in "e_1".
        colour: Colour as "#rrggbb".
        layer: Name of the group that is shown and hidden together.
        mover: Body that it moves with, see `Shape`.
        point: On what it moves with, [m].
    """

    text: str
    colour: str
    layer: str
    mover: str
    point: tuple[float, float, float]


def homogeneous(R: Array, translation: Array) -> Array:
    """A placement, shape (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = R, translation
    return matrix


def along(axis: Array) -> Array:
    """Axes whose z is a unit vector, or that of the base for none; columns, shape (3, 3)."""
    if not axis.any():
        return np.eye(3)
    x = np.cross(np.eye(3)[np.abs(axis).argmin()], axis)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=-1)


def decompose(matrices: Array) -> tuple[Array, Array, Array]:
    """Positions, quaternions x, y, z, w, and scales of homogeneous matrices, shape (n, 4, 4)."""
    A = matrices[:, :3, :3]
    scale = np.linalg.norm(A, axis=1)
    scale[np.linalg.det(A) < 0, 1] *= -1
    quaternions = Rotation.from_matrix(A / scale[:, None]).as_quat()
    return matrices[:, :3, 3], quaternions, scale
