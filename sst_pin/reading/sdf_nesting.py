# SPDX-License-Identifier: BSD-2-Clause
"""Models of an SDF inside other models, as parts of the outer model.

The link `hand` of the model `arm` becomes the link `arm::hand`, as the specification calls it from
outside. The frame of the inner model becomes a frame `arm`, which moves with its canonical link.
"""

from copy import deepcopy
from xml.etree import ElementTree as ET

from .joint_graph import WORLD
from .problems import is_true
from .sdf_frames import MODEL

#: Elements with names that other elements refer to.
_NAMED = ("link", "joint", "frame")
#: Attributes and texts that refer to frames, by element; a pose has `frame` until version 1.6.
_ATTRIBUTES = {
    "pose": ("relative_to", "frame"),
    "frame": ("attached_to",),
    "xyz": ("expressed_in",),
    "mimic": ("joint",),
    "drake:mimic": ("joint",),
}
_TEXTS = ("parent", "child", "gearbox_reference_body")


def without_nested_models(model: ET.Element) -> tuple[ET.Element, list[str]]:
    """A copy of a model that has the parts of its inner models, and problems of inner models."""
    problems = list[str]()
    flat = ET.Element(model.tag, model.attrib)
    flat.text = model.text
    inner_models = model.findall("model")
    flat.extend(child for child in model if child not in inner_models)
    for inner in inner_models:
        name = inner.get("name", "")
        where = f"<model> {name}"
        if not name:
            problems.append("<model>: an inner model without a name")
        if inner.get("placement_frame"):
            problems.append(f"{where}: the placement_frame of an inner model is not supported")
        if is_true(inner.findtext("static")):
            problems.append(f"{where}: an inner model that is static; use a fixed joint to world")
        inner_flat, more = without_nested_models(inner)
        problems += more
        flat.extend(_parts(inner_flat, name))
    return flat, problems


def _parts(model: ET.Element, name: str) -> list[ET.Element]:
    """The elements of an inner model, with the names that they have in the outer model.

    The last one is the frame of the inner model.
    """
    first_link = model.find("link")
    canonical = model.get("canonical_link")
    if canonical is None and first_link is not None:
        canonical = first_link.get("name", "")
    parts = list[ET.Element]()
    for child in model:
        if child.tag in ("pose", "static"):
            continue
        part = deepcopy(child)
        _make_default_frames_explicit(part)
        _rename(part, name)
        parts.append(part)
    frame = ET.Element("frame", name=name)
    if canonical is not None:
        frame.set("attached_to", f"{name}::{canonical}")
    pose = model.find("pose")
    pose = ET.Element("pose") if pose is None else deepcopy(pose)
    if not (pose.get("relative_to") or pose.get("frame")):
        pose.set("relative_to", MODEL)
    frame.append(pose)
    return [*parts, frame]


def _make_default_frames_explicit(part: ET.Element) -> None:
    """Write "__model__", the frame of the inner model, where an element names no frame.

    An element without a name of a frame refers to the frame of the model that contains it. In the
    outer model, this would be another frame. `_rename` then replaces "__model__" by the name that
    the frame of the inner model has in the outer one.
    """
    if part.tag == "frame" and not part.get("attached_to"):
        part.set("attached_to", MODEL)
    if part.tag == "link":
        pose = part.find("pose")
        if pose is None:
            pose = ET.SubElement(part, "pose")
        if not (pose.get("relative_to") or pose.get("frame")):
            pose.set("relative_to", MODEL)
    if part.tag == "joint":
        for axis in (*part.findall("axis"), *part.findall("axis2")):
            xyz = axis.find("xyz")
            in_model = is_true(axis.findtext("use_parent_model_frame"))
            if in_model and xyz is not None and not xyz.get("expressed_in"):
                xyz.set("expressed_in", MODEL)


def _rename(part: ET.Element, model: str) -> None:
    """Put the name of the inner model before the names in one of its parts."""

    def outer(name: str) -> str:
        """The name in the outer model for a name in the inner one."""
        if name == WORLD:  # it has the same name everywhere
            return name
        if name == MODEL:
            return model
        return f"{model}::{name}"

    if part.tag in _NAMED:
        part.set("name", outer(part.get("name", "")))
    for element in part.iter():
        for attribute in _ATTRIBUTES.get(element.tag, ()):
            if element.get(attribute):
                element.set(attribute, outer(element.get(attribute, "")))
        if element.tag in _TEXTS and element.text and element.text.strip():
            element.text = outer(element.text.strip())
