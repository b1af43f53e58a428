# SPDX-License-Identifier: BSD-2-Clause
"""Checks of a URDF: names, tree, and numbers that would be lost.

`check` yields all problems. Each other function yields the problems of a part of the file, or its
faults, which are the texts of errors. `where` names the element in them, such as "joint knee".
"""

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np

from .inertia_checks import ENTRIES
from .problems import (
    SHORTEST_AXIS,
    Problem,
    attribute,
    error,
    note,
    number,
    numbers,
    unknown_parts,
    warning,
)
from .tool_elements import ONE_AXIS

#: All types of joints.
_KINDS = (*ONE_AXIS, "fixed", "floating", "planar")


def check(root: ET.Element) -> Iterator[Problem]:
    """Errors and warnings of a URDF."""
    if root.tag != "robot":
        cure = "; ClosedChain.from_mjcf reads an MJCF" if root.tag == "mujoco" else ""
        yield error("file", f"a URDF starts with <robot>, not with <{root.tag}>{cure}")
        return
    links = root.findall("link")
    joints = root.findall("joint")
    if any("xacro" in element.tag for element in root.iter()):
        cure = "make a URDF of it: xacro FILE.xacro > FILE.urdf (pip install xacro)"
        yield error("file", f"this is a xacro file; {cure}")
    if not root.get("name"):
        yield error("file", "<robot> has no name")
    if not links:
        yield error("file", "no links")
    yield from _repeated_names("link", links)
    yield from _repeated_names("joint", joints)
    link_names = [link.get("name", "") for link in links]
    yield from _connections(link_names, joints)
    for link in links:
        yield from _link(link, f"link {link.get('name')}")
    frame_links = {link.get("name") for link in links}
    for frame in root.findall("frame"):
        yield from _drake_frame(frame, frame_links)
    kinds = {joint.get("name"): joint.get("type", "") for joint in joints}
    for joint in joints:
        yield from _joint(joint, f"joint {joint.get('name')}", kinds)


def _repeated_names(tag: str, elements: Sequence[ET.Element]) -> Iterator[Problem]:
    """Errors of elements of one tag without a name, or with the same name."""
    for name, count in Counter(element.get("name") for element in elements).items():
        if not name:
            yield error(tag, f"{count} without a name")
        elif count > 1:
            yield error(f"{tag} {name}", f"{count} have this name")


#: Attributes of a frame of Drake.
_FRAME_ATTRIBUTES = ["name", "link", "xyz", "rpy"]


def _drake_frame(frame: ET.Element, links: Collection[str | None]) -> Iterator[Problem]:
    """Errors of a frame of Drake, which is fixed to one of the links."""
    where = f"frame {frame.get('name')}"
    for text in unknown_parts(frame, attributes=_FRAME_ATTRIBUTES):
        yield error(where, text)
    link = frame.get("link", "")
    if link not in links:
        yield error(where, f"link {link} is not a link of this file")
    for key in ("xyz", "rpy"):
        text = frame.get(key, "0 0 0")
        if numbers(text, 3) is None:
            yield error(where, f"{key}={text!r} is not three numbers")


def _connections(links: Sequence[str], joints: Sequence[ET.Element]) -> Iterator[Problem]:
    """Errors of links, by their names, and joints that form no tree."""
    known = set(links)
    parent_joints = dict[str, str]()  # by child
    children = dict[str, list[str]]()  # by parent
    for joint in joints:
        name = joint.get("name", "")
        parent = attribute(joint, "parent/link")
        child = attribute(joint, "child/link")
        for role, link in (("parent", parent), ("child", child)):
            if not link:
                yield error(f"joint {name}", f"no <{role} link=...>")
            elif link not in known:
                yield error(f"joint {name}", f"{role} {link} is not a link of this file")
        if not parent or not child:
            continue
        if child in parent_joints:
            other = parent_joints[child]
            text = f"link {child} is already the child of joint {other}; a URDF is a tree"
            text += ": cut the loop here and add a closure to the YAML of the cuts"
            yield error(f"joint {name}", text)
        else:
            parent_joints[child] = name
            children.setdefault(parent, []).append(child)

    # Links that no joint moves: the base, and others that are not connected to it.
    roots = [link for link in dict.fromkeys(links) if link not in parent_joints]
    if len(roots) > 1:
        text = f"{len(roots)} links without a parent: {', '.join(roots)}"
        yield error("tree", f"{text}; only the base may have none")
    unreachable = dict.fromkeys(links)  # a dictionary, to keep the order
    queue = list(roots)
    while queue:
        link = queue.pop()
        unreachable.pop(link, None)
        queue += children.get(link, [])
    if unreachable:
        yield error("tree", f"links that are not connected to the base: {', '.join(unreachable)}")


