# SPDX-License-Identifier: BSD-2-Clause
"""Tubes and arrows as triangles, for what is drawn beside the robot's own meshes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


class Mesh(NamedTuple):
    """Triangles in space.

    Attributes:
        vertices: Shape (n, 3), [m].
        faces: Indices of vertices, counterclockwise from outside, shape (m, 3).
    """

    vertices: Array
    faces: NDArray[np.int_]


def tube(points: ArrayLike, radii: ArrayLike, sides: int = 14) -> Mesh:
    """A round tube along a line, its ends closed.

    Args:
        points: Of the line, shape (n, 3); a point that comes twice in a row is a step in radius.
        radii: One for all points, or shape (n,).
        sides: Of its section.

    Returns:
        Its faces come along the line, 2 * sides for each step, and then those of the ends.
    """
    points = np.asarray(points, dtype=float)
    radii = np.broadcast_to(np.asarray(radii, dtype=float), len(points))
    tangents = _tangents(points)
    normals = np.empty_like(points)
    normal = np.cross(tangents[0], np.eye(3)[np.abs(tangents[0]).argmin()])
    for i, tangent in enumerate(tangents):  # carried along the line without turning about it
        normal = normal - (normal @ tangent) * tangent
        normal /= np.linalg.norm(normal)
        normals[i] = normal
    angles = np.linspace(0, 2 * np.pi, sides, endpoint=False)[:, None, None]
    ring = np.cos(angles) * normals + np.sin(angles) * np.cross(tangents, normals)
    rings = points[:, None] + radii[:, None, None] * ring.swapaxes(0, 1)
    here = np.arange(len(points) * sides).reshape(len(points), sides)
    beside = np.roll(here, -1, axis=1)
    ahead, across = here[1:], beside[1:]
    here, beside = here[:-1], beside[:-1]
    wall = np.stack([here, beside, across, here, across, ahead], axis=-1).reshape(-1, 3)
    first, last = np.full(sides, rings.size // 3), np.full(sides, rings.size // 3 + 1)
    ends = np.stack([(first, beside[0], here[0]), (last, ahead[-1], across[-1])])
    return Mesh(
        np.concatenate([rings.reshape(-1, 3), points[[0, -1]]]),
        np.concatenate([wall, ends.swapaxes(1, 2).reshape(-1, 3)]),
    )


def arrow(points: ArrayLike, radius: float) -> Mesh:
    """A tube along a line that ends in an arrow's head.

    Args:
        points: Of the line, shape (n, 3); its last step is the head.
        radius: Of the shaft, [m].
    """
    points = np.asarray(points, dtype=float)
    shaft, neck, tip = points[:-1], points[-2], points[-1]
    line = np.vstack([shaft, neck, neck, tip])
    radii = [radius] * (len(shaft) + 1) + [2.6 * radius, 0]
    return tube(line, radii)


def arc(radius: float, angles: ArrayLike) -> Array:
    """Points of a circle about the z axis, shape (n, 3)."""
    angles = np.asarray(angles)
    return radius * np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=-1)


def _tangents(points: Array) -> Array:
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    # A step of no length goes the way of the one before it.
    steps = steps[np.maximum.accumulate(np.where(lengths > 0, np.arange(len(steps)), 0))]
    around = np.vstack([steps[:1], steps]) + np.vstack([steps, steps[-1:]])
    tangents: Array = around / np.linalg.norm(around, axis=1, keepdims=True)
    return tangents
