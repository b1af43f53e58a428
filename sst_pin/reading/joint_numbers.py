# SPDX-License-Identifier: BSD-2-Clause
"""Springs, friction and rotors of joints in files, by the names of joints."""

from collections.abc import Collection, Mapping

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..errors import InputError
from ..model.joint_space import JointSpace
from ..model.named_positions import with_positions
from ..model.tree import joint_id

#: Numbers by kind, then by the name of a joint or of a single rate. Kinds are "stiffness" and
#: "reference" of springs, "viscous_friction", "coulomb_friction", "armature", and `LIMITS`.
JointNumbers = Mapping[str, Mapping[str, float]]
#: Limits of joints with one position: the least and the largest position, the largest force or
#: torque of the motor, and the largest rate.
LIMITS = ("lower", "upper", "effort", "velocity")


def combined_numbers(
    of_urdf: JointNumbers, of_yaml: JointNumbers, fixed_joints: Collection[str]
) -> JointNumbers:
    """The numbers of a URDF and its YAML, without fixed joints; the YAML replaces the URDF."""
    result: dict[str, dict[str, float]] = {}
    for kind in (*of_urdf, *of_yaml):
        result[kind] = {**of_urdf.get(kind, {}), **of_yaml.get(kind, {})}
        for joint in fixed_joints:
            result[kind].pop(joint, None)
    return result


def put_numbers(model: pin.Model, numbers: JointNumbers) -> None:
    """Write friction, rotors and limits into a model; springs are not part of it."""
    _fill(model.damping, model, numbers.get("viscous_friction", {}))
    _fill(model.friction, model, numbers.get("coulomb_friction", {}))
    _fill(model.armature, model, numbers.get("armature", {}))
    for joint, value in numbers.get("lower", {}).items():
        model.lowerPositionLimit[_position(model, joint)] = value
    for joint, value in numbers.get("upper", {}).items():
        model.upperPositionLimit[_position(model, joint)] = value
    _fill(model.effortLimit, model, numbers.get("effort", {}))
    _fill(model.velocityLimit, model, numbers.get("velocity", {}))


def _position(model: pin.Model, name: str) -> int:
    """The index in q of a joint with one position."""
    joint = model.joints[joint_id(model, name)]
    if joint.nq != 1:
        raise InputError("joint_limit", f"joint {name} has {joint.nq} positions; one is needed")
    return int(joint.idx_q)


def springs_of(model: pin.Model, numbers: JointNumbers) -> tuple[Array, Array]:
    """Stiffness of the joints' springs, shape (nv,), and where they are relaxed, shape (nq,)."""
    stiffness = np.zeros(model.nv)
    _fill(stiffness, model, numbers.get("stiffness", {}))
    reference = pin.neutral(model)
    # Zeros are left out: they mean the neutral position, also for a ball, which has no single
    # position.
    positions = {name: x for name, x in numbers.get("reference", {}).items() if x}
    if positions:
        reference = with_positions(JointSpace(model), reference, positions)
    return stiffness, reference


def _fill(array: Array, model: pin.Model, values: Mapping[str, float]) -> None:
    """Write values by the names of joints or rates into an array, shape (nv,)."""
    for name, value in values.items():
        array[JointSpace(model).rates_of([name])] = value
