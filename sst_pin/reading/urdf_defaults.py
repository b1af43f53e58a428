# SPDX-License-Identifier: BSD-2-Clause
"""Adds to a URDF what it lacks and Drake or Bullet assume."""

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator

from ..summaries import listed
from .problems import Problem, warning

#: Limit of a joint that has none, [rad] or [m].
WIDE = "1e9"


def add_defaults(root: ET.Element) -> Iterator[Problem]:
    """Add the link `world`, limits, and joints of floating links; a warning names each."""
    links = [link.get("name", "") for link in root.findall("link")]
    joints = root.findall("joint")
    if "world" not in links and root.find("joint/parent[@link='world']") is not None:
        ET.SubElement(root, "link", name="world")
        links.append("world")
        yield warning("link world", "it is missing; it is added, without mass")
    if "world" in links:
        yield from _add_floating_joints(root, links)
    unlimited = list[str]()
    parts = dict[str, list[str]]()
    for joint in joints:
        name = joint.get("name", "")
        if joint.get("type") not in ("revolute", "prismatic"):
            continue
        limit = joint.find("limit")
        if limit is None:
            attributes = {"lower": f"-{WIDE}", "upper": WIDE, "effort": "0", "velocity": "0"}
            ET.SubElement(joint, "limit", attributes)
            unlimited.append(name)
            continue
        for key in ("effort", "velocity"):
            if key not in limit.attrib:
                limit.set(key, "0")
                parts.setdefault(key, []).append(name)
    if unlimited:
        yield warning(f"joints {listed(unlimited)}", "no <limit>: read without limits")
    for key, names in parts.items():
        yield warning(f"joints {listed(names)}", f"limit without {key}: read as none")


def _add_floating_joints(root: ET.Element, links: Iterable[str]) -> Iterator[Problem]:
    """Add a floating joint from `world` to each link that no joint moves or holds."""
    children = {child.get("link") for child in root.iterfind("joint/child")}
    for link in links:
        if link and link != "world" and link not in children:
            joint = ET.SubElement(root, "joint", name=f"{link}_floats", type="floating")
            ET.SubElement(joint, "parent", link="world")
            ET.SubElement(joint, "child", link=link)
            yield warning(
                f"link {link}", f"no joint holds it: it floats, by the joint {link}_floats"
            )
