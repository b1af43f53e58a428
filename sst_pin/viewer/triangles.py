# SPDX-License-Identifier: BSD-2-Clause
"""Triangle meshes: tubes, arrows, ellipsoids, solids."""

import coal
import numpy as np
import trimesh
from numpy.typing import ArrayLike

from ..arrays import Array
from ..description.solids import lofted
from ..errors import InputError
from .scene_parts import Mesh

#: Angle between faces from which their edge is drawn, [rad].
_EDGE = np.radians(35.0)


def tube(points: ArrayLike, radii: ArrayLike, sides: int = 14) -> Mesh:
    """A round tube along a line, its ends closed.

    Two equal successive points make a step in radius. The faces are in order along the line,
    2 * sides for each segment; faces of the ends come last.
    """
    points = np.asarray(points, dtype=float)
    radii = np.broadcast_to(np.asarray(radii, dtype=float), len(points))
    # A normal at each point, which does not turn about the line, so that the tube is not twisted
    # (a rotation-minimising frame): the last normal without its part along the next tangent.
    tangents = _tangents(points)
    normals = np.empty_like(points)
    normal = np.cross(tangents[0], np.eye(3)[np.abs(tangents[0]).argmin()])
    for i, tangent in enumerate(tangents):
        normal = normal - (normal @ tangent) * tangent
        normal /= np.linalg.norm(normal)
        normals[i] = normal
    # Circles about the points, connected by faces.
    angles = np.linspace(0, 2 * np.pi, sides, endpoint=False)[:, None, None]
    ring = np.cos(angles) * normals + np.sin(angles) * np.cross(tangents, normals)
    rings = points[:, None] + radii[:, None, None] * ring.swapaxes(0, 1)
    vertices, faces = lofted(rings)
    # `lofted` gives two sets of triangles of the wall, each along the line, and then the two ends.
    # Here both triangles of a place follow one another.
    segments = len(points) - 1
    wall_by_sets = faces[: 2 * segments * sides].reshape(2, segments, sides, 3)
    wall_along_line = np.swapaxes(wall_by_sets, 0, 1).reshape(-1, 3)
    ends = faces[2 * segments * sides :]
    return Mesh(vertices, np.concatenate([wall_along_line, ends]))


def _tangents(points: Array) -> Array:
    """Unit tangents of a line at its points, shape (n, 3): the mean of the steps on both sides."""
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    if not lengths.any():
        return np.tile((0.0, 0.0, 1.0), (len(points), 1))
    # A step of length zero takes the direction of the last step before it that has a length, and at
    # the start of the first one after it.
    is_step = lengths > 0
    first = np.argmax(is_step)
    last_step = np.maximum.accumulate(np.where(is_step, np.arange(len(steps)), 0))
    steps = steps[last_step]
    steps[:first] = steps[first]
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    before = np.vstack([steps[:1], steps])
    after = np.vstack([steps, steps[-1:]])
    around = before + after
    turned = np.linalg.norm(around, axis=1) < 1e-9  # straight back
    around[turned] = after[turned]
    return np.asarray(around / np.linalg.norm(around, axis=1, keepdims=True))


def arrow(points: ArrayLike, radius: float) -> Mesh:
    """A tube along a line that ends in an arrow's head, which is the last step."""
    points = np.asarray(points, dtype=float)
    shaft = points[:-1]
    neck = points[-2]
    tip = points[-1]
    line = np.vstack([shaft, neck, neck, tip])
    radii = [radius] * (len(shaft) + 1) + [2.6 * radius, 0]
    return tube(line, radii)


def circle(angles: ArrayLike) -> Array:
    """Points of the unit circle about the z axis, shape (n, 3)."""
    return np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=-1)


def solid(geometry: coal.CollisionGeometry) -> Mesh:
    """The surface of a geometry; InputError for one without, such as a plane."""
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
    """The triangles of a geometry."""
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
