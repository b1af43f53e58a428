# SPDX-License-Identifier: BSD-2-Clause
"""Shapes of bodies, in the colours of their mesh files or descriptions."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import trimesh

from .scene_parts import Mesh, Shape
from .triangles import shaded, solid

#: coal and trimesh have read the same mesh if the corners of its bounding boxes differ by at most
#: this part of the longest edge of the box.
_SAME_SIZE = 1e-4
#: A surface with more colours is shown in the mean colour.
_MOST_COLOURS = 32


def body_shapes(body: pin.GeometryObject) -> Iterator[Shape]:
    """One shape for each colour that a body has.

    A colour in the description takes precedence over the colours in the mesh file, as in the
    URDF's rules.
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
        mover = str(body.parentJoint)
        opacity = float(body.meshColor[3])
        at = body.placement.homogeneous
        yield Shape(mover, "bodies", name, mesh, colour, opacity=opacity, at=at)


def _coloured_parts(body: pin.GeometryObject, whole: Mesh, default: str) -> dict[str, Mesh]:
    """Parts of a body by the colours in its mesh file; empty if the body has one colour.

    coal, which has read the file, ignores colours; trimesh reads them. The result is empty too if
    trimesh cannot read the file, or if its mesh has another size or place.

    Args:
        body: The body.
        whole: Surface of the body, as coal has read it.
        default: The colour of parts without a colour.
    """
    if not Path(body.meshPath).is_file():
        return {}
    pieces: dict[str, list[Any]] = {}  # by colour
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
    for colour, pieces_of_colour in pieces.items():
        mesh: Any = trimesh.util.concatenate(pieces_of_colour)
        meshes[colour] = shaded(trimesh.Trimesh(mesh.vertices * body.meshScale, mesh.faces))
    vertices = np.vstack([mesh.vertices for mesh in meshes.values()])
    low = vertices.min(axis=0) - whole.vertices.min(axis=0)
    high = vertices.max(axis=0) - whole.vertices.max(axis=0)
    largest_edge = np.ptp(whole.vertices, axis=0).max()
    if max(np.abs(low).max(), np.abs(high).max()) > _SAME_SIZE * largest_edge:
        return {}
    return meshes


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
        for i, colour in enumerate(colours):  # faces of colour i have the owner i
            (piece,) = bare.submesh([np.flatnonzero(owners.ravel() == i)], repair=False)
            yield _hex(colour / 255), piece
    else:
        yield default, bare


def _hex(colours: Any) -> str:
    """A colour, or the mean of several, with red, green, blue from 0 to 1, as "#RRGGBB"."""
    mean = np.atleast_2d(colours)[:, :3].mean(axis=0).clip(0, 1)
    return "#" + "".join(f"{round(255 * float(c)):02X}" for c in mean)
