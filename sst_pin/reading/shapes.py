# SPDX-License-Identifier: BSD-2-Clause
"""Shapes of a robot's bodies as Pinocchio's geometry models; mesh files are read at first use."""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import coal
import pinocchio as pin

from ..errors import DescriptionError
from .mjcf_compiled import pose_of
from .text import with_elements

#: What to do about shapes that cannot be loaded.
_CURE = "an empty pinocchio.GeometryModel() as visual_model (show --skeleton) does without"


def urdf_shapes(
    root: ET.Element,
    folder: Path,
    model: pin.Model,
    kind: pin.GeometryType = pin.GeometryType.VISUAL,
) -> pin.GeometryModel:
    """Visual or collision shapes of a URDF, for a tree whose joints may have been replaced.

    Paths of mesh files are relative to the folder of the URDF. With `package://` they may be
    relative to a folder above it, too.
    """
    folders = [str(each) for each in (folder, *folder.resolve().parents)]
    # Elements that shapes need, with their parts.
    tags = {
        "material": ("color", "texture"),
        "link": ("visual", "collision"),
        "joint": ("parent", "child"),
    }
    root = with_elements(root, tags)  # a copy
    for joint in root.findall("joint"):  # the model has the joints and masses
        joint.set("type", "fixed")
    for link in root.findall("link"):  # urdfdom would leave out the link, and print a complaint
        link[:] = [shape for shape in link if shape.find("geometry/capsule") is None]
    text = ET.tostring(root, encoding="unicode")
    try:
        return pin.buildGeomFromUrdfString(model, text, kind, package_dirs=folders)
    except (ValueError, RuntimeError) as error:
        problem = f"its shapes cannot be loaded: {error}; {_CURE}"
        raise DescriptionError(str(folder), [problem]) from None


#: Groups of geoms that MuJoCo's viewer shows; collision shapes usually are in others.
_SHOWN_GROUPS = 3
#: Shapes of geoms by `mjtGeom`, and factors from MuJoCo's sizes to the arguments of coal: MuJoCo
#: has half lengths where coal has lengths.
_SHAPES = {
    2: (coal.Sphere, (1,)),
    3: (coal.Capsule, (1, 2)),
    4: (coal.Ellipsoid, (1, 1, 1)),
    5: (coal.Cylinder, (1, 2)),
    6: (coal.Box, (2, 2, 2)),
}
#: A mesh by `mjtGeom`.
_MESH = 7


def mjcf_shapes(
    mj: Any,
    bodies: Sequence[tuple[int, pin.SE3]],
    model: pin.Model,  # `RobotFile.shapes` passes it
) -> pin.GeometryModel:
    """Geoms of an MJCF in the groups that MuJoCo's viewer shows, for the tree as it was read.

    `bodies` has for each body the joint that carries it and its placement there.
    """
    shapes = pin.GeometryModel()
    for i in range(mj.ngeom):
        material = mj.geom_matid[i]  # -1: none
        colour = mj.geom_rgba[i] if material < 0 else mj.mat_rgba[material]
        geometry = _geometry(mj, i)
        if geometry is None or not colour[3] or mj.geom_group[i] >= _SHOWN_GROUPS:
            continue
        joint, body_on_joint = bodies[mj.geom_bodyid[i]]
        geom_on_joint = body_on_joint * pose_of(mj.geom_pos[i], mj.geom_quat[i])
        shape = pin.GeometryObject(f"{i}_{mj.geom(i).name}", joint, geom_on_joint, geometry)
        shape.meshColor = colour.astype(float)
        shapes.addGeometryObject(shape)
    return shapes


def _geometry(mj: Any, i: int) -> coal.CollisionGeometry | None:
    """A geom as a shape; None for planes, height fields and others that are no bodies."""
    kind = int(mj.geom_type[i])
    mesh = mj.geom_dataid[i]
    if kind in _SHAPES:
        shape, factors = _SHAPES[kind]
        sizes = mj.geom_size[i].tolist()  # always three; some shapes need fewer
        return shape(*(factor * size for factor, size in zip(factors, sizes, strict=False)))
    if kind != _MESH:
        return None
    vertices = _part_of_mesh(mj.mesh_vert, mj.mesh_vertadr[mesh], mj.mesh_vertnum[mesh])
    faces = _part_of_mesh(mj.mesh_face, mj.mesh_faceadr[mesh], mj.mesh_facenum[mesh])
    surface = coal.BVHModelOBBRSS()
    surface.beginModel(len(faces), len(vertices))
    surface.addVertices(vertices.astype(float))
    surface.addTriangles(faces.astype(int))
    surface.endModel()
    return surface


def _part_of_mesh(array: Any, start: int, count: int) -> Any:
    """The rows of one mesh in an array that MuJoCo has for all meshes."""
    return array[start : start + count]
