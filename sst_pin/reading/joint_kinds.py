# SPDX-License-Identifier: BSD-2-Clause
"""Kinds of joints that a URDF lacks, such as balls and universal joints.

The URDF has a joint of one axis in their place. The YAML beside it says which kind the joint has,
as LAAS writes them. In the model, the joint is replaced by one or two joints in series.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Set
from itertools import permutations
from typing import Any

import numpy as np
import pinocchio as pin

from ..errors import DescriptionError
from ..model.joint_series import Series
from ..model.rebuilt_tree import rebuilt
from .joint_numbers import FAR
from .problems import Problem, number, numbers, warning

#: Joints in series by the suffixes of their names; the name without suffix is that of the joint in
#: the URDF.
JointsBySuffix = Mapping[str, Any]
#: Revolute joints about the axes of their frame.
_TURNS = {"X": pin.JointModelRX(), "Y": pin.JointModelRY(), "Z": pin.JointModelRZ()}


def _kinds() -> dict[str, JointsBySuffix]:
    """The joints in series that replace a joint, by its kind; none for a joint that is fixed."""
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

    The joints that replace a joint have its friction. A joint that turns about the axis of the
    replaced one has its limits too. The rate of a ball about this axis has those of effort and
    velocity.

    Args:
        model: The tree, with joints of one axis.
        root: The URDF.
        kinds: Kinds of joints, by their names.
        source: The file, for messages.
    """
    series_of = {name: KINDS[kind] for name, kind in kinds.items() if KINDS[kind]}
    if not series_of:
        return model
    _require_new_names(model, series_of, source)
    changes = {model.getJointId(name): Series.named(series) for name, series in series_of.items()}
    result = rebuilt(model, changes)
    for name, series in series_of.items():
        replaced = model.joints[model.getJointId(name)]
        for suffix in series:
            part = result.joints[result.getJointId(name + suffix)]
            rates = slice(part.idx_v, part.idx_v + part.nv)
            result.damping[rates] = model.damping[replaced.idx_v]
            result.friction[rates] = model.friction[replaced.idx_v]
            for rate, axis in enumerate(_axes(suffix), part.idx_v):
                sense = _sense(root, name, axis)
                if sense:
                    result.effortLimit[rate] = model.effortLimit[replaced.idx_v]
                    result.velocityLimit[rate] = model.velocityLimit[replaced.idx_v]
                    if part.nq == 1:
                        _put_ends(result, part, model, replaced, sense)
    return result


def _require_new_names(
    model: pin.Model, series_of: Mapping[str, JointsBySuffix], source: str
) -> None:
    """Raise an error if a joint that replaces another one has the name of a third one."""
    names = {frame.name for frame in model.frames if frame.type != pin.FrameType.BODY}
    for name, series in series_of.items():
        for suffix in series:
            if suffix and name + suffix in names:
                text = f"joint {name}{suffix}: 2 have this name, a part of {name} is one of them"
                raise DescriptionError(source, [text])


#: Largest deviation of the cosine from 1 between two axes that count as the same.
_SAME_AXIS = 1e-9


def _axes(suffix: str) -> str:
    """The axes about which the rates of a part with a suffix turn: a ball has no suffix."""
    return suffix.removeprefix("_") or "XYZ"


def _sense(root: ET.Element, joint: str, axis_name: str) -> int:
    """How an axis X, Y or Z of its frame lies to the axis that a joint has in the URDF.

    1 means along this axis, -1 against it, 0 otherwise.
    """
    axis = root.find(f"joint[@name='{joint}']/axis")
    direction = numbers("1 0 0" if axis is None else axis.get("xyz", ""), 3)
    if direction is None:
        return 0
    cosine = direction["XYZ".index(axis_name)] / np.linalg.norm(direction)
    if abs(cosine) <= 1 - _SAME_AXIS:
        return 0
    return int(np.sign(cosine))


def _put_ends(result: pin.Model, part: Any, model: pin.Model, replaced: Any, sense: int) -> None:
    """Give a part of `result` the limits of the position that the replaced joint has in `model`.

    If the part turns against the axis, with the sense -1, its position has the opposite sign.
    """
    end_1 = sense * model.lowerPositionLimit[replaced.idx_q]
    end_2 = sense * model.upperPositionLimit[replaced.idx_q]
    result.lowerPositionLimit[part.idx_q] = min(end_1, end_2)
    result.upperPositionLimit[part.idx_q] = max(end_1, end_2)


def lost_limits(
    root: ET.Element, kinds: Mapping[str, str], with_other_limits: Set[str]
) -> Iterator[Problem]:
    """Warnings of limits in a URDF of joints whose true kind does not have their axis.

    Joints of one axis in `with_other_limits` get limits from elsewhere.
    """
    for name, kind in kinds.items():
        limit = root.find(f"joint[@name='{name}']/limit")
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
        if (lower > -np.pi or upper < np.pi) and (is_ball or not has_axis):
            lost.append(f"of {lower:g} to {upper:g}")
        for key in ("effort", "velocity"):
            value = number(limit, key) or 0.0
            if 0 < value < FAR and not has_axis:  # zero is no limit
                lost.append(f"{key} {value:g}")
        if lost:
            text = f"its limits {', '.join(lost)} are not used: it is {kind} in the YAML and has "
            text += "no such axis"
            if len(names) > 1:
                text += f"; write joint_limit: {{{names[0]}: {{lower: .., upper: ..}}}}"
            yield warning(f"joint {name}", text)
