# SPDX-License-Identifier: BSD-2-Clause
"""The shapes of a robot's bodies, as Pinocchio's geometry models; files are read when asked for."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..errors import DescriptionError

#: Groups of geoms that MuJoCo's viewer shows; collision shapes are in others by custom.
_SHOWN_GROUPS = 3
#: Types of geoms, as `mjtGeom` has them.
_SPHERE, _CAPSULE, _ELLIPSOID, _CYLINDER, _BOX, _MESH = range(2, 8)
#: What to do without the shapes.
_CURE = "an empty pinocchio.GeometryModel() as visual_model (show --skeleton) does without"


@dataclass(frozen=True)
class UrdfShapes:
    """Shapes of a URDF.

    Attributes:
        root: Its elements.
        folder: What its mesh files are relative to; `package://` is looked for above it too.
    """

    root: ET.Element
    folder: Path

    def __call__(
        self, model: pin.Model, kind: pin.GeometryType = pin.GeometryType.VISUAL
    ) -> pin.GeometryModel:
        """Shapes for the eye, or for collisions.

        Args:
            model: The tree of the same URDF; its joints may have been replaced.
            kind: VISUAL or COLLISION.

        Raises:
            DescriptionError: When a mesh cannot be loaded.
        """
        folders = [str(folder) for folder in (self.folder, *self.folder.resolve().parents)]
        try:
            return pin.buildGeomFromUrdfString(
                model, _without_dynamics(self.root), kind, package_dirs=folders
            )
        except (ValueError, RuntimeError) as error:
            problem = f"its shapes cannot be loaded: {error}; {_CURE}"
            raise DescriptionError(str(self.folder), [problem]) from None


@dataclass(frozen=True)
class MjcfShapes:
    """Shapes of an MJCF: geoms of the groups that MuJoCo's viewer shows.

    Attributes:
        compiled: MuJoCo's model.
        bodies: For each body the joint that bears it and its placement there.
    """

    compiled: Any
    bodies: Sequence[tuple[int, pin.SE3]]

    def __call__(self, model: pin.Model) -> pin.GeometryModel:
        """Shapes for the eye.

        Args:
            model: The tree as it was read.
        """
        mj, shapes = self.compiled, pin.GeometryModel()
        for i in range(mj.ngeom):
            colour = mj.mat_rgba[mj.geom_matid[i]] if mj.geom_matid[i] >= 0 else mj.geom_rgba[i]
            geometry = _geometry(mj, i)
            if geometry is None or not colour[3] or mj.geom_group[i] >= _SHOWN_GROUPS:
                continue
            joint, at = self.bodies[mj.geom_bodyid[i]]
            at = at * pose_of(mj.geom_pos[i], mj.geom_quat[i])
            shape = pin.GeometryObject(f"{i}_{mj.geom(i).name}", joint, at, geometry)
            shape.meshColor = colour.astype(float)
            shapes.addGeometryObject(shape)
        return shapes


def pose_of(position: NDArray[np.float64], quaternion: NDArray[np.float64]) -> pin.SE3:
    """A placement from MuJoCo's position and quaternion w, x, y, z."""
    return pin.SE3(pin.Quaternion(*quaternion).normalized().matrix(), position)


def _without_dynamics(root: ET.Element) -> str:
    """Links with their shapes, all joints fixed; numbers with one blank between them.

    Joints and masses are those of the model; here they could only be wrong.
    """
    bare = ET.Element(root.tag, root.attrib)
    for element in root:
        if element.tag == "material":
            bare.append(element)
        elif element.tag in ("link", "joint"):
            link = element.tag == "link"
            kept = ("visual", "collision") if link else ("parent", "child")
            copy = ET.SubElement(bare, element.tag, element.attrib)
            copy.extend(deepcopy(child) for child in element if child.tag in kept)
            if not link:
                copy.set("type", "fixed")
                continue
            for each in copy.iter():
                for key in ("xyz", "rpy", "size", "scale", "rgba", "radius", "length"):
                    if key in each.attrib:
                        each.set(key, " ".join(each.attrib[key].split()))
    return ET.tostring(bare, encoding="unicode")


def _geometry(mj: Any, i: int) -> coal.CollisionGeometry | None:
    """A geom as a shape; None for a plane, a height field and what else is no body."""
    (a, b, c), kind = mj.geom_size[i].tolist(), mj.geom_type[i]
    if kind == _SPHERE:
        return coal.Sphere(a)
    if kind == _CAPSULE:
        return coal.Capsule(a, 2 * b)
    if kind == _ELLIPSOID:
        return coal.Ellipsoid(a, b, c)
    if kind == _CYLINDER:
        return coal.Cylinder(a, 2 * b)
    if kind == _BOX:
        return coal.Box(2 * a, 2 * b, 2 * c)
    return _mesh(mj, mj.geom_dataid[i]) if kind == _MESH else None


def _mesh(mj: Any, mesh: int) -> coal.BVHModelOBBRSS:
    vertices, faces = (
        array[start[mesh] : start[mesh] + count[mesh]]
        for array, start, count in (
            (mj.mesh_vert, mj.mesh_vertadr, mj.mesh_vertnum),
            (mj.mesh_face, mj.mesh_faceadr, mj.mesh_facenum),
        )
    )
    surface = coal.BVHModelOBBRSS()
    surface.beginModel(len(faces), len(vertices))
    surface.addVertices(vertices.astype(float))
    surface.addTriangles(faces.astype(int))
    surface.endModel()
    return surface
