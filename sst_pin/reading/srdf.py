# SPDX-License-Identifier: BSD-2-Clause
"""An SRDF: named configurations, and pairs of links that need no collision check."""

import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator, Mapping
from difflib import get_close_matches
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import DescriptionError
from .problems import collecting_problems, numbers
from .text import parse_xml, read_text

#: Elements of an SRDF. Others are left alone, unless they look like one of these.
_ELEMENTS = (
    "group",
    "group_state",
    "end_effector",
    "virtual_joint",
    "passive_joint",
    "joint_property",
    "disable_collisions",
    "enable_collisions",
    "disable_default_collisions",
    "link_sphere_approximation",
)


class Srdf:
    """An SRDF, read and parsed once."""

    def __init__(self, path: Path) -> None:
        self._source = str(path)
        self._root = parse_xml(read_text(path, "SRDF"), self._source, "an SRDF")

    def load_configurations(
        self, model: pin.Model, joints: Collection[str], locked: Collection[str]
    ) -> list[str]:
        """Put the named configurations into a model, as its `referenceConfigurations`.

        States of several groups with one name are one configuration. `joints` are those of the
        URDF; the result says which states move joints that the caller locks.
        """
        problems = list(self._unknown_elements())
        notes = list[str]()
        # Position of each joint, by the names of states and joints.
        poses = dict[str, dict[str, Array]]()
        for state in self._root.findall("group_state"):
            name = state.get("name", "")
            where = f"group_state {state.get('name')}: "
            if not name:
                problems.append("a group_state has no name")
            pose = poses.setdefault(name, {})
            for element in state.findall("joint"):
                joint = element.get("name", "")
                text = element.get("value", "")
                with collecting_problems(problems, where):
                    value = _value(model, joints, joint, text)
                    if (pose.setdefault(joint, value) != value).any():
                        raise ValueError(f"{joint} has two values, {text} is one of them")
                    can_move = model.existJointName(joint) and joint not in locked
                    if value.any() and not can_move:
                        problem = f"{joint} is fixed at zero, not at {text}"
                        if joint not in locked:
                            raise ValueError(problem)
                        notes.append(where + problem)
        configurations = {name: configuration(model, pose) for name, pose in poses.items()}
        for name, q in configurations.items():
            if not pin.isNormalized(model, q, 1e-9):  # a quaternion of zeros
                problems.append(f"group_state {name}: a rotation in it has no direction")
        if problems:
            raise DescriptionError(self._source, problems)
        for name, q in configurations.items():
            model.referenceConfigurations[name] = q
        return notes

    def _unknown_elements(self) -> Iterator[str]:
        """Problems of a file that is no SRDF, and of misspelt elements."""
        if self._root.tag != "robot":
            yield f"an SRDF starts with <robot>, not with <{self._root.tag}>"
        for tag in sorted({element.tag for element in self._root}.difference(_ELEMENTS)):
            similar = get_close_matches(tag, _ELEMENTS, 1, 0.8)
            if similar:
                yield f"<{tag}> is unknown; did you mean {similar[0]}?"

    def remove_pairs(self, model: pin.Model, collision: pin.GeometryModel) -> None:
        """Leave out the pairs of links that need no check; unknown links are refused."""
        problems = []
        for pair in self._root.findall("disable_collisions"):
            for key in ("link1", "link2"):
                link = pair.get(key, "")
                if not model.existBodyName(link):
                    problems.append(f"disable_collisions: no link {link} in the URDF")
        if problems:
            raise DescriptionError(self._source, problems)
        text = ET.tostring(self._root, encoding="unicode")
        pin.removeCollisionPairsFromXML(model, collision, text, False)


def _value(model: pin.Model, joints: Collection[str], joint: str, text: str) -> Array:
    """The position of a joint; one number for a joint that is fixed in the model."""
    moves = model.existJointName(joint)
    axes = [f"{joint}_{axis}" for axis in "XYZ"]  # of a universal joint in the YAML
    parts = [part for part in axes if model.existJointName(part) and part not in joints]
    if not moves and parts:
        raise ValueError(f"{joint} is {' and '.join(parts)} here")
    if not moves and joint not in joints:
        raise ValueError(f"no joint {joint} in the URDF")
    size = model.joints[model.getJointId(joint)].nq if moves else 1
    value = numbers(text, size)
    if value is None:
        need = "a number" if size == 1 else f"{size} numbers"
        raise ValueError(f"{joint} value={text!r} is not {need}")
    return value


def configuration(model: pin.Model, values: Mapping[str, ArrayLike]) -> Array:
    """The configuration with values of some joints, the others neutral."""
    q = pin.neutral(model)
    for joint in list(model.joints)[1:]:
        entries = slice(joint.idx_q, joint.idx_q + joint.nq)
        q[entries] = values.get(model.names[joint.id], q[entries])
    return np.asarray(pin.normalize(model, q))
