# SPDX-License-Identifier: BSD-2-Clause
"""Triangle meshes: geometry of bodies, tubes and arrows."""

from __future__ import annotations

from typing import NamedTuple

import coal
import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from ..arrays import Array
from ..errors import InputError

#: Angle between faces from which their edge is drawn, [rad].
_EDGE = np.radians(35.0)


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

    A point twice in a row is a step in radius. The faces come along the line, 2 * sides for each
    step, and then those of the ends.
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
    """A tube along a line that ends in an arrow's head, which is the last step."""
    points = np.asarray(points, dtype=float)
    shaft, neck, tip = points[:-1], points[-2], points[-1]
    line = np.vstack([shaft, neck, neck, tip])
    radii = [radius] * (len(shaft) + 1) + [2.6 * radius, 0]
    return tube(line, radii)


def arc(radius: float, angles: ArrayLike) -> Array:
    """Points of a circle about the z axis, shape (n, 3)."""
    angles = np.asarray(angles)
    return radius * np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=-1)


def solid(geometry: coal.CollisionGeometry) -> Mesh:
    """The surface of a geometry, its vertices doubled along edges so that these look sharp.

    Raises:
        InputError: For one without a surface of its own: a plane, an octree.
    """
    return shaded(_surface(geometry))


def shaded(mesh: trimesh.Trimesh) -> Mesh:
    """A surface whose vertices are doubled along its edges, so that these look sharp."""
    mesh.merge_vertices()
    if len(mesh.faces):  # else a file of points
        mesh = trimesh.graph.smooth_shade(mesh, angle=_EDGE, facet_minarea=None)
    return Mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces))


def ellipsoid(radii: ArrayLike, fineness: int = 3) -> Mesh:
    """An ellipsoid about the origin, along the axes, of 20 * 4^fineness triangles."""
    ball = trimesh.creation.icosphere(fineness)
    return Mesh(np.asarray(ball.vertices) * np.asarray(radii), np.asarray(ball.faces))


def _surface(geometry: coal.CollisionGeometry) -> trimesh.Trimesh:
    if isinstance(geometry, coal.Box):
        return trimesh.creation.box(2 * geometry.halfSide)
    if isinstance(geometry, coal.Cylinder):
        return trimesh.creation.cylinder(geometry.radius, 2 * geometry.halfLength, 48)
    if isinstance(geometry, coal.Capsule):
        capsule = trimesh.creation.capsule(2 * geometry.halfLength, geometry.radius, count=(24, 24))
        return capsule.apply_translation(-capsule.bounds.mean(axis=0))
    if isinstance(geometry, coal.Cone):
        cone = trimesh.creation.cone(geometry.radius, 2 * geometry.halfLength, 48)
        return cone.apply_translation((0, 0, -geometry.halfLength))
    if isinstance(geometry, (coal.Sphere, coal.Ellipsoid)):
        radii = geometry.radii if isinstance(geometry, coal.Ellipsoid) else 3 * [geometry.radius]
        return trimesh.Trimesh(*ellipsoid(radii), process=False)
    if isinstance(geometry, coal.BVHModelBase):
        triangles = map(geometry.tri_indices, range(geometry.num_tris))
        faces = np.array([(a[0], a[1], a[2]) for a in triangles], dtype=int).reshape(-1, 3)
        return trimesh.Trimesh(geometry.vertices(), faces, process=False)
    raise InputError("visual_model", f"a shape of kind {type(geometry).__name__} cannot be drawn")


def _tangents(points: Array) -> Array:
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    if not lengths.any():
        return np.tile((0.0, 0.0, 1.0), (len(points), 1))
    # A step of no length goes the way of the one before it, at the start of the one after it.
    steps = steps[np.maximum.accumulate(np.where(lengths > 0, np.arange(len(steps)), 0))]
    steps[: np.argmax(lengths > 0)] = steps[np.argmax(lengths > 0)]
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    before, after = np.vstack([steps[:1], steps]), np.vstack([steps, steps[-1:]])
    around = before + after
    turned = np.linalg.norm(around, axis=1) < 1e-9  # straight back
    around[turned] = after[turned]
    tangents: Array = around / np.linalg.norm(around, axis=1, keepdims=True)
    return tangents
