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
#: Limits of joints with one position: of the position, of the motor's force, of the rate.
LIMITS = ("lower", "upper", "effort", "velocity")
#: Limits from here on are none, [rad], [m] and so on: files have such numbers, up to 1e16, for "no
#: limit".
FAR = 1e9


def combined_numbers(
    numbers: JointNumbers, others: JointNumbers, without: Collection[str]
) -> JointNumbers:
    """Both numbers, where the second ones replace the first, without some joints."""
    result: dict[str, dict[str, float]] = {}
    for kind in (*numbers, *others):
        result[kind] = {**numbers.get(kind, {}), **others.get(kind, {})}
        for joint in without:
            result[kind].pop(joint, None)
    return result


def put_numbers(model: pin.Model, numbers: JointNumbers) -> None:
    """Write friction, rotors and limits into a model."""
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
    """Stiffness of the joints' springs, (nv,), and where they are relaxed, (nq,)."""
    stiffness = np.zeros(model.nv)
    _fill(stiffness, model, numbers.get("stiffness", {}))
    reference = pin.neutral(model)
    # Zero is the neutral position. A ball has no single position, but can have this number.
    positions = {name: x for name, x in numbers.get("reference", {}).items() if x}
    if positions:
        reference = with_positions(JointSpace(model), reference, positions)
    return stiffness, reference


def _fill(array: Array, model: pin.Model, values: Mapping[str, float]) -> None:
    """Write values by the names of joints or rates into an array, shape (nv,)."""
    for name, value in values.items():
        array[JointSpace(model).rates_of([name])] = value
