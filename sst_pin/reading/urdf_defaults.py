# SPDX-License-Identifier: BSD-2-Clause
"""Adds to a URDF what it lacks and Drake or Bullet assume."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator

from ..summaries import listed
from .problems import Problem, warning

#: Limit of a joint that has none, [rad] or [m].
WIDE = "1e9"


def add_defaults(root: ET.Element) -> Iterator[Problem]:
    """Add the link `world` and limits that are missing; a warning names each."""
    links = {link.get("name") for link in root.findall("link")}
    joints = root.findall("joint")
    if "world" not in links and root.find("joint/parent[@link='world']") is not None:
        ET.SubElement(root, "link", name="world")
        yield warning("link world", "it is missing; it is added, without mass")
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
