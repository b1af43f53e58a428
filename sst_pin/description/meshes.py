# SPDX-License-Identifier: BSD-2-Clause
"""The parts as triangle meshes (trimesh)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from ..errors import MissingExtraError
from ..files import Writer
from ..parameters import Parameters
from .shapes import Arc, Ball, Box, Cylinder, Solid, axes_along, shapes_of

Array = NDArray[np.float64]

#: Points round a circle.
_ROUND = 24
#: Largest turn of an arc between two of its sections.
_STEP = np.radians(4.5)
#: Width of the bevel on an edge, as a share of the smallest size of the solid.
_BEVEL = 0.12


def meshes_of(p: Parameters) -> dict[str, Any]:
    """Meshes of an SST.

    Returns:
        `trimesh.Trimesh` by the name of its file without ending, in metres and the axes of
        `shapes_of`; each a set of closed surfaces, normals outward.

    Raises:
        MissingExtraError: Without trimesh.
    """
    try:
        import trimesh
    except ImportError:
        raise MissingExtraError("trimesh", "mesh") from None

    def mesh(solids: Sequence[Solid]) -> Any:
        parts = (trimesh.Trimesh(*_loft(_loops(solid)), process=False) for solid in solids)
        return trimesh.util.concatenate(list(parts))

    return {name: mesh(solids) for name, solids in shapes_of(p).items()}


def mesh_writers(p: Parameters) -> dict[str, Writer]:
    """Writers of the meshes as STL and OBJ, by the file's name from the URDF on.

    Args:
        p: Of the SST.

    Raises:
        MissingExtraError: Without trimesh.
    """

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
    if isinstance(solid, Cylinder):
        return _loops_of_cylinder(solid)
    if isinstance(solid, Ball):
        latitude = np.linspace(-1.5, 1.5, _ROUND // 2 + 1)[:, None, None]
        circle = np.concatenate([_ellipse(1, 1), np.zeros((_ROUND, 1))], axis=1)
        pole = np.eye(3)[2]
        return solid.center + solid.radius * (np.cos(latitude) * circle + np.sin(latitude) * pole)
    if isinstance(solid, Box):
        length, width, depth = solid.size
        bevel = _BEVEL * min(solid.size)
        inset = np.array((bevel, 0, 0, bevel))
        along = length / 2 * np.array((-1, -1, 1, 1)) + bevel * np.array((0, 1, -1, 0))
        sections = [_rectangle(width, depth, bevel, i) for i in inset]
        local = np.stack([_at(x, section) for x, section in zip(along, sections, strict=True)])
        return solid.center + local @ solid.axes.T
    return _loops_of_arc(solid)


def _loops_of_cylinder(solid: Cylinder) -> Array:
    axis = solid.end - solid.start
    length = np.linalg.norm(axis)
    x, y, z = axes_along(axis).T
    bevel = _BEVEL * min(solid.radius, solid.end_radius, length)
    at = np.array((0, bevel, length - bevel, length))
    radii = np.array(
        (solid.radius - bevel, solid.radius, solid.end_radius, solid.end_radius - bevel)
    )
    circles = radii[:, None, None] * (_ellipse(1, 1) @ np.stack([x, y]))
    return solid.start + at[:, None, None] * z + circles


def _loops_of_arc(solid: Arc) -> Array:
    depth, width = solid.section
    bevel = _BEVEL * min(solid.section)
    section = _ellipse(depth / 2, width / 2) if solid.round else _rectangle(depth, width, bevel, 0)
    angles = np.linspace(0, solid.angle, int(np.ceil(solid.angle / _STEP - 1e-9)) + 1)[:, None]
    radius = solid.radius + section[:, 0]
    local = np.stack(
        np.broadcast_arrays(radius * np.cos(angles), radius * np.sin(angles), section[:, 1]),
        axis=-1,
    )
    # Counterclockwise in (radial, axial) is clockwise from where the arc goes.
    return local[:, ::-1] @ solid.axes.T


def _at(x: float, section: Array) -> Array:
    return np.concatenate([np.full((len(section), 1), x), section], axis=1)


def _ellipse(a: float, b: float) -> Array:
    angles = 2 * np.pi / _ROUND * np.arange(_ROUND)
    return np.stack([a * np.cos(angles), b * np.sin(angles)], axis=-1)


def _rectangle(width: float, depth: float, bevel: float, inset: float) -> Array:
    """Its corners cut off, counterclockwise."""
    a, b = width / 2 - inset, depth / 2 - inset
    corners = ((a, bevel - b), (a, b - bevel), (a - bevel, b), (bevel - a, b))
    half = np.array(corners)
    return np.concatenate([half, -half])
