# SPDX-License-Identifier: BSD-2-Clause
"""URDF to a Pinocchio model whose joints have one coordinate each."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping

import pinocchio as pin

from ..errors import DescriptionError
from .checks import FIXED, INERTIAL, MOVING, check, check_names
from .problems import Problem

#: Axes that a joint of the LAAS schema turns about, one after the other.
AXES = {
    "FIXED": "",
    "SPHERICAL": "XYZ",
    **{f"UJOINT_{a}{b}": a + b for a in "XYZ" for b in "XYZ" if a != b},
}
_UNIT = {"X": "1 0 0", "Y": "0 1 0", "Z": "0 0 1"}
#: Of a joint without limits; [rad] or [m].
_WIDE = "1e9"
#: Pinocchio's data have several arrays with the cube of their number: 4 GB here.
MOST_JOINTS = 400
#: Links, joints and others; Pinocchio goes down a tree by recursion, deep enough to crash.
_MOST_ELEMENTS = 10_000


def parse_urdf(text: str, source: str, joints: Mapping[str, str] | None = None) -> pin.Model:
    """A Pinocchio model of a URDF, all joints with one coordinate.

    A `continuous` joint is read as a revolute one without limits: Pinocchio would give it two
    coordinates.

    Args:
        text: The XML.
        source: What error messages call it.
        joints: What joints are in truth, where a URDF cannot say: "FIXED", "SPHERICAL",
            "UJOINT_XY", ... by name. A joint with several axes becomes one joint for each,
            `name_X`, `name_Y`, `name_Z`, between links without mass; with all three they lose a
            motion where `name_Y` is at a right angle.

    Raises:
        DescriptionError: When it is no URDF, or has what the dynamics would overlook: with every
            error that `validate` finds in names, tree and numbers.
    """
    root = parse_xml(text, source)
    problems = _errors(check(root))
    names = {joint.get("name") for joint in root.findall("joint")}
    problems += [f"joint {name} is missing" for name in joints or () if name not in names]
    if problems:
        raise DescriptionError(source, problems)
    _strip(root)
    _unbind(root)
    for name, kind in (joints or {}).items():
        _replace(root, name, AXES[kind])
    moving = sum(joint.get("type") != "fixed" for joint in root.findall("joint"))
    if moving > MOST_JOINTS:
        problems = [f"{moving} moving joints; no more than {MOST_JOINTS} are computed"]
    for tag in ("link", "joint"):  # what replaces a joint has names as well
        problems += _errors(check_names(root.findall(tag)))
    if problems:
        raise DescriptionError(source, problems)
    try:
        return pin.buildModelFromXML(ET.tostring(root, encoding="unicode"))
    except (ValueError, RuntimeError) as error:
        raise DescriptionError(source, [f"not a URDF: {error}"]) from None


def parse_xml(text: str, source: str, what: str = "a URDF") -> ET.Element:
    """The elements of a URDF or an SRDF.

    Raises:
        DescriptionError: When it is not XML, with line and column, which urdfdom does not say; or
            when it is larger than any robot.
    """
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise DescriptionError(source, [f"not {what}: not XML: {error}"]) from None
    if len(root) > _MOST_ELEMENTS:
        text = f"not {what}: {len(root)} elements; no more than {_MOST_ELEMENTS} are read"
        raise DescriptionError(source, [text])
    return root


def _errors(problems: Iterable[Problem]) -> list[str]:
    return [
        f"{'not a URDF' if problem.where == 'file' else problem.where}: {problem.text}"
        for problem in problems
        if problem.severity == "error"
    ]


def _strip(root: ET.Element) -> None:
    """Leave what the dynamics are made of, and one blank between numbers.

    Otherwise urdfdom takes a number before a tab for none, and a tree with an odd shape as well.
    """
    root[:] = [element for element in root if element.tag in ("link", "joint")]
    for element in root:
        fixed = element.get("type") == "fixed"
        kept = ("inertial",) if element.tag == "link" else FIXED if fixed else MOVING
        element[:] = [child for child in element if child.tag in kept]
        for child in element:
            child[:] = [ET.Element(e.tag, e.attrib) for e in child if e.tag in INERTIAL]
            if child.tag == "dynamics":  # urdfdom wants one of them
                child.attrib.setdefault("damping", "0")
            if child.tag not in ("parent", "child"):  # which have names
                for e in (child, *child):
                    e.attrib.update({key: " ".join(text.split()) for key, text in e.items()})


def _unbind(root: ET.Element) -> None:
    """Make continuous joints revolute."""
    for joint in root.findall("joint"):
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
            limit = joint.find("limit")
            if limit is None:
                limit = ET.SubElement(joint, "limit", effort="0", velocity="0")
            limit.attrib.update(lower="-" + _WIDE, upper=_WIDE)


def _replace(root: ET.Element, name: str, axes: str) -> None:
    """Put a joint for each of the axes in the place of one joint, none for a fixed one."""
    joint = next(j for j in root.findall("joint") if j.get("name") == name)
    if not axes:
        joint.set("type", "fixed")
        return
    parent, child, origin = joint.find("parent"), joint.find("child"), joint.find("origin")
    if parent is None or child is None:
        return  # urdfdom says so
    carriers = [f"{name}_{axis}_carrier" for axis in axes[:-1]]
    links = [parent.get("link", ""), *carriers, child.get("link", "")]
    for axis, bearer, borne in zip(axes, links, links[1:], strict=False):
        turn = ET.SubElement(root, "joint", name=f"{name}_{axis}", type="revolute")
        if axis == axes[0] and origin is not None:
            turn.append(origin)
        ET.SubElement(turn, "parent", link=bearer)
        ET.SubElement(turn, "child", link=borne)
        ET.SubElement(turn, "axis", xyz=_UNIT[axis])
        ET.SubElement(turn, "limit", lower="-" + _WIDE, upper=_WIDE, effort="0", velocity="0")
    for carrier in carriers:
        ET.SubElement(root, "link", name=carrier)
    root.remove(joint)
