# SPDX-License-Identifier: BSD-2-Clause
"""Parts of a scene: meshes, shapes, arrows, struts and labels.

A scene is a tree of nodes. A shape is a mesh on a mover, which is a body, a strut or a contact; the
mover's placement changes with the configuration. Arrows and marks also change with the *effort*,
which is the vector of all torques of motors, then forces of reactions and contacts, each as a share
of the largest of its kind; `EffortLayout` has its order.
"""

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..arrays import Array
from ..description.solids import axes_along

#: Colour of lines, rods, wheels and other parts that are not coloured by what they do.
GREY = "#8A9199"
#: Smallest scale of an arrow; a scale of zero has no normals.
_SMALLEST = 1e-3
#: Smallest length of a strut, [m]; a scale of zero has no normals.
_SHORTEST = 1e-9
#: Smaller shares of the largest torque or force are rounding.
_NOISE = 1e-6


class Mesh(NamedTuple):
    """Triangles in space."""

    vertices: Array  #: Shape (n, 3), [m].
    faces: NDArray[np.int_]  #: Indices of vertices, counterclockwise from outside, shape (m, 3).


class Shape(NamedTuple):
    """A mesh that moves with a body, in a layer of shapes that are shown and hidden together."""

    mover: str  #: Number of the joint of its body, "0" for the base, or name of a strut.
    layer: str
    name: str  #: Name of the shape within both.
    mesh: Mesh  #: In the axes of `at`.
    colour: str  #: As "#rrggbb".
    opacity: float = 1.0  #: 1 is opaque.
    at: Array = np.eye(4)  #: Placement on what it moves with, homogeneous.

    @property
    def node(self) -> str:
        """Path of the shape in the tree of the scene."""
        return f"{self.mover}/{self.layer}/{self.name.replace('/', '_')}"


class EffortLayout(NamedTuple):
    """The order of an effort: all torques, then three components of each force."""

    motors: int  #: Number of torques.
    reactions: int  #: Number of forces in joints and then closures; 0 if they are not shown.
    contacts: int  #: Number of forces of contacts.

    def reaction(self, number: int) -> int:
        """Index of the first component of a reaction."""
        return self.motors + 3 * number

    def contact(self, number: int) -> int:
        """Index of the first component of the force of a contact."""
        return self.motors + 3 * (self.reactions + number)

    def efforts(self, torques: Array, reactions: Array | None, contacts: Array | None) -> Array:
        """Efforts of N samples, shape (N, size).

        Args:
            torques: Shares of torques, shape (N, motors).
            reactions: Shares of forces, shape (N, reactions, 3); zero by default.
            contacts: Shares of forces, shape (N, contacts, 3); zero by default.
        """
        count = len(torques)
        if reactions is None:
            reactions = np.zeros((count, self.reactions, 3))
        if contacts is None:
            contacts = np.zeros((count, self.contacts, 3))
        return np.hstack([torques, reactions.reshape(count, -1), contacts.reshape(count, -1)])


def _length(share: float) -> float:
    """Length of an arrow for its share of the largest: the square root, so that all are seen."""
    return max(float(np.sqrt(share)), _SMALLEST) if share > _NOISE else _SMALLEST


class TorqueArrow(NamedTuple):
    """Torque of a motor at a joint: a shape whose size shows it."""

    shape: Shape  #: At the largest torque.
    motor: int  #: Its index in tau.
    share: float  #: Share of the motor's torque that acts here; the motor's largest share is 1.
    mirror: tuple[float, float, float]  #: Diagonal of the matrix that reverses the arrow.

    def placement(self, effort: Array) -> Array:
        """Placement of the arrow for an effort."""
        size = self.share * effort[self.motor]
        scale = np.full(3, _length(abs(size)))
        if size < 0:
            scale *= self.mirror
        return np.asarray(self.shape.at @ np.diag([*scale, 1.0]))


class ForceArrow(NamedTuple):
    """A force: an arrow along z whose size and direction show it."""

    shape: Shape  #: At the largest force, in the axes of the force.
    first: int  #: Index of the first of its three components in the effort.
    #: Way from the start of the arrow to the point of the force, in lengths of the shape along z.
    start: float = 0.0

    def placement(self, effort: Array) -> Array:
        """Placement of the arrow for an effort."""
        force = effort[self.first : self.first + 3]
        size = float(np.linalg.norm(force))
        axes = _length(size) * along(force)
        matrix = homogeneous(axes, -self.start * axes[:, 2])
        return np.asarray(self.shape.at @ matrix)


class ForceMark(NamedTuple):
    """A mark that is shown while a force acts."""

    shape: Shape
    first: int  #: Index of the first component of the force in the effort.

    def placement(self, effort: Array) -> Array:
        """Placement of the mark for an effort."""
        acts = np.linalg.norm(effort[self.first : self.first + 3]) > _NOISE
        scale = 1.0 if acts else _SMALLEST
        return np.asarray(self.shape.at @ np.diag([scale, scale, scale, 1.0]))


class ContactPlace(NamedTuple):
    """Where a contact touches its ground; its shapes move with the mover `node`."""

    node: str
    frame: pin.Frame
    ground: pin.Frame
    radius: float  #: Of the sphere about `frame`, zero for a point, [m].

    def placement(self, poses: Array) -> Array:
        """The point that touches, with the axes of the ground, for the placements of all joints.

        Shapes (4, 4), homogeneous, and (joints, 4, 4).
        """
        frame = poses[self.frame.parentJoint] @ self.frame.placement.homogeneous
        ground = poses[self.ground.parentJoint] @ self.ground.placement.homogeneous
        normal = ground[:3, 2]
        return homogeneous(ground[:3, :3], frame[:3, 3] - self.radius * normal)


class Strut(NamedTuple):
    """A straight line between two points that move: its shape is one unit long, along z."""

    shape: Shape  #: Its mover is the strut's own name.
    joints: tuple[int, int]  #: Joints whose bodies carry the ends.
    points: Array  #: The ends on these bodies, shape (2, 3), [m].

    def placement(self, poses: Array) -> Array:
        """Placement of the strut for placements of all joints, homogeneous, (joints, 4, 4)."""
        start = moved(self.points[:1], poses[self.joints[0]])[0]
        end = moved(self.points[1:], poses[self.joints[1]])[0]
        matrix = homogeneous(along(end - start), start)
        matrix[:3, 2] *= max(float(np.linalg.norm(end - start)), _SHORTEST)
        return matrix


class Label(NamedTuple):
    """A word in the scene; layer and mover are as in `Shape`."""

    text: str  #: Digits or one letter after "_" are an index, as in "e_1".
    colour: str  #: As "#rrggbb".
    layer: str
    mover: str
    point: Array  #: On what it moves with, shape (3,), [m].


def moved(points: Array, at: Array) -> Array:
    """Points, shape (n, 3), moved by a homogeneous matrix."""
    return points @ at[:3, :3].T + at[:3, 3]


def homogeneous(R: Array, translation: Array) -> Array:
    """A placement, shape (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = R
    matrix[:3, 3] = translation
    return matrix


def along(direction: Array) -> Array:
    """Axes with z along a direction, or the identity for a zero vector; columns, shape (3, 3)."""
    return axes_along(direction) if direction.any() else np.eye(3)
