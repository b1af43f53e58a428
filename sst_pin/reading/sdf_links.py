# SPDX-License-Identifier: BSD-2-Clause
"""Links of a model of an SDF: inertias, gravity and shapes."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator

import pinocchio as pin

from ..summaries import listed
from .joint_graph import JointGraph, origin_of
from .problems import is_true, warning
from .sdf_model import SdfModel

#: Default entries of an inertia, from the specification [kg m^2].
_UNIT_INERTIA = {"ixx": 1.0, "ixy": 0.0, "ixz": 0.0, "iyy": 1.0, "iyz": 0.0, "izz": 1.0}


def add_links(model: SdfModel, graph: JointGraph) -> None:
    """Add the links of a model to a graph.

    A note names the links without a mass or moments of inertia, which get those of the
    specification.
    """
    links_by_missing = dict[str, list[str]]()
    for name, link in model.links.items():
        inertial = link.find("inertial")
        if inertial is None:
            inertial = ET.Element("inertial")
        needed = ("mass", "inertia/ixx", "inertia/iyy", "inertia/izz")
        missing = ", ".join(path for path in needed if inertial.find(path) is None)
        if missing:
            links_by_missing.setdefault(missing, []).append(name)
        inertia = dict[str, float]()
        for key, default in _UNIT_INERTIA.items():
            inertia[key] = model.number(link, f"inertia/{key}", default, part=inertial)
        mass = model.number(link, "mass", 1.0, part=inertial)
        pose = model.frames.inertia_pose(inertial, link)
        element = graph.add_link(name, pose, mass, inertia)
        if not is_true(link.findtext("gravity", "true")):
            gazebo = ET.SubElement(graph.urdf, "gazebo", reference=name)
            ET.SubElement(gazebo, "gravity").text = "false"
        for tag in ("visual", "collision"):
            for shape in link.findall(tag):
                pose = model.frames.shape_pose(name, shape)
                element.extend(_shape(tag, shape, pose, f"{name}_{len(element)}"))
    for missing, names in links_by_missing.items():
        text = f"no {missing}: 1 kg and the unit inertia by the specification"
        model.notes.append(warning(f"links {listed(names)}", text))


#: Shapes that are drawn: the names of their sizes in an SDF and in a URDF.
_SHAPES: dict[str, dict[str, str]] = {
    "box": {"size": "size"},
    "cylinder": {"radius": "radius", "length": "length"},
    "sphere": {"radius": "radius"},
    "mesh": {"uri": "filename", "scale": "scale"},
}


def _shape(tag: str, shape: ET.Element, place: pin.SE3, name: str) -> Iterator[ET.Element]:
    """A shape as an element of a URDF; nothing for planes and height maps, which are left out.

    `tag` is "visual" or "collision", `place` the pose of the shape on its link, `name` a new name
    for its material.
    """
    geometry = shape.find("geometry")
    if geometry is None or not len(geometry):
        return
    solid = geometry[0]
    if solid.tag not in _SHAPES:
        return
    part = ET.Element(tag)
    ET.SubElement(part, "origin", origin_of(place))
    sizes = {
        urdf_key: (solid.findtext(key) or "").strip()
        for key, urdf_key in _SHAPES[solid.tag].items()
    }
    if solid.tag == "mesh" and not sizes["scale"]:
        sizes["scale"] = "1 1 1"
    ET.SubElement(ET.SubElement(part, "geometry"), solid.tag, sizes)
    colour = shape.findtext("material/diffuse", "").strip()
    if colour:
        material = ET.SubElement(part, "material", name=name)
        ET.SubElement(material, "color", rgba=colour)
    yield part
