# SPDX-License-Identifier: BSD-2-Clause
"""YAML files of other tools with the joints that close loops.

These are `loop_closures.yaml` of sw2robot and scikit-robot, and `robot_data.yaml` of fusion2URDF.
All loops are closed at q = 0.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pinocchio as pin

from ..arrays import Array
from .cut_joints import CutJoint, cut_joint
from .problems import vector
from .yaml_content import YamlContent, mapping_in, name_in, repeated, shown

#: Keys of a hinge of scikit-robot.
OF_HINGE = ("link_a", "link_b", "point", "axis")
#: Closing joints, dependent joints, and those with the motors.
_Parts = tuple[tuple[CutJoint, ...], tuple[str, ...], tuple[str, ...]]


def _of_scikit_robot(content: YamlContent) -> _Parts:
    """A `loop_closures.yaml`: hinges, by point and axis in base axes at q = 0."""
    content.require_known(("closures", "dependent", "independent"))
    hinges = content.entries("closures", _hinge)
    if not content["closures"]:
        content.problems.append("closures: a list of hinges is needed")
    content.update({key: content.get(key) for key in ("dependent", "independent")})
    dependent, independent = (content.entries(k, name_in) for k in ("dependent", "independent"))
    content.problems += [f"{name}: named twice" for name in repeated(dependent + independent)]
    names = (f"loop_closure_{k}" for k in range(1, len(hinges) + 1))
    joints = (hinge._replace(name=name) for hinge, name in zip(hinges, names, strict=True))
    return tuple(joints), tuple(dependent), tuple(independent)


def _hinge(value: Any) -> CutJoint:
    fields = mapping_in(value, OF_HINGE)
    if len(fields) < len(OF_HINGE):
        raise ValueError(f"{shown(value)} needs {', '.join(OF_HINGE)}")
    place = pin.SE3(np.eye(3), _vector(fields, "point"))
    axis, base = _vector(fields, "axis"), ("universe", "universe")
    links = name_in(fields["link_a"]), name_in(fields["link_b"])
    return cut_joint("", "revolute", links, (place, place), (axis, axis), base)


def _of_fusion(content: YamlContent) -> _Parts:
    """A `robot_data.yaml` of fusion2URDF: joints whose origins are seen from their parents."""

    def is_motor(name: str, value: Any) -> str:
        fields = mapping_in(value)
        return name * (fields.get("passive") == "false" and fields.get("type") != "fixed")

    motors = filter(None, content.entries("joints", is_motor, dict))
    return tuple(content.entries("closing_joints", _closing_joint)), (), tuple(motors)


def _closing_joint(value: Any) -> CutJoint:
    fields = mapping_in(value)
    name, kind, a, b = (_text(fields, key) for key in ("name", "type", "parent", "child"))
    xyz, rpy, axis = (_vector(fields, k) for k in ("origin_xyz_m", "origin_rpy_rad", "axis"))
    place = pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)
    return cut_joint(name, kind, (a, b), (place, place), (axis, axis), (a, a))


def _text(fields: Mapping[str, Any], key: str) -> str:
    if key not in fields:
        raise ValueError(f"{shown(fields)} has no {key}")
    return name_in(fields[key])


def _vector(fields: Mapping[str, Any], key: str) -> Array:
    value = vector(fields.get(key))
    if value is None or (key == "axis" and not value.any()):
        raise ValueError(f"{key} {shown(fields.get(key))} is not three numbers")
    return value


#: Readers of other YAML files, by a key that these have.
PARSERS: dict[str, Callable[[YamlContent], _Parts]] = {
    "closures": _of_scikit_robot,
    "closing_joints": _of_fusion,
}
