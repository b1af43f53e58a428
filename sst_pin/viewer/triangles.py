# SPDX-License-Identifier: BSD-2-Clause
"""Triangle meshes: tubes and arrows; bodies, in the colours of their mesh files or descriptions."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import trimesh
from numpy.typing import ArrayLike

from ..arrays import Array
from ..description.solids import lofted
from ..errors import InputError
from .scene_parts import Mesh, Shape

#: Angle between faces from which their edge is drawn, [rad].
_EDGE = np.radians(35.0)


def tube(points: ArrayLike, radii: ArrayLike, sides: int = 14) -> Mesh:
    """A round tube along a line, its ends closed.

    Two equal successive points make a step in radius. The faces are in order along the line,
    2 * sides for each segment; faces of the ends come last.
    """
    points = np.asarray(points, dtype=float)
    radii = np.broadcast_to(np.asarray(radii, dtype=float), len(points))
    # A normal at each point, which moves along the line without turning about it, so that the tube
    # is not twisted.
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
    wall = faces[: -2 * sides].reshape(2, -1, sides, 3).swapaxes(0, 1)  # now along the line
    return Mesh(vertices, np.concatenate([wall.reshape(-1, 3), faces[-2 * sides :]]))


def _tangents(points: Array) -> Array:
    """Unit tangents of a line at its points, shape (n, 3): the mean of the steps on both sides."""
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    if not lengths.any():
        return np.tile((0.0, 0.0, 1.0), (len(points), 1))
    # A step of length zero takes the direction of the step before it or, at the start, after it.
    steps = steps[np.maximum.accumulate(np.where(lengths > 0, np.arange(len(steps)), 0))]
    steps[: np.argmax(lengths > 0)] = steps[np.argmax(lengths > 0)]
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
    return _shaded(_surface(geometry))


def _shaded(mesh: trimesh.Trimesh) -> Mesh:
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


def body_shapes(body: pin.GeometryObject) -> Iterator[Shape]:
    """One shape for each colour that a body has.

    A colour in the description takes precedence over those in the mesh file, as in the URDF's
    rules.
    """
    whole = solid(body.geometry)
    colour_of_body = _hex(body.meshColor)
    parts: dict[str, Mesh] = {}
    if not body.overrideMaterial:
        parts = _coloured_parts(body, whole, colour_of_body)
    if not parts:
        parts = {colour_of_body: whole}
    for i, (colour, mesh) in enumerate(parts.items()):
        name = f"{body.name}_{i}" if len(parts) > 1 else body.name
        opacity = float(body.meshColor[3])
        at = body.placement.homogeneous
        yield Shape(str(body.parentJoint), "bodies", name, mesh, colour, opacity, at)


#: Largest difference of the size of a mesh as coal and trimesh read it, relative to its largest
#: edge.
_SAME_SIZE = 1e-4


def _coloured_parts(body: pin.GeometryObject, whole: Mesh, default: str) -> dict[str, Mesh]:
    """Parts of a body by the colours in its mesh file; none where there are no colours.

    coal, which has read the file, ignores colours. trimesh reads them. If it cannot read the file,
    or gives another size or place, the body has one colour.

    Args:
        body: The body.
        whole: Its surface.
        default: The colour of parts without one.
    """
    if not Path(body.meshPath).is_file():
        return {}
    pieces: dict[str, list[Any]] = {}  # by their colours
    try:
        scene: Any = trimesh.load(body.meshPath, force="scene")
        for part in scene.dump():
            for colour, piece in _pieces(part, default):
                pieces.setdefault(colour, []).append(piece)
    except Exception:  # each format has errors of its own
        return {}
    if not pieces or list(pieces) == [default]:
        return {}
    meshes = {}
    for colour, of_colour in pieces.items():
        joined: Any = trimesh.util.concatenate(of_colour)
        meshes[colour] = _shaded(trimesh.Trimesh(joined.vertices * body.meshScale, joined.faces))
    vertices = np.vstack([mesh.vertices for mesh in meshes.values()])
    low = vertices.min(axis=0) - whole.vertices.min(axis=0)
    high = vertices.max(axis=0) - whole.vertices.max(axis=0)
    largest_edge = np.ptp(whole.vertices, axis=0).max()
    if max(np.abs(low).max(), np.abs(high).max()) > _SAME_SIZE * largest_edge:
        return {}
    return meshes


#: A surface with more colours is shown in their mean.
_MOST_COLOURS = 32


def _pieces(mesh: Any, default: str) -> Iterator[tuple[str, Any]]:
    """Parts of a mesh with one colour each, and their colours."""
    visual = mesh.visual
    bare: Any = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    if visual.kind == "texture":
        material = visual.material
        image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
        colours = visual.to_color().vertex_colors if image else material.main_color
        yield _hex(np.divide(colours, 255)), bare
    elif visual.kind in ("face", "vertex"):
        colours, owners = np.unique(visual.face_colors, axis=0, return_inverse=True)
        if len(colours) > _MOST_COLOURS:
            yield _hex(visual.face_colors / 255), bare
            return
        for i, colour in enumerate(colours):
            (piece,) = bare.submesh([np.flatnonzero(owners.ravel() == i)], repair=False)
            yield _hex(colour / 255), piece
    else:
        yield default, bare


def _hex(colours: Any) -> str:
    """A colour, or the mean of several, with red, green, blue from 0 to 1, as "#RRGGBB"."""
    mean = np.atleast_2d(colours)[:, :3].mean(axis=0).clip(0, 1)
    return "#" + "".join(f"{round(255 * float(c)):02X}" for c in mean)
