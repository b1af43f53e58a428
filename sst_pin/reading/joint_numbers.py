# SPDX-License-Identifier: BSD-2-Clause
"""Springs, friction and rotors of joints, as files give them by the names of joints."""

from collections import defaultdict
from collections.abc import Collection

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..model.joint_space import JointSpace
from ..model.named_positions import put


class JointNumbers(defaultdict[str, dict[str, float]]):
    """Numbers of joints, or of single rates, by name, for each of these kinds.

    "stiffness" and "reference" of springs, "viscous_friction", "coulomb_friction", "armature".
    """

    def __init__(self) -> None:
        super().__init__(dict)

    def updated(self, other: "JointNumbers") -> "JointNumbers":
        """These numbers, with others in their place where both have one."""
        both = JointNumbers()
        for numbers in (self, other):
            for kind, values in numbers.items():
                both[kind].update(values)
        return both

    def put(self, model: pin.Model, fixed: Collection[str]) -> None:
        """Write friction and rotors into a model, but of joints that are fixed."""
        arrays = {
            "viscous_friction": model.damping,
            "coulomb_friction": model.friction,
            "armature": model.armature,
        }
        for kind, array in arrays.items():
            self._fill(kind, array, model, fixed)

    def springs(self, model: pin.Model, fixed: Collection[str]) -> tuple[Array, Array]:
        """Stiffness of the joints' springs, shape (nv,), and where they rest, shape (nq,)."""
        stiffness, rest = np.zeros(model.nv), pin.neutral(model)
        self._fill("stiffness", stiffness, model, fixed)
        positions = {name: x for name, x in self["reference"].items() if name not in fixed and x}
        return stiffness, put(JointSpace(model), rest, positions) if positions else rest

    def _fill(self, kind: str, array: Array, model: pin.Model, fixed: Collection[str]) -> None:
        for name, value in self[kind].items():
            if name not in fixed:
                array[JointSpace(model).rates_of([name])] = value
