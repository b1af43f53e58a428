# SPDX-License-Identifier: BSD-2-Clause
"""Parts of a scene: meshes, shapes, arrows, struts and labels.

A scene is a tree of nodes. Each shape is a mesh that is fixed to a *mover*: a body, a strut or a
contact. The placement of a mover changes with the configuration. Placements are homogeneous
matrices, shape (4, 4). The matrices of arrows, marks and struts also scale their shapes.

The size of an arrow changes with the *effort*, and so does the visibility of a mark. An effort is
a vector of the torques of all motors, then the forces of reactions, then the forces of contacts,
each as a share of the largest of its kind. `EffortLayout` has the order of its entries.
"""

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..arrays import Array
from ..description.solids import axes_along

#: Colour of lines, rods, wheels and other parts that are not coloured by what they do.
GREY = "#8A9199"
#: Smallest scale of an arrow. With a scale of zero, the page could not compute surface normals.
_SMALLEST = 1e-3
#: Smallest length of a strut, [m], for the same reason.
_SHORTEST = 1e-9
#: A force that is a smaller share of the largest one is rounding.
_NOISE = 1e-6


class Mesh(NamedTuple):
    """Triangles in space."""

    vertices: Array  #: Shape (n, 3), [m].
    faces: NDArray[np.int_]  #: Indices of vertices, counterclockwise from outside, shape (m, 3).


class Shape(NamedTuple):
    """A mesh that moves with its mover, in a layer of shapes that are shown and hidden together."""

    #: Number of the joint that moves its body, "0" for the base; or name of a strut or contact.
    mover: str
    layer: str
    name: str  #: Name of the shape, unique in its layer of this mover.
    mesh: Mesh  #: In axes of its own, which `at` places.
    colour: str  #: As "#rrggbb".
    opacity: float = 1.0  #: 1 is opaque.
    at: Array = np.eye(4)  #: Placement of the mesh in the frame of the mover.

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
        """Index in the effort of the first component of a reaction."""
        return self.motors + 3 * number

    def contact(self, number: int) -> int:
        """Index in the effort of the first component of the force of a contact."""
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
    """Length of an arrow relative to the longest: the square root, so that small ones are seen."""
    return max(float(np.sqrt(share)), _SMALLEST)


class TorqueArrow(NamedTuple):
    """The torque or force of a motor at a joint: an arrow whose size shows it."""

    shape: Shape  #: As it is drawn for the largest torque.
    motor: int  #: Index of the motor in tau.
    share: float  #: Share of the motor's torque that acts here; the motor's largest share is 1.
    mirror: tuple[float, float, float]  #: Diagonal of the matrix that reverses the arrow.

    def placement(self, effort: Array) -> Array:
        """Placement of the arrow on its mover for an effort."""
        size = self.share * effort[self.motor]
        scale = np.full(3, _length(abs(size)))
        if size < 0:
            scale *= self.mirror
        return np.asarray(self.shape.at @ np.diag([*scale, 1.0]))


class ForceArrow(NamedTuple):
    """A force: an arrow whose size and direction show it."""

    shape: Shape  #: The arrow of the largest force, if this force points along z.
    first: int  #: Index in the effort of the first of the force's three components.
    #: Distance from the start of the arrow to the point where the force acts, along the arrow, in
    #: units of the mesh. It is zero for an arrow that starts at this point.
    start: float = 0.0

    def placement(self, effort: Array) -> Array:
        """Placement of the arrow on its mover for an effort."""
        force = effort[self.first : self.first + 3]
        size = float(np.linalg.norm(force))
        axes = _length(size) * along(force)
        matrix = homogeneous(axes, -self.start * axes[:, 2])
        return np.asarray(self.shape.at @ matrix)


class ForceMark(NamedTuple):
    """A mark that is shown while a force acts."""

    shape: Shape
    first: int  #: Index in the effort of the first of the force's three components.

    def placement(self, effort: Array) -> Array:
        """Placement of the mark on its mover for an effort.

        It makes the mark too small to be seen if no force acts.
        """
        acts = np.linalg.norm(effort[self.first : self.first + 3]) > _NOISE
        scale = 1.0 if acts else _SMALLEST
        return np.asarray(self.shape.at @ np.diag([scale, scale, scale, 1.0]))


class ContactPlace(NamedTuple):
    """Where a contact touches its ground: a mover, with the arrow and the mark of the force."""

    node: str  #: Name of this mover.
    frame: pin.Frame  #: The frame on the body that touches.
    ground: pin.Frame  #: The ground is the plane x, y of this frame.
    radius: float  #: Radius of the sphere about `frame`, zero for a point, [m].

    def placement(self, poses: Array) -> Array:
        """Placement in the world: the point that touches, and the axes of the ground.

        `poses` has the placements of all joints, shape (joints, 4, 4).
        """
        frame = poses[self.frame.parentJoint] @ self.frame.placement.homogeneous
        ground = poses[self.ground.parentJoint] @ self.ground.placement.homogeneous
        normal = ground[:3, 2]
        return homogeneous(ground[:3, :3], frame[:3, 3] - self.radius * normal)


class Strut(NamedTuple):
    """A straight part between two points that move, for instance a rod or a spring."""

    shape: Shape  #: Its mesh goes from z = 0 to z = 1; its mover is the strut itself.
    joints: tuple[int, int]  #: Joints whose bodies carry the ends.
    points: Array  #: The ends in the frames of these joints, shape (2, 3), [m].

    def placement(self, poses: Array) -> Array:
        """Placement in the world, which scales z to the distance between the ends.

        `poses` has the placements of all joints, shape (joints, 4, 4).
        """
        start = transform(self.points[:1], poses[self.joints[0]])[0]
        end = transform(self.points[1:], poses[self.joints[1]])[0]
        matrix = homogeneous(along(end - start), start)
        matrix[:3, 2] *= max(float(np.linalg.norm(end - start)), _SHORTEST)
        return matrix


class Label(NamedTuple):
    """A word in the scene; layer and mover are as in `Shape`."""

    text: str  #: Digits or one letter after "_" are an index, as in "e_1".
    colour: str  #: As "#rrggbb".
    layer: str
    mover: str
    point: Array  #: Position in the frame of the mover, shape (3,), [m].


def transform(points: Array, at: Array) -> Array:
    """Points, shape (n, 3), after the transformation by a homogeneous matrix."""
    return points @ at[:3, :3].T + at[:3, 3]


def homogeneous(R: Array, translation: Array) -> Array:
    """A placement, shape (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = R
    matrix[:3, 3] = translation
    return matrix


def along(direction: Array) -> Array:
    """Rotation matrix with the z axis along a direction; the identity for a zero vector."""
    return axes_along(direction) if direction.any() else np.eye(3)
