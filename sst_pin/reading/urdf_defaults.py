# SPDX-License-Identifier: BSD-2-Clause
"""Adds to a URDF what it lacks and Drake or Bullet assume."""

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator

from ..summaries import listed
from .problems import Problem, warning

#: Limit of a joint that has none, [rad] or [m]: `model.conventions.NO_LIMIT` as a text.
WIDE = "1e9"


def add_defaults(root: ET.Element) -> Iterator[Problem]:
    """Add the link `world`, limits, and joints of floating links; a warning names each."""
    links = [link.get("name", "") for link in root.findall("link")]
    joints = root.findall("joint")  # of the file, without the floating joints below
    if "world" not in links and root.find("joint/parent[@link='world']") is not None:
        ET.SubElement(root, "link", name="world")
        links.append("world")
        yield warning("link world", "it is missing; it is added, without mass")
    if "world" in links:
        yield from _add_floating_joints(root, links)
    joints_without_limit = list[str]()
    joints_by_missing_key = dict[str, list[str]]()
    joints_without_range = list[str]()
    for joint in joints:
        name = joint.get("name", "")
        if joint.get("type") not in ("revolute", "prismatic"):
            continue
        limit = joint.find("limit")
        if limit is None:
            attributes = {"lower": f"-{WIDE}", "upper": WIDE, "effort": "0", "velocity": "0"}
            ET.SubElement(joint, "limit", attributes)
            joints_without_limit.append(name)
            continue
        for key in ("effort", "velocity"):
            if key not in limit.attrib:
                limit.set(key, "0")
                joints_by_missing_key.setdefault(key, []).append(name)
        if "lower" not in limit.attrib and "upper" not in limit.attrib:
            joints_without_range.append(name)
    if joints_without_limit:
        yield warning(f"joints {listed(joints_without_limit)}", "no <limit>: read without limits")
    for key, names in joints_by_missing_key.items():
        yield warning(f"joints {listed(names)}", f"limit without {key}: read as none")
    if joints_without_range:
        # URDF's specification has this default. Drake and Bullet do not follow it.
        text = "limit without lower and upper: both are 0 by the specification; write them"
        yield warning(f"joints {listed(joints_without_range)}", text)


def _add_floating_joints(root: ET.Element, links: Iterable[str]) -> Iterator[Problem]:
    """Add a floating joint from `world` to each link that no joint moves or holds."""
    joint_names = {joint.get("name", "") for joint in root.findall("joint")}
    children = {child.get("link") for child in root.iterfind("joint/child")}
    for link in links:
        if link and link != "world" and link not in children:
            name = f"{link}_floats"
            while name in joint_names:
                name += "_"
            joint_names.add(name)
            joint = ET.SubElement(root, "joint", name=name, type="floating")
            ET.SubElement(joint, "parent", link="world")
            ET.SubElement(joint, "child", link=link)
            yield warning(f"link {link}", f"no joint holds it: it floats, by the joint {name}")