#: All attributes that URDF gives to some elements, which change the motion.
_ATTRIBUTES = {
    "origin": ["xyz", "rpy"],
    "mass": ["value"],
    "inertia": list(ENTRIES),
    "axis": ["xyz"],
    "limit": ["lower", "upper", "effort", "velocity"],
    "dynamics": ["damping", "friction"],
    "mimic": ["joint", "multiplier", "offset"],
}


def _faults(element: ET.Element) -> Iterator[str]:
    """Faults of the parts of a link or a joint that change the motion: unknown or repeated parts.

    Parts that other tools add are no faults, unless their names look like misspellings.
    """
    if element.tag == "link":
        tags = ["inertial"]
        several = ["visual", "collision"]
    else:
        tags = ["origin", "parent", "child", "axis", "limit", "dynamics", "mimic"]
        several = ["calibration", "safety_controller"]
    yield from unknown_parts(
        element, tags=tags, attributes=["name", "type"], several=several, others=True
    )
    for part in element:
        if part.tag in tags:
            yield from _faults_of_part(part)


def _faults_of_part(part: ET.Element) -> Iterator[str]:
    """Faults of the attributes and elements in a part of a link or a joint."""
    if part.tag == "inertial":
        yield from unknown_parts(part, tags=["origin", "mass", "inertia"], others=True)
        for child in part:
            if child.tag in ("origin", "mass", "inertia"):
                yield from _faults_of_part(child)
    elif part.tag in ("limit", "dynamics", "axis"):
        # Tools add attributes to these parts. `acting_elements` warns of those that act.
        yield from unknown_parts(part, attributes=_ATTRIBUTES[part.tag], others=True)
    elif part.tag in _ATTRIBUTES:
        yield from unknown_parts(part, attributes=_ATTRIBUTES[part.tag])


def _link(link: ET.Element, where: str) -> Iterator[Problem]:
    """Errors of the parts of a link, of its mass and its inertia."""
    for text in _faults(link):
        yield error(where, text)
    for inertial in link.findall("inertial"):
        yield from wrong_numbers(inertial, where)
        mass = number(inertial.find("mass"), "value")
        if mass is None:
            yield error(where, "its mass is not a number")
        elif mass < 0:
            yield error(where, f"its mass is negative, {mass:g} kg")
        inertia = inertial.find("inertia")
        missing = [key for key in ENTRIES if number(inertia, key) is None]
        if missing:
            yield error(where, f"its inertia has no number {', '.join(missing)}")


def _joint(joint: ET.Element, where: str, kinds: Mapping[str | None, str]) -> Iterator[Problem]:
    """Problems of a joint; `kinds` are the types of all joints by name."""
    kind = joint.get("type", "")
    for text in _faults(joint):
        yield error(where, text)
    yield from wrong_numbers(joint, where)
    if joint.get("name") == "universe":
        yield error(where, "Pinocchio's base has this name; rename the joint")
    if kind not in _KINDS:
        yield error(where, f"type {kind!r} unknown; known: {', '.join(_KINDS)}")
    if kind in ("floating", "planar"):
        yield note(where, f"{kind}: q has one more entry than v")
    if kind == "continuous":
        yield note(where, "continuous: two coordinates in Pinocchio; read as revolute here")
    if kind != "fixed":
        yield from _axis(joint, where, kind)
        yield from _friction(joint, where, kind)
    if kind in ONE_AXIS:
        yield from _limits(joint, where, kind)
    for mimic in joint.findall("mimic"):
        yield from _mimic(joint.get("name"), mimic.get("joint"), where, kinds)


