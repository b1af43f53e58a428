# SPDX-License-Identifier: BSD-2-Clause
"""An SRDF: named configurations, and pairs of links that need no collision check."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator
from pathlib import Path

import pinocchio as pin

from ..errors import DescriptionError
from .problems import numbers
from .text import parse_xml, read_text


class Srdf:
    """An SRDF, read and parsed once."""

    def __init__(self, path: Path) -> None:
        self._source, self._text = str(path), read_text(path, "SRDF")
        self._root = parse_xml(self._text, self._source, "an SRDF")

    def load_configurations(self, model: pin.Model, held: Collection[str] = ()) -> None:
        """Put the named configurations into a model, as its `referenceConfigurations`.

        Joints in `held` may be named though the tree does not have them. What Pinocchio would leave
        at zero in silence is refused.
        """
        if problems := list(_configurations(self._root, model, held)):
            raise DescriptionError(self._source, problems)
        pin.loadReferenceConfigurationsFromXML(model, self._text, False)

    def remove_pairs(self, model: pin.Model, collision: pin.GeometryModel) -> None:
        """Leave out the pairs of links that need no check; unknown links are refused."""
        if problems := list(_pairs(self._root, model)):
            raise DescriptionError(self._source, problems)
        pin.removeCollisionPairsFromXML(model, collision, self._text, False)


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
