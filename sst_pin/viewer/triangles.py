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

#: An edge looks sharp if the angle between its faces is larger, [rad].
_EDGE = np.radians(35.0)


def tube(points: ArrayLike, radii: ArrayLike, sides: int = 14) -> Mesh:
    """A round tube along a line through n points, with closed ends.

    If two successive points are equal, the radius changes there in a step. The faces are in order
    along the line, 2 * sides for each segment; the faces of both ends come last.

    Args:
        points: Points of the line, shape (n, 3), [m].
        radii: Radius at each point, shape (n,), or one radius, [m].
        sides: Number of corners of the cross-section.
    """
    points = np.asarray(points, dtype=float)
    radii = np.broadcast_to(np.asarray(radii, dtype=float), len(points))
    # A normal at each point. The normals must not turn about the line, or the tube would be twisted
    # (a rotation-minimising frame). So each normal is the one before it, without the part along the
    # tangent. The first one is normal to the tangent and to the coordinate axis farthest from it.
    tangents = _tangents(points)
    normals = np.empty_like(points)
    normal = np.cross(tangents[0], np.eye(3)[np.abs(tangents[0]).argmin()])
    for i, tangent in enumerate(tangents):
        normal = normal - (normal @ tangent) * tangent
        normal /= np.linalg.norm(normal)
        normals[i] = normal
    # A circle about each point, connected by faces.
    binormals = np.cross(tangents, normals)
    angles = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    circles = []
    for point, radius, normal, binormal in zip(points, radii, normals, binormals, strict=True):
        # From the point to each corner of the cross-section, shape (sides, 3).
        directions = np.outer(np.cos(angles), normal) + np.outer(np.sin(angles), binormal)
        circles.append(point + radius * directions)
    vertices, faces = lofted(np.stack(circles))
    # `lofted` returns first one triangle of each rectangle of the wall, along the whole line, then
    # the other triangle of each rectangle, then the ends. Here the triangles of each segment follow
    # one another.
    segments = len(points) - 1
    wall_in_two_halves = faces[: 2 * segments * sides].reshape(2, segments, sides, 3)
    wall_along_line = np.swapaxes(wall_in_two_halves, 0, 1).reshape(-1, 3)
    ends = faces[2 * segments * sides :]
    return Mesh(vertices, np.concatenate([wall_along_line, ends]))


def _tangents(points: Array) -> Array:
    """Unit tangents of a line at its points, shape (n, 3).

    A tangent is the mean direction of the steps before and after its point. If all points are
    equal, it is the z axis.
    """
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    if not lengths.any():
        return np.tile((0.0, 0.0, 1.0), (len(points), 1))
    # A step of length zero takes the direction of the last step before it that has a length. Steps
    # of length zero at the start of the line take the direction of the first step with a length.
    directions = np.empty_like(steps)
    first = np.argmax(lengths > 0)
    direction = steps[first] / lengths[first]
    for i, length in enumerate(lengths):
        if length > 0:
            direction = steps[i] / length
        directions[i] = direction
    before = np.vstack([directions[:1], directions])
    after = np.vstack([directions, directions[-1:]])
    tangents = before + after
    is_reversal = np.linalg.norm(tangents, axis=1) < 1e-9  # the line goes straight back
    tangents[is_reversal] = after[is_reversal]
    return np.asarray(tangents / np.linalg.norm(tangents, axis=1, keepdims=True))


def arrow(points: ArrayLike, radius: float) -> Mesh:
    """An arrow along a line: a tube of this radius, and a head between the last two points."""
    points = np.asarray(points, dtype=float)
    shaft = points[:-1]
    neck = points[-2]
    tip = points[-1]
    # The neck is there three times: at the end of the shaft, with its radius, and with the head's.
    line = np.vstack([shaft, neck, neck, tip])
    radii = [radius] * (len(shaft) + 1) + [2.6 * radius, 0]
    return tube(line, radii)


def circle(angles: ArrayLike) -> Array:
    """Points of the unit circle about the z axis at n angles, shape (n, 3)."""
    return np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=-1)


def solid(geometry: coal.CollisionGeometry) -> Mesh:
    """The surface of a geometry.

    Raises:
        InputError: If it cannot be drawn, for instance a plane.
    """
    return shaded(_surface(geometry))


def shaded(mesh: trimesh.Trimesh) -> Mesh:
    """A surface for the page, with edges that look sharp.

    The page shades a face smoothly between the normals at its vertices. So along a sharp edge each
    face gets vertices of its own.
    """
    mesh.merge_vertices()
    if len(mesh.faces):  # a file may have points only
        mesh = trimesh.graph.smooth_shade(mesh, angle=_EDGE, facet_minarea=None)
    return Mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces))


def ellipsoid(radii: ArrayLike, fineness: int = 3) -> Mesh:
    """An ellipsoid about the origin, along the axes, of 20 * 4^fineness triangles."""
    ball = trimesh.creation.icosphere(fineness)
    return Mesh(np.asarray(ball.vertices) * np.asarray(radii), np.asarray(ball.faces))


def _surface(geometry: coal.CollisionGeometry) -> trimesh.Trimesh:
    """The triangles of a geometry.

    coal's shapes have their middle at the origin and their axis along z. Those of trimesh are the
    same, except for the capsule and the cone, which are translated.
    """
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
