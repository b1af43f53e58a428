# SPDX-License-Identifier: BSD-2-Clause
"""The parts as triangle meshes (trimesh)."""

from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import MissingExtraError
from ..files import Writer
from .parameters import Parameters
from .parts import parts_of


def meshes_of(p: Parameters) -> dict[str, Any]:
    """Meshes of an SST: `trimesh.Trimesh` by the name of its file without ending.

    They are in metres and the axes of `parts_of`; each is a set of closed surfaces.
    """
    try:
        import trimesh
    except ImportError:
        raise MissingExtraError("trimesh", "mesh") from None

    meshes = {}
    for name, solids in parts_of(p).items():
        parts = [trimesh.Trimesh(*_loft(solid.loops()), process=False) for solid in solids]
        meshes[name] = trimesh.util.concatenate(parts)
    return meshes


def mesh_writers(p: Parameters) -> dict[str, Writer]:
    """Writers of the meshes as STL and OBJ, by the file's name from the URDF on."""
    obj = {"include_normals": False, "digits": 6, "header": None}

    def writer(mesh: Any, kind: str, **options: Any) -> Writer:
        def write(file: BinaryIO) -> None:
            content = mesh.export(file_type=kind, **options)
            file.write(content if isinstance(content, bytes) else content.encode())

        return write

    writers = {}
    for name, mesh in meshes_of(p).items():
        writers[f"meshes/{name}.stl"] = writer(mesh, "stl")
        writers[f"meshes/{name}.obj"] = writer(mesh, "obj", **obj)
    return writers


def _loft(loops: Array) -> tuple[Array, NDArray[np.int_]]:
    """Vertices and faces of the closed surface through the loops of a solid."""
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
