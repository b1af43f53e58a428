# SPDX-License-Identifier: BSD-2-Clause
"""What is drawn beside the robot's bodies, whoever draws it: triangles and where they are."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..description.colours import LEG_COLOURS
from ..sst.kinematics import legs_of_joints
from .shapes import Mesh, arc, arrow, tube
from .star import Star

Array = NDArray[np.float64]

#: Of the axes x, y, z of a frame.
_AXES = ("#C0392B", "#27AE60", "#2E5FA8")
_TRAIL, _PATH = "#222222", "#9A9A9A"
TRAIL_SIDES = 8
#: Size of a torque's arrow at the largest torque, as a share of the star's radius.
_LARGEST = 0.45
_SMALLEST = 1e-3  # a scale of zero has no normals


class Shape(NamedTuple):
    """A mesh at a node of the scene.

    Attributes:
        node: Its path; the first part is the group it is shown and hidden with.
        mesh: In the axes of the node.
        colour: As "#rrggbb".
    """

    node: str
    mesh: Mesh
    colour: str


class Markers:
    """Joint axes, frames, torques and the path of E of an SST.

    Attributes:
        shapes: What `placements` moves.
        labels: What is written where: text, colour, node, distance along its z axis.

    Args:
        robot: The SST.
    """

    def __init__(self, robot: Star) -> None:
        self._robot, self._radius = robot, robot.star_radius
        r = self._radius
        turn = np.linspace(0, np.radians(250), 40)
        torque = arrow(np.vstack([arc(1.0, turn), arc(1.0, turn[-1:] + 0.6)]), 0.055)
        triad = [arrow(np.outer((0, 0.75, 1), 0.17 * r * axis), 0.006 * r) for axis in np.eye(3)]
        self.shapes = [Shape(f"torques/tau_{k}", torque, c) for k, c in enumerate(LEG_COLOURS, 1)]
        for k, colour in enumerate(LEG_COLOURS, 1):
            for number, length in ((k, 1.2), (k + 3, 1.3), (k + 6, 0.8)):
                line = arrow(np.outer((0, 0.95, 1), (0, 0, length * r)), 0.007 * r)
                self.shapes.append(Shape(f"axes/e_{number}", line, colour))
        for frame in (*(f"{i}{k}" for k in (1, 2, 3) for i in range(4)), "E"):
            for axis, mesh, colour in zip("xyz", triad, _AXES, strict=True):
                self.shapes.append(Shape(f"frames/{frame}/{axis}", mesh, colour))
        tips = {k: (1.26 if k < 4 else 1.36) * r for k in range(1, 7)} | dict.fromkeys(
            range(7, 10), 0.86 * r
        )
        self.labels: list[dict[str, Any]] = [
            {
                "text": f"e_{k}",
                "colour": LEG_COLOURS[(k - 1) % 3],
                "node": f"axes/e_{k}",
                "along": along,
            }
            for k, along in tips.items()
        ]
        self.labels += [
            {
                "text": f"{{{i}{k}}}",
                "colour": LEG_COLOURS[k - 1],
                "node": f"frames/{i}{k}",
                "along": 0.2 * r,
            }
            for k in (1, 2, 3)
            for i in range(4)
        ]
        self.labels.append({"text": "E", "colour": _TRAIL, "node": "E", "along": 0.0})

    def placements(self, q: Array, effort: Array) -> dict[str, Array]:
        """Where the nodes are.

        Args:
            q: Joint coordinates, shape (9,), [rad].
            effort: Motor torques as a share of the largest, shape (3,).

        Returns:
            Homogeneous matrices, shape (4, 4), by node; a torque's holds its size and sense.
        """
        geometry, r = self._robot.geometry, self._radius
        legs = legs_of_joints(geometry, q)
        R_E = self._robot.platform_orientation(q)
        placed = {}
        for k in range(3):
            R_0, e = geometry.R_0[k], geometry.e[k]
            size = max(_LARGEST * r * abs(effort[k]), _SMALLEST)
            # Mirrored for a torque against e_k.
            scale = size * np.diag((1, -1 if effort[k] < 0 else 1, 1))
            placed[f"torques/tau_{k + 1}"] = _matrix(R_0 @ scale, -0.42 * r * e)
            for number, axis in ((k + 1, e), (k + 4, legs.u[k]), (k + 7, legs.n[k])):
                placed[f"axes/e_{number}"] = _matrix(_along(axis), np.zeros(3))
            frames = {
                "0": R_0,
                "1": np.stack([legs.u[k], legs.y_1[k], e], axis=-1),
                "2": np.stack([legs.u[k], legs.y_2[k], legs.n[k]], axis=-1),
                "3": np.stack([legs.s[k], np.cross(legs.n[k], legs.s[k]), legs.n[k]], axis=-1),
            }
            # All have their origin in O; they are drawn apart, on the parts they belong to.
            at = {
                "0": R_0[:, 0],
                "1": 0.72 * legs.u[k],
                "2": 1.16 * legs.u[k],
                "3": 1.06 * frames["3"] @ (np.cos(0.7), -np.sin(0.7), 0),
            }
            for name, R in frames.items():
                placed[f"frames/{name}{k + 1}"] = _matrix(R, r * at[name])
        placed["frames/E"] = _matrix(R_E, 1.12 * r * R_E[:, 0])
        placed["E"] = _matrix(np.eye(3), 1.27 * r * R_E[:, 0])
        return placed

    def reference(self, q: Array) -> Shape:
        """The path of E as a thin line.

        Args:
            q: Joint coordinates along the path, shape (n, 9), n >= 2.
        """
        return Shape("path", tube(self._path(q), 0.004 * self._radius), _PATH)

    def trail(self, q: Array) -> Shape:
        """The path of E as a thick line, of which the page shows what has been passed.

        Args:
            q: Joint coordinates along the path, shape (n, 9), n >= 2.
        """
        return Shape("trail", tube(self._path(q), 0.009 * self._radius, TRAIL_SIDES), _TRAIL)

    def _path(self, q: Array) -> Array:
        path: Array = self._radius * self._robot.platform_orientation(q)[:, :, 0]
        return path


def parts(matrices: Array) -> tuple[Array, Array, Array]:
    """Positions, quaternions x, y, z, w, and scales; a mirror turns y over.

    Args:
        matrices: Homogeneous, shape (n, 4, 4).
    """
    A = matrices[:, :3, :3]
    scale = np.linalg.norm(A, axis=1)
    scale[np.linalg.det(A) < 0, 1] *= -1
    quaternions = Rotation.from_matrix(A / scale[:, None]).as_quat()
    return matrices[:, :3, 3], quaternions, scale


def _matrix(A: Array, translation: Array) -> Array:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = A, translation
    return matrix


def _along(axis: Array) -> Array:
    """Axes whose z is a unit vector."""
    x = np.cross(np.eye(3)[np.abs(axis).argmin()], axis)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=-1)
