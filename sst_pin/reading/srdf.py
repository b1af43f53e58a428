# SPDX-License-Identifier: BSD-2-Clause
"""An SRDF: named configurations, and pairs of links that need no collision check."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pinocchio as pin

from ..errors import DescriptionError
from .problems import number
from .text import read_text
from .urdf import parse_xml


def check_srdf(path: str | Path, model: pin.Model) -> None:
    """Refuse what Pinocchio would leave at zero, or leave out, in silence.

    Args:
        path: The SRDF.
        model: The tree that it belongs to.

    Raises:
        DescriptionError: When it cannot be read, with every problem found.
    """
    if problems := list(_problems(read_text(path, "SRDF"), str(path), model)):
        raise DescriptionError(str(path), problems)


def _problems(text: str, source: str, model: pin.Model) -> Iterator[str]:
    root = parse_xml(text, source, "an SRDF")
    if root.tag != "robot":
        yield f"an SRDF begins with <robot>, not with <{root.tag}>"
    for state in root.findall("group_state"):
        where = f"group_state {state.get('name')}"
        for joint in state.findall("joint"):
            name = joint.get("name", "")
            if not model.existJointName(name):
                yield f"{where}: no joint {name} in the URDF"
            elif number(joint, "value") is None:
                yield f"{where}: {name} value={joint.get('value')!r} is not a number"
    for pair in root.findall("disable_collisions"):
        for link in (pair.get("link1", ""), pair.get("link2", "")):
            if not model.existBodyName(link):
                yield f"disable_collisions: no link {link} in the URDF"
