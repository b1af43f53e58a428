# SPDX-License-Identifier: BSD-2-Clause
"""The parts as triangle meshes (trimesh)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import MissingExtraError
from ..files import Writer
from .parameters import Parameters
from .parts import parts_of
from .solids import Arc, Box, Cylinder, Solid, axes_along

#: How far a circle's chords may lie inside it, [m].
_CHORD = 2e-4
#: Largest turn of an arc between two of its sections.
_STEP = np.radians(4.5)
#: Width of the bevel on an edge, as a share of the smallest size of the solid.
_BEVEL = 0.12


def meshes_of(p: Parameters) -> dict[str, Any]:
    """Meshes of an SST: `trimesh.Trimesh` by the name of its file without ending.

    They are in metres and the axes of `parts_of`; each is a set of closed surfaces.
    """
    try:
        import trimesh
    except ImportError:
        raise MissingExtraError("trimesh", "mesh") from None

    def mesh(solids: Sequence[Solid]) -> Any:
        parts = (trimesh.Trimesh(*_loft(_loops(solid)), process=False) for solid in solids)
        return trimesh.util.concatenate(list(parts))

    return {name: mesh(solids) for name, solids in parts_of(p).items()}


def mesh_writers(p: Parameters) -> dict[str, Writer]:
    """Writers of the meshes as STL and OBJ, by the file's name from the URDF on."""

    def writer(mesh: Any, kind: str) -> Writer:
        def write(file: BinaryIO) -> None:
            if kind == "stl":
                file.write(mesh.export(file_type="stl"))
            else:
                text = mesh.export(file_type="obj", include_normals=False, digits=6, header=None)
                file.write(text.encode())

        return write

    return {
        f"meshes/{name}.{kind}": writer(mesh, kind)
        for name, mesh in meshes_of(p).items()
        for kind in ("stl", "obj")
    }


def _loft(loops: Array) -> tuple[Array, NDArray[np.int_]]:
    """Vertices and faces of the closed surface through convex loops, shape (loops, points, 3).

    Every loop runs counterclockwise when seen from the last one.
    """
    count, points, _ = loops.shape
    ends = loops[[0, -1]].mean(axis=1)
    here = np.arange(count * points).reshape(count, points)
    beside = np.roll(here, -1, axis=1)
    first, last = np.full(points, count * points), np.full(points, count * points + 1)
    faces = [
        (here[:-1], beside[:-1], beside[1:]),
        (here[:-1], beside[1:], here[1:]),
        (first, beside[0], here[0]),
        (last, here[-1], beside[-1]),
    ]
    corners = [np.stack([c.ravel() for c in corner], axis=-1) for corner in faces]
    return np.concatenate([loops.reshape(-1, 3), ends]), np.concatenate(corners)


def _loops(solid: Solid) -> Array:
    if isinstance(solid, Box):
        return _loops_of_box(solid)
    if isinstance(solid, Cylinder):
        return _loops_of_cylinder(solid)
    if isinstance(solid, Arc):
        return _loops_of_arc(solid)
    circle = _circle(solid.radius)
    latitudes = np.linspace(-1.5, 1.5, len(circle) // 2 + 1)
    sections = [np.cos(latitude) * circle for latitude in latitudes]
    return solid.center + _stack(solid.radius * np.sin(latitudes), sections)


def _loops_of_box(solid: Box) -> Array:
    length, width, depth = solid.size
    bevel = _BEVEL * solid.size.min()
    heights = np.array((-length / 2, bevel - length / 2, length / 2 - bevel, length / 2))
    wide, narrow = (_rectangle(width - inset, depth - inset, bevel) for inset in (0, 2 * bevel))
    return solid.center + _stack(heights, [narrow, wide, wide, narrow]) @ solid.axes.T


def _loops_of_cylinder(solid: Cylinder) -> Array:
    axis = solid.end - solid.start
    length = float(np.linalg.norm(axis))
    x, y, z = axes_along(axis).T
    bevel = _BEVEL * min(solid.radius, solid.end_radius, length)
    heights = np.array((0, bevel, length - bevel, length))
    radii = np.array((solid.radius - bevel, solid.radius, solid.end_radius))
    radii = np.append(radii, solid.end_radius - bevel)
    circle = _circle(radii.max()) / radii.max()
    return solid.start + _stack(heights, [r * circle for r in radii]) @ np.stack([z, x, y])


def _loops_of_arc(solid: Arc) -> Array:
    depth, width = solid.section
    bevel = _BEVEL * min(solid.section)
    section = _circle(depth / 2) if solid.round else _rectangle(depth, width, bevel)
    angles = np.linspace(0, solid.angle, int(np.ceil(solid.angle / _STEP - 1e-9)) + 1)
    radial = np.outer(np.cos(angles), solid.radius + section[:, 0])
    along = np.outer(np.sin(angles), solid.radius + section[:, 0])
    local = np.stack([radial, along, np.broadcast_to(section[:, 1], radial.shape)], axis=-1)
    # Counterclockwise in (radial, axial) is clockwise from where the arc goes.
    return local[:, ::-1] @ solid.axes.T


def _stack(heights: Array, sections: Sequence[Array]) -> Array:
    """Loops one above the other; the first coordinate is the height."""
    pairs = zip(heights, sections, strict=True)
    return np.stack([np.insert(section, 0, height, axis=1) for height, section in pairs])


def _circle(radius: float) -> Array:
    """Points of a circle, counterclockwise; a multiple of four, so that its size is right."""
    cosine = max(1 - _CHORD / radius, 0.9)  # eight points at least
    quarter = np.ceil(np.pi / 4 / np.arccos(cosine))
    angles = np.pi / 2 / quarter * np.arange(4 * quarter)
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def _rectangle(width: float, depth: float, bevel: float) -> Array:
    """Points of a rectangle, counterclockwise, the corners cut off."""
    a, b = width / 2, depth / 2
    half = np.array(((a, bevel - b), (a, b - bevel), (a - bevel, b), (bevel - a, b)))
    return np.concatenate([half, -half])
