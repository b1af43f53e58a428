# SPDX-License-Identifier: BSD-2-Clause
"""Kinds of joints that a URDF lacks, such as balls and universal joints.

The URDF has a joint of one axis in place of such a joint. The YAML beside the URDF names its true
kind, in the words of the LAAS schema, see `cuts`. In the model, one or two joints in series, the
parts of the true joint, replace the joint of one axis.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Set
from itertools import permutations
from typing import Any

import numpy as np
import pinocchio as pin

from ..errors import DescriptionError
from ..model.conventions import NO_LIMIT
from ..model.joint_series import Series
from ..model.rebuilt_tree import rebuilt
from .problems import Problem, number, numbers, warning

#: Joints of Pinocchio in series, by suffix. Their names are the name of the joint in the URDF with
#: this suffix.
JointsBySuffix = Mapping[str, Any]
#: Revolute joints about the axes of their frame.
_TURNS = {"X": pin.JointModelRX(), "Y": pin.JointModelRY(), "Z": pin.JointModelRZ()}


def _kinds() -> dict[str, JointsBySuffix]:
    """The parts of a joint, by its kind; none for a joint that is fixed."""
    ball = {"": pin.JointModelSpherical()}
    kinds: dict[str, JointsBySuffix] = {
        "FIXED": {},
        "BALL": ball,
        "SPHERICAL": ball,
        "UNIVERSAL": {"_X": _TURNS["X"], "_Y": _TURNS["Y"]},
    }
    for first, second in permutations(_TURNS, 2):
        series = {f"_{first}": _TURNS[first], f"_{second}": _TURNS[second]}
        kinds[f"UNIVERSAL {first}{second}"] = series
        kinds[f"UJOINT_{first}{second}"] = series
    return kinds


#: Kinds of joints, such as "BALL", "UNIVERSAL XY" or "UJOINT_XY"; see `_kinds`.
KINDS = _kinds()


def with_kinds(
    model: pin.Model, root: ET.Element, kinds: Mapping[str, str], source: str
) -> pin.Model:
    """The tree of a URDF with the true kinds of some joints.

    All parts have the friction of the joint that they replace. Limits go to the axis that the joint
    has in the URDF: a part that turns about this axis has all limits, and the rate of a ball about
    this axis has the limits of effort and velocity.

    Args:
        model: The tree, with joints of one axis.
        root: The URDF.
        kinds: Kinds of joints, by their names.
        source: The file, for messages.
    """
    parts_of = {name: KINDS[kind] for name, kind in kinds.items() if KINDS[kind]}
    if not parts_of:
        return model
    _require_new_names(model, parts_of, source)
    changes = {model.getJointId(name): Series.named(parts) for name, parts in parts_of.items()}
    result = rebuilt(model, changes).model
    for name, parts in parts_of.items():
        old_joint = model.joints[model.getJointId(name)]
        for suffix in parts:
            part = result.joints[result.getJointId(name + suffix)]
            rates = slice(part.idx_v, part.idx_v + part.nv)
            result.damping[rates] = model.damping[old_joint.idx_v]
            result.friction[rates] = model.friction[old_joint.idx_v]
            # Each rate of the part with the axis about which it turns.
            for rate, axis in enumerate(_axes(suffix), start=part.idx_v):
                sense = _sense(root, name, axis)
                if sense:
                    result.effortLimit[rate] = model.effortLimit[old_joint.idx_v]
                    result.velocityLimit[rate] = model.velocityLimit[old_joint.idx_v]
                    if part.nq == 1:  # no ball, which has no limits of its position
                        _put_position_limits(result, part, model, old_joint, sense)
    return result


def _require_new_names(
    model: pin.Model, parts_of: Mapping[str, JointsBySuffix], source: str
) -> None:
    """Raise an error if a part of a joint would have the name of another joint."""
    names = {frame.name for frame in model.frames if frame.type != pin.FrameType.BODY}
    for name, parts in parts_of.items():
        for suffix in parts:
            if suffix and name + suffix in names:
                text = f"joint {name}{suffix}: 2 have this name, a part of {name} is one of them"
                raise DescriptionError(source, [text])


#: Largest deviation of the cosine from 1 between two axes that count as the same.
_SAME_AXIS = 1e-9


def _axes(suffix: str) -> str:
    """The axes about which the rates of a part turn; a ball, which has no suffix, has three."""
    return suffix.removeprefix("_") or "XYZ"


def _joint_named(root: ET.Element, name: str) -> ET.Element | None:
    """The joint of this name in the URDF, if there is one."""
    for joint in root.findall("joint"):  # an XPath with the name would fail for a quotation mark
        if joint.get("name") == name:
            return joint
    return None


def _sense(root: ET.Element, name: str, axis_name: str) -> int:
    """The sense of an axis X, Y or Z of a joint's frame relative to the joint's axis in the URDF.

    1 means the same direction, -1 the opposite one, 0 any other.
    """
    joint = _joint_named(root, name)
    axis = None if joint is None else joint.find("axis")
    direction = numbers("1 0 0" if axis is None else axis.get("xyz", ""), 3)
    if direction is None:
        return 0
    cosine = direction["XYZ".index(axis_name)] / np.linalg.norm(direction)
    if abs(cosine) <= 1 - _SAME_AXIS:
        return 0
    return int(np.sign(cosine))


def _put_position_limits(
    result: pin.Model, part: Any, model: pin.Model, old_joint: Any, sense: int
) -> None:
    """Give a part of `result` the position limits of the joint of `model` that it replaces.

    If the part turns against the axis, with the sense -1, its position has the opposite sign.
    """
    limit_1 = sense * model.lowerPositionLimit[old_joint.idx_q]
    limit_2 = sense * model.upperPositionLimit[old_joint.idx_q]
    result.lowerPositionLimit[part.idx_q] = min(limit_1, limit_2)
    result.upperPositionLimit[part.idx_q] = max(limit_1, limit_2)


def lost_limits(
    root: ET.Element, kinds: Mapping[str, str], with_other_limits: Set[str]
) -> Iterator[Problem]:
    """Warnings of limits of a URDF that are lost, since the true joint does not have their axis.

    There is no warning for joints with a part in `with_other_limits`, names of joints to which the
    YAML gives limits.
    """
    for name, kind in kinds.items():
        joint = _joint_named(root, name)
        limit = None if joint is None else joint.find("limit")
        suffixes = list(KINDS[kind])
        if limit is None or not suffixes:
            continue
        names = [name + suffix for suffix in suffixes]
        if not with_other_limits.isdisjoint(names):
            continue
        has_axis = any(_sense(root, name, axis) for suffix in suffixes for axis in _axes(suffix))
        is_ball = suffixes == [""]
        lost = list[str]()
        lower = number(limit, "lower") or 0.0
        upper = number(limit, "upper") or 0.0
        # Limits of half a turn to both sides exclude no orientation.
        has_limits = lower > -np.pi or upper < np.pi
        if has_limits and (is_ball or not has_axis):
            lost.append(f"of {lower:g} to {upper:g}")
        for key in ("effort", "velocity"):
            value = number(limit, key) or 0.0
            if 0 < value < NO_LIMIT and not has_axis:  # zero is no limit
                lost.append(f"{key} {value:g}")
        if lost:
            text = f"its limits {', '.join(lost)} are not used: it is {kind} in the YAML and has "
            text += "no such axis"
            if len(names) > 1:
                text += f"; write joint_limit: {{{names[0]}: {{lower: .., upper: ..}}}}"
            yield warning(f"joint {name}", text)
