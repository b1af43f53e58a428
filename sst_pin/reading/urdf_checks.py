# SPDX-License-Identifier: BSD-2-Clause
"""Checks of a URDF: names, tree, and numbers that would be lost."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator, Sequence
from difflib import get_close_matches

import numpy as np

from .problems import Problem, error, number, numbers, warning

#: Entries of an inertia.
ENTRIES = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_KINDS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
#: Elements that the dynamics are made of, and elements beside them.
INERTIAL = ("origin", "mass", "inertia")
FIXED = ("origin", "parent", "child")
MOVING = (*FIXED, "axis", "limit", "dynamics")
_SHAPES = ("visual", "collision")
_BESIDE = ("calibration", "safety_controller")
#: Attributes of elements that have no others.
_ATTRIBUTES = {
    "origin": ("xyz", "rpy"),
    "mass": ("value",),
    "inertia": ENTRIES,
    "axis": ("xyz",),
    "mimic": ("joint", "multiplier", "offset"),
}
#: Attributes of elements that may have others, of makers' own.
_OPEN = {"limit": ("lower", "upper", "effort", "velocity"), "dynamics": ("damping", "friction")}
#: Similarity of words from which one counts as misspelt.
_ALIKE = 0.8


def check(root: ET.Element) -> Iterator[Problem]:
    """Problems of a URDF that keep it from being read as it is meant, and warnings."""
    if root.tag != "robot":
        cure = "; ClosedChain.from_mjcf reads an MJCF" if root.tag == "mujoco" else ""
        yield error("file", f"a URDF starts with <robot>, not with <{root.tag}>{cure}")
        return
    links, joints = root.findall("link"), root.findall("joint")
    if any("xacro" in element.tag for element in root):
        yield error("file", "this is a xacro file; convert it to URDF with xacro")
    if not root.get("name"):
        yield error("file", "<robot> has no name")
    if not links:
        yield error("file", "no links")
    for elements in (links, joints):
        yield from check_names(elements)
    yield from _connections([link.get("name", "") for link in links], joints)
    for link in links:
        yield from _link(link)
    for joint in joints:
        yield from _joint(joint)
    yield from _mimics(joints)


def check_names(elements: Sequence[ET.Element]) -> Iterator[Problem]:
    """Names that are missing, and names that are not unique."""
    for name, count in Counter(element.get("name") for element in elements).items():
        tag = elements[0].tag
        if not name:
            yield error(tag, f"{count} without a name")
        elif count > 1:
            yield error(f"{tag} {name}", f"{count} have this name")


def ends(joint: ET.Element) -> tuple[str | None, str | None]:
    """Names of the links that a joint connects, parent and child."""
    parent, child = joint.find("parent"), joint.find("child")
    return (
        None if parent is None else parent.get("link"),
        None if child is None else child.get("link"),
    )


def _connections(links: Sequence[str], joints: Sequence[ET.Element]) -> Iterator[Problem]:
    known = set(links)
    children: dict[str, list[str]] = {}
    bearers: dict[str, str] = {}
    for joint in joints:
        where = f"joint {joint.get('name')}"
        parent, child = ends(joint)
        for role, link in (("parent", parent), ("child", child)):
            if link is None:
                yield error(where, f"no <{role} link=...>")
            elif link not in known:
                yield error(where, f"{role} {link} is not a link of this file")
        if parent is None or child is None:
            continue
        if child in bearers:
            yield error(
                where,
                f"link {child} is already the child of joint {bearers[child]}; a URDF is a tree: "
                "cut the loop here and add a closure to the YAML of the cuts",
            )
        bearers.setdefault(child, str(joint.get("name")))
        children.setdefault(parent, []).append(child)
    roots = [link for link in dict.fromkeys(links) if link not in bearers]
    if len(roots) > 1:
        yield error(
            "tree",
            f"{len(roots)} links without a parent: {', '.join(roots)}; only the base may have none",
        )
    reached, found = set(roots), list(roots)
    while found:
        new = [child for child in children.get(found.pop(), []) if child not in reached]
        reached.update(new)
        found += new
    if lost := [link for link in dict.fromkeys(links) if link not in reached]:
        yield error("tree", f"links that are not connected to the base: {', '.join(lost)}")


def _link(link: ET.Element) -> Iterator[Problem]:
    where, inertial = f"link {link.get('name')}", link.find("inertial")
    yield from _elements(link, where, once=("inertial",), others=_SHAPES)
    if inertial is None:
        return
    yield from _elements(inertial, where, once=INERTIAL)
    yield from _origin(inertial, where)
    mass = number(inertial.find("mass"), "value")
    if mass is None:
        yield error(where, "its mass is not a number")
    elif mass < 0:
        yield error(where, f"its mass is negative, {mass:g} kg")
    inertia = inertial.find("inertia")
    if missing := [key for key in ENTRIES if number(inertia, key) is None]:
        yield error(where, f"its inertia has no number {', '.join(missing)}")


def _joint(joint: ET.Element) -> Iterator[Problem]:
    where, kind = f"joint {joint.get('name')}", joint.get("type")
    yield from _elements(joint, where, once=(*MOVING, "mimic"), others=_BESIDE)
    yield from _origin(joint, where)
    if kind not in _KINDS:
        yield error(where, f"type {kind!r} unknown; known: {', '.join(_KINDS)}")
    elif kind != "fixed":
        yield from _axis(joint, where)
        yield from _dynamics(joint, where)
    if kind in ("floating", "planar"):
        yield warning(where, f"{kind}: q has one more entry than v")
    elif kind in ("revolute", "prismatic", "continuous"):
        yield from _limits(joint, where, kind)
    if kind == "planar":
        axis = joint.find("axis")
        text = "1 0 0" if axis is None else axis.get("xyz", "1 0 0")
        normal = numbers(text, 3)
        if normal is None or normal[:2].any() or not normal[2] > 0:
            text = f"planar about {text}; Pinocchio moves it in x and y whatever its axis: turn "
            yield error(where, text + "the joint's frame until the axis is 0 0 1")
    if kind == "continuous":
        yield warning(where, "continuous: two coordinates in Pinocchio; read as revolute here")


def _mimics(joints: Sequence[ET.Element]) -> Iterator[Problem]:
    """Problems of mimic joints."""
    kinds = {joint.get("name"): joint.get("type") for joint in joints}
    for joint in joints:
        where = f"joint {joint.get('name')}"
        for mimic in joint.findall("mimic"):
            other = mimic.get("joint")
            for name in (joint.get("name"), other):
                if name not in kinds:
                    yield error(where, f"mimics {name}, which is not a joint of this file")
                elif kinds[name] not in ("revolute", "prismatic", "continuous"):
                    yield error(where, f"mimics {other}: {name} is {kinds[name]}")
            if other == joint.get("name"):
                yield error(where, "mimics itself")
            for key in ("multiplier", "offset"):
                if mimic.get(key) is not None and number(mimic, key) is None:
                    yield error(where, f"mimic {key}={mimic.get(key)!r} is not a number")


def _elements(
    parent: ET.Element, where: str, once: Sequence[str], others: Sequence[str] = ()
) -> Iterator[Problem]:
    """Misspelt or repeated elements, and misspelt attributes."""
    tags = Counter(element.tag for element in parent)
    for tag in tags:
        yield from _slip(f"<{tag}>", tag, (*once, *others), where)
    yield from (
        error(where, f"{tags[tag]} <{tag}>; only one is allowed") for tag in once if tags[tag] > 1
    )
    for element in parent:
        only, some = _ATTRIBUTES.get(element.tag), _OPEN.get(element.tag)
        for key in element.attrib:
            if only and key not in only:
                text = f"<{element.tag}> has no {key}; it has {', '.join(only)}"
                yield error(where, text)
            elif some:
                yield from _slip(f"<{element.tag} {key}=...>", key, some, where)


def _slip(shown: str, word: str, known: Sequence[str], where: str) -> Iterator[Problem]:
    """A word that is nearly one of those known."""
    if word not in known and (meant := get_close_matches(word.lower(), known, 1, _ALIKE)):
        yield error(where, f"{shown} is unknown; did you mean {meant[0]}?")


def _origin(element: ET.Element, where: str) -> Iterator[Problem]:
    origin = element.find("origin")
    for key, text in {} if origin is None else origin.attrib.items():
        if key in ("xyz", "rpy") and numbers(text, 3) is None:
            yield error(where, f"origin {key}={text!r} is not three numbers")


def _axis(joint: ET.Element, where: str) -> Iterator[Problem]:
    axis = joint.find("axis")
    if axis is None:
        return  # x by default
    direction = numbers(axis.get("xyz", ""), 3)
    if direction is None:
        yield error(where, f"axis xyz={axis.get('xyz')!r} is not three numbers")
        return
    length = np.abs(direction).max()  # the norm of 1e200 overflows
    if not 1e-100 < length < 1e100:
        yield error(where, "its axis is zero")
    elif abs(np.linalg.norm(direction) - 1) > 1e-6:
        yield warning(where, f"its axis has length {np.linalg.norm(direction):.6g}, not 1")


def _limits(joint: ET.Element, where: str, kind: str) -> Iterator[Problem]:
    limit = joint.find("limit")
    if limit is None:
        if kind != "continuous":
            yield error(where, f"{kind} without <limit>")
        return
    values = {}
    for key, default in (("lower", "0"), ("upper", "0"), ("effort", None), ("velocity", None)):
        text = limit.get(key, default)
        value = None if text is None else numbers(text, 1)
        if text is None:
            yield error(where, f"limit without {key}")
        elif value is None:
            yield error(where, f"limit {key}={text!r} is not a number")
        elif key in ("effort", "velocity") and value[0] < 0:
            yield error(where, f"limit {key}={text!r} is negative")
        else:
            values[key] = float(value[0])
    if kind == "continuous" or not {"lower", "upper"} <= values.keys():
        return
    lower, upper = values["lower"], values["upper"]
    if lower > upper:
        yield error(where, f"lower limit {lower:g} above the upper one {upper:g}")
    elif lower == upper:
        yield warning(
            where, f"limits [{lower:g}, {upper:g}]: tools that enforce limits lock the joint"
        )


def _dynamics(joint: ET.Element, where: str) -> Iterator[Problem]:
    dynamics = joint.find("dynamics")
    if dynamics is None:
        return
    for key in _OPEN["dynamics"]:
        text = dynamics.get(key, "0")
        value = numbers(text, 1)
        if value is None:
            yield error(where, f"dynamics {key}={text!r} is not a number")
        elif value[0] < 0:
            yield error(
                where, f"dynamics {key}={text!r} is negative: it would accelerate the joint"
            )
