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
from .problems import ALIKE, collecting_problems, numbers
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


#: Largest deviation of a normalized quaternion from the length 1.
_NORMALIZED = 1e-9
#: Positions by the names of joints.
_Pose = dict[str, Array]


class Srdf:
    """An SRDF, read and parsed once."""

    def __init__(self, path: Path) -> None:
        self._source = str(path)
        self._root = parse_xml(read_text(path, "SRDF"), self._source, "an SRDF")

    def load_configurations(
        self, model: pin.Model, joints: Collection[str], locked: Collection[str]
    ) -> list[str]:
        """Put the named configurations into a model, as its `referenceConfigurations`.

        States of several groups with one name are one configuration.

        Args:
            model: The tree; it has joints that are locked later.
            joints: Names of all joints of the URDF.
            locked: Names of joints that the caller locks at zero.

        Returns:
            Notes on states that move locked joints.

        Raises:
            DescriptionError: It lists all problems of the states.
        """
        problems = list(self._unknown_elements())
        notes = list[str]()
        poses = dict[str, _Pose]()  # by the name of the state
        for state in self._root.findall("group_state"):
            name = state.get("name", "")
            where = f"group_state {name}: "
            if not name:
                problems.append("a group_state has no name")
            pose = poses.setdefault(name, {})
            for element in state.findall("joint"):
                with collecting_problems(problems, where):
                    _add_position(pose, element, model, joints)
                    notes += _note_of_locked_joint(element, pose, model, locked, where)
        configurations = {name: configuration(model, pose) for name, pose in poses.items()}
        for name, q in configurations.items():
            if not pin.isNormalized(model, q, _NORMALIZED):  # a quaternion of zeros
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
            similar = get_close_matches(tag, _ELEMENTS, 1, ALIKE)
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


def _add_position(
    pose: _Pose, element: ET.Element, model: pin.Model, joints: Collection[str]
) -> None:
    """Add the position of a joint in a state to its pose; a ValueError if this is not possible."""
    joint = element.get("name", "")
    value = _value(model, joints, joint, element.get("value", ""))
    first_value = pose.setdefault(joint, value)  # of several elements for one joint
    if (first_value != value).any():
        text = element.get("value", "")
        raise ValueError(f"{joint} has two values, {text} is one of them")


def _note_of_locked_joint(
    element: ET.Element, pose: _Pose, model: pin.Model, locked: Collection[str], where: str
) -> list[str]:
    """A note if a state has another position than zero of a locked joint.

    Raises:
        ValueError: If the joint is fixed in the URDF.
    """
    joint = element.get("name", "")
    can_move = model.existJointName(joint) and joint not in locked
    if can_move or not pose[joint].any():
        return []
    text = f"{joint} is fixed at zero, not at {element.get('value', '')}"
    if joint not in locked:
        raise ValueError(text)
    return [where + text]


def _value(model: pin.Model, joints: Collection[str], joint: str, text: str) -> Array:
    """The position of a joint from a text of the file: as many numbers as it has in q.

    A fixed joint has one number. `joints` are the names of the joints of the URDF. If one of them
    is a universal joint by the YAML, the model has two joints in its place.
    """
    if model.existJointName(joint):
        size = model.joints[model.getJointId(joint)].nq
    else:
        candidates = [f"{joint}_{axis}" for axis in "XYZ"]  # parts of a universal joint
        parts = [part for part in candidates if model.existJointName(part) and part not in joints]
        if parts:
            raise ValueError(f"{joint} is {' and '.join(parts)} here")
        if joint not in joints:
            raise ValueError(f"no joint {joint} in the URDF")
        size = 1
    value = numbers(text, size)
    if value is None:
        need = "a number" if size == 1 else f"{size} numbers"
        raise ValueError(f"{joint} value={text!r} is not {need}")
    return value


def configuration(model: pin.Model, values: Mapping[str, ArrayLike]) -> Array:
    """The configuration with the values of some joints; the other joints are neutral.

    Values of joints that the model does not have, such as fixed joints, are left out.
    """
    q = pin.neutral(model)
    for joint in list(model.joints)[1:]:
        entries = slice(joint.idx_q, joint.idx_q + joint.nq)
        q[entries] = values.get(model.names[joint.id], q[entries])
    return np.asarray(pin.normalize(model, q))
