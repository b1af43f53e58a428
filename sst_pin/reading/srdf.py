# SPDX-License-Identifier: BSD-2-Clause
"""An SRDF: named configurations, and pairs of links that need no collision check."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator
from pathlib import Path

import pinocchio as pin

from ..errors import DescriptionError
from .problems import numbers
from .text import read_text
from .urdf import parse_xml


def load_configurations(path: str | Path, model: pin.Model, held: Collection[str] = ()) -> None:
    """Put the named configurations of an SRDF into a model, as its `referenceConfigurations`.

    Args:
        path: The SRDF; its pairs of links are not looked at.
        model: The tree that it belongs to.
        held: Joints that the SRDF may name though the tree does not have them.

    Raises:
        DescriptionError: When it cannot be read, with every problem found.
    """
    root = parse_xml(read_text(path, "SRDF"), str(path), "an SRDF")
    if problems := list(_configurations(root, model, held)):
        raise DescriptionError(str(path), problems)
    pin.loadReferenceConfigurations(model, str(path), False)


def check_srdf(path: str | Path, model: pin.Model) -> None:
    """Refuse what Pinocchio would leave at zero, or leave out, in silence.

    Args:
        path: The SRDF.
        model: The tree that it belongs to.

    Raises:
        DescriptionError: When it cannot be read, with every problem found.
    """
    root = parse_xml(read_text(path, "SRDF"), str(path), "an SRDF")
    if problems := [*_configurations(root, model), *_pairs(root, model)]:
        raise DescriptionError(str(path), problems)


def _configurations(
    root: ET.Element, model: pin.Model, held: Collection[str] = ()
) -> Iterator[str]:
    if root.tag != "robot":
        yield f"an SRDF starts with <robot>, not with <{root.tag}>"
    for state in root.findall("group_state"):
        where = f"group_state {state.get('name')}"
        for joint in state.findall("joint"):
            name = joint.get("name", "")
            if name in held:
                continue
            if not model.existJointName(name):
                yield f"{where}: no joint {name} in the URDF"
                continue
            size, value = model.joints[model.getJointId(name)].nq, joint.get("value", "")
            if numbers(value, size) is None:
                wanted = "a number" if size == 1 else f"{size} numbers"
                yield f"{where}: {name} value={value!r} is not {wanted}"


def _pairs(root: ET.Element, model: pin.Model) -> Iterator[str]:
    for pair in root.findall("disable_collisions"):
        for link in (pair.get("link1", ""), pair.get("link2", "")):
            if not model.existBodyName(link):
                yield f"disable_collisions: no link {link} in the URDF"