def _mimic(
    follower: str | None, leader: str | None, where: str, kinds: Mapping[str | None, str]
) -> Iterator[Problem]:
    """Errors of a joint, `follower`, that follows the joint `leader`; both need one axis."""
    for name in (follower, leader):
        if name not in kinds:
            yield error(where, f"mimics {name}, which is not a joint of this file")
        elif kinds[name] not in ONE_AXIS:
            yield error(where, f"mimics {leader}: {name} is {kinds[name]}")
    if leader == follower:
        yield error(where, "mimics itself")


#: How many numbers an attribute has, by the tag of its element and its name.
_COUNTS = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "limit": {"lower": 1, "upper": 1, "effort": 1, "velocity": 1},
    "dynamics": {"damping": 1, "friction": 1},
    "mimic": {"multiplier": 1, "offset": 1},
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "mesh": {"scale": 3},
}
#: Largest deviation of an axis from unit length that is rounding of its written digits.
_AXIS_ROUNDING = 1e-6


def wrong_numbers(parent: ET.Element, where: str) -> Iterator[Problem]:
    """Errors of children of an element: attributes that are not as many numbers as `_COUNTS`."""
    for element in parent:
        for key, count in _COUNTS.get(element.tag, {}).items():
            text = element.get(key)
            if text is not None and numbers(text, count) is None:
                need = "a number" if count == 1 else "three numbers"
                yield error(where, f"{element.tag} {key}={text!r} is not {need}")


#: An axis with a larger entry is refused: beyond 1e154 the square of its length overflows.
_LONGEST_AXIS = 1e100


def _axis(joint: ET.Element, where: str, kind: str) -> Iterator[Problem]:
    """Problems of the direction of an axis."""
    axis = joint.find("axis")
    # Without <axis> it is x by the specification of URDF; an <axis> without a direction is wrong.
    text = "1 0 0" if axis is None else axis.get("xyz", "0 0 0")
    direction = numbers(text, 3)
    if direction is None:
        return
    largest = np.abs(direction).max()
    if largest <= SHORTEST_AXIS:
        yield error(where, "its axis is zero")
    elif largest >= _LONGEST_AXIS:
        yield error(where, "its axis is too long")
    elif abs(np.linalg.norm(direction) - 1) > _AXIS_ROUNDING:
        yield warning(where, f"its axis has length {np.linalg.norm(direction):.6g}, not 1")
    is_along_z = direction[2] > 0 and not direction[:2].any()
    if kind == "planar" and not is_along_z:
        text = f"planar about {text}; Pinocchio moves it in x and y whatever its axis: turn "
        yield error(where, text + "the joint's frame until the axis is 0 0 1")


def _friction(joint: ET.Element, where: str, kind: str) -> Iterator[Problem]:
    """Errors of friction that is negative or that Pinocchio does not read."""
    dynamics = joint.find("dynamics")
    for key, yaml_key in (("damping", "viscous_friction"), ("friction", "coulomb_friction")):
        value = number(dynamics, key) or 0.0
        if value and kind not in ONE_AXIS:
            cure = f"write {yaml_key}: {{{joint.get('name')}: {value:g}}} in the YAML"
            yield error(where, f"{key} of a {kind} joint is not read; {cure}")
        elif value < 0:
            text = f"dynamics {key}={attribute(joint, f'dynamics/{key}')!r} is negative"
            yield error(where, f"{text}: it would accelerate the joint")


def _limits(joint: ET.Element, where: str, kind: str) -> Iterator[Problem]:
    """Problems of limits that are negative, reversed or equal."""
    limit = joint.find("limit")
    if limit is None:
        return
    for key in ("effort", "velocity"):
        if (number(limit, key) or 0) < 0:
            yield error(where, f"limit {key}={limit.get(key)!r} is negative")
    if kind == "continuous":
        return
    # By the specification of URDF, a missing limit of the position is 0.
    lower = 0.0 if limit.get("lower") is None else number(limit, "lower")
    upper = 0.0 if limit.get("upper") is None else number(limit, "upper")
    if lower is None or upper is None:  # `wrong_numbers` reports it
        return
    if lower > upper:
        yield error(where, f"lower limit {lower:g} above the upper one {upper:g}")
    elif lower == upper:
        text = f"limits [{lower:g}, {upper:g}]: tools that enforce limits lock the joint"
        yield note(where, text)
