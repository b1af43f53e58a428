# SPDX-License-Identifier: BSD-2-Clause
"""Names, tree, axes and limits of a URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from .problems import Problem, error, numbers, origins, warning

_KINDS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")


def check(root: ET.Element) -> Iterator[Problem]:
    """Problems of a URDF's skeleton."""
    if root.tag != "robot":
        yield error("file", f"a URDF begins with <robot>, not with <{root.tag}>")
        return
    links, joints = root.findall("link"), root.findall("joint")
    if not links:
        yield error("file", "no links")
    for elements in (links, joints):
        yield from _names(elements)
    yield from _connections([link.get("name", "") for link in links], joints)
    for joint in joints:
        yield from _joint(joint)


def ends(joint: ET.Element) -> tuple[str | None, str | None]:
    """Names of the links that a joint connects, parent and child."""
    parent, child = joint.find("parent"), joint.find("child")
    return (
        None if parent is None else parent.get("link"),
        None if child is None else child.get("link"),
    )


def _names(elements: Sequence[ET.Element]) -> Iterator[Problem]:
    for name, count in Counter(element.get("name") for element in elements).items():
        tag = elements[0].tag
        if not name:
            yield error(tag, f"{count} without a name")
        elif count > 1:
            yield error(f"{tag} {name}", f"{count} have this name")


def _connections(links: Sequence[str], joints: Sequence[ET.Element]) -> Iterator[Problem]:
    children: dict[str, list[str]] = {}
    bearers: dict[str, str] = {}
    for joint in joints:
        where = f"joint {joint.get('name')}"
        parent, child = ends(joint)
        for role, link in (("parent", parent), ("child", child)):
            if link is None:
                yield error(where, f"no <{role} link=...>")
            elif link not in links:
                yield error(where, f"{role} {link} is no link of this file")
        if parent is None or child is None:
            continue
        if child in bearers:
            yield error(
                where,
                f"link {child} hangs on joint {bearers[child]} already; a URDF is a tree: "
                "cut the loop, and close it in the YAML of the cuts",
            )
        bearers.setdefault(child, str(joint.get("name")))
        children.setdefault(parent, []).append(child)
    roots = [link for link in dict.fromkeys(links) if link not in bearers]
    if len(roots) > 1:
        yield error("tree", f"{len(roots)} links without a parent: {', '.join(roots)}; one is base")
    reached, found = set(roots), list(roots)
    while found:
        new = [child for child in children.get(found.pop(), []) if child not in reached]
        reached.update(new)
        found += new
    if lost := [link for link in dict.fromkeys(links) if link not in reached]:
        yield error("tree", f"links in a circle, or below one: {', '.join(lost)}")


def _joint(joint: ET.Element) -> Iterator[Problem]:
    where, kind = f"joint {joint.get('name')}", joint.get("type")
    yield from origins(joint, where)
    if kind not in _KINDS:
        yield error(where, f"type {kind!r} unknown; known: {', '.join(_KINDS)}")
    elif kind in ("floating", "planar"):
        yield error(where, f"{kind}: several coordinates; a closed chain here stands on its base")
    elif kind != "fixed":
        yield from _axis(joint, where)
        yield from _limits(joint, where, kind)
    if kind == "continuous":
        yield warning(where, "continuous: two coordinates in Pinocchio; read as revolute here")
    for mimic in joint.findall("mimic"):
        yield error(where, f"mimics {mimic.get('joint')}; Pinocchio would let it go free")


def _axis(joint: ET.Element, where: str) -> Iterator[Problem]:
    axis = joint.find("axis")
    if axis is None:
        return  # x by default
    direction = numbers(axis.get("xyz", ""), 3)
    if direction is None:
        yield error(where, f"axis xyz={axis.get('xyz')!r} is not three numbers")
    elif not direction.any():
        yield error(where, "its axis has no direction")
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
        else:
            values[key] = float(value[0])
    if kind == "continuous" or not {"lower", "upper"} <= values.keys():
        return
    lower, upper = values["lower"], values["upper"]
    if lower > upper:
        yield error(where, f"lower limit {lower:g} above the upper one {upper:g}")
    elif lower == upper:
        yield warning(where, f"limits [{lower:g}, {upper:g}]: tools that keep to them hold it fast")
