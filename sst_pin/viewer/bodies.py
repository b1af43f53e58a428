# SPDX-License-Identifier: BSD-2-Clause
"""Bodies as shapes, in the colours of their mesh files where the description gives none."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import trimesh

from ..arrays import Array
from .scene_parts import Shape
from .triangles import Mesh, shaded, solid

#: A surface with more colours is shown in their mean.
_MOST_COLOURS = 32


def body_shapes(body: pin.GeometryObject) -> Iterator[Shape]:
    """One shape for each colour that a body has.

    A colour in the description counts before those in the mesh file, as in the URDF's rules.
    """
    whole, plain = solid(body.geometry), _hex(body.meshColor[:3])
    parts = {} if body.overrideMaterial else _coloured(body, whole, plain)
    for i, (colour, mesh) in enumerate((parts or {plain: whole}).items()):
        name = f"{body.name}_{i}" if len(parts) > 1 else body.name
        opacity, at = float(body.meshColor[3]), body.placement.homogeneous
        yield Shape(str(body.parentJoint), "bodies", name, mesh, colour, opacity, at)


def _coloured(body: pin.GeometryObject, whole: Mesh, plain: str) -> dict[str, Mesh]:
    """Parts of a body by the colours in its mesh file; none where there are no colours.

    coal, which has read the file, keeps no colours. trimesh reads them; what it cannot read, or
    reads in another size or place, stays in one colour.
    """
    if not Path(body.meshPath).is_file():
        return {}
    try:
        scene: Any = trimesh.load(body.meshPath, force="scene")
        found = [piece for part in scene.dump() for piece in _pieces(part, plain)]
    except Exception:  # each format has errors of its own
        return {}
    if not found or {colour for colour, _ in found} == {plain}:
        return {}
    surfaces: dict[str, list[Any]] = {}
    for colour, mesh in found:
        surfaces.setdefault(colour, []).append(mesh)
    meshes = {}
    for colour, pieces in surfaces.items():
        one: Any = trimesh.util.concatenate(pieces)
        meshes[colour] = shaded(trimesh.Trimesh(one.vertices * body.meshScale, one.faces))
    box, wanted = (_box(points) for points in (_all_vertices(meshes), whole.vertices))
    same = np.allclose(box, wanted, rtol=0, atol=1e-4 * float(np.ptp(wanted, axis=0).max()))
    return meshes if same else {}


def _pieces(mesh: Any, plain: str) -> Iterator[tuple[str, Any]]:
    """Parts of a mesh with one colour each, and their colours."""
    visual = mesh.visual
    bare: Any = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    if visual.kind == "texture":
        image = any(getattr(visual.material, k, None) for k in ("image", "baseColorTexture"))
        colours = visual.to_color().vertex_colors if image else visual.material.main_color
        yield _mean(colours), bare
    elif visual.kind in ("face", "vertex"):
        colours, owners = np.unique(visual.face_colors, axis=0, return_inverse=True)
        if len(colours) > _MOST_COLOURS:
            yield _mean(visual.face_colors), bare
            return
        for i, colour in enumerate(colours):
            (piece,) = bare.submesh([np.flatnonzero(owners.ravel() == i)], repair=False)
            yield _mean(colour), piece
    else:
        yield plain, bare


def _mean(colours: Any) -> str:
    """The mean of colours with red, green and blue from 0 to 255, shape (..., 4)."""
    rows = np.atleast_2d(np.asarray(colours, dtype=float))
    return _hex(rows[:, :3].mean(axis=0) / 255)


def _hex(colour: Array) -> str:
    return "#" + "".join(f"{round(255 * float(c)):02X}" for c in np.clip(colour, 0, 1))


def _all_vertices(meshes: dict[str, Mesh]) -> Array:
    return np.vstack([mesh.vertices for mesh in meshes.values()])


def _box(points: Array) -> Array:
    return np.stack([points.min(axis=0), points.max(axis=0)])
