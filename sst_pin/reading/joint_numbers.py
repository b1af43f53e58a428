# SPDX-License-Identifier: BSD-2-Clause
"""Springs, friction and rotors of joints in files, by the names of joints."""

from collections.abc import Collection, Mapping

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..model.joint_space import JointSpace
from ..model.named_positions import put

#: Numbers of joints, or of single rates, by name, for each of these kinds: "stiffness" and
#: "reference" of springs, "viscous_friction", "coulomb_friction", "armature".
JointNumbers = Mapping[str, Mapping[str, float]]


def updated(numbers: JointNumbers, others: JointNumbers, without: Collection[str]) -> JointNumbers:
    """Numbers updated by others, without some joints."""
    both = {kind: {**numbers.get(kind, {}), **others.get(kind, {})} for kind in (*numbers, *others)}
    return {k: {n: x for n, x in of.items() if n not in without} for k, of in both.items()}


def put_numbers(model: pin.Model, numbers: JointNumbers) -> None:
    """Write friction and rotors into a model."""
    _fill(model.damping, model, numbers.get("viscous_friction", {}))
    _fill(model.friction, model, numbers.get("coulomb_friction", {}))
    _fill(model.armature, model, numbers.get("armature", {}))


def springs_of(model: pin.Model, numbers: JointNumbers) -> tuple[Array, Array]:
    """Stiffness of the joints' springs, shape (nv,), and where they rest, shape (nq,)."""
    stiffness, rest = np.zeros(model.nv), pin.neutral(model)
    _fill(stiffness, model, numbers.get("stiffness", {}))
    positions = {name: x for name, x in numbers.get("reference", {}).items() if x}
    return stiffness, put(JointSpace(model), rest, positions) if positions else rest


def _fill(array: Array, model: pin.Model, values: Mapping[str, float]) -> None:
    for name, value in values.items():
        array[JointSpace(model).rates_of([name])] = value
