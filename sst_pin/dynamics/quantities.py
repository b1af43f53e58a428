# SPDX-License-Identifier: BSD-2-Clause
"""The quantities that a chain computes, in one table."""

from collections.abc import Callable, Mapping
from typing import Literal, NamedTuple

from ..model.mechanism import Mechanism
from . import reactions, regressor

#: Names of the quantities; those of methods of `Reference`, but for steps of integrators.
Name = Literal[
    "torques",
    "generalized_forces",
    "accelerations",
    "torque_derivatives",
    "acceleration_derivatives",
    "reactions",
    "torque_regressor",
    "rates",
    "joint_accelerations",
    "actuator_jacobian",
    "reduced_terms",
    "displacement_rates",
    "frame_jacobian",
    "frame_jacobian_rate",
    "frame_velocity_derivatives",
    "frame_drift",
    "closing",
    "rollout",
]


class Quantity(NamedTuple):
    """Properties of a quantity, whatever computes it."""

    #: Shape of the arrays that a kernel fills, one sample.
    shape: Callable[[Mechanism], tuple[int, ...]]
    #: Matrices that a kernel writes out entry by entry: none, those of the size of the inertia
    #: matrix, or their derivatives too.
    written: Literal["", "matrices", "derivatives"] = "matrices"
    #: Whether external wrenches may act.
    loadable: bool = False
    #: Whether Coulomb friction is smooth, within a width that a key tells.
    smooth: bool = False
    #: Whether it is that of a frame.
    of_frame: bool = False


def _n(mechanism: Mechanism) -> int:
    return len(mechanism.coordinates)


def _motors(mechanism: Mechanism) -> int:
    return mechanism.motors.shape[1]


QUANTITIES: Mapping[Name, Quantity] = {
    "torques": Quantity(lambda m: (_motors(m),), "", loadable=True),
    "generalized_forces": Quantity(lambda m: (_n(m),), "", loadable=True),
    "accelerations": Quantity(lambda m: (_n(m),), loadable=True),
    "torque_derivatives": Quantity(
        lambda m: (_n(m), 3 * _n(m)), "derivatives", loadable=True, smooth=True
    ),
    "acceleration_derivatives": Quantity(
        lambda m: (_n(m), 2 * _n(m) + _motors(m)), "derivatives", loadable=True, smooth=True
    ),
    "reactions": Quantity(lambda m: (reactions.size_of(m),), "", loadable=True),
    "torque_regressor": Quantity(lambda m: (_n(m), regressor.size_of(m)), "derivatives"),
    "rates": Quantity(lambda m: (m.model.nv,), ""),
    "joint_accelerations": Quantity(lambda m: (m.model.nv,), ""),
    "actuator_jacobian": Quantity(lambda m: (_motors(m), _n(m)), ""),
    "reduced_terms": Quantity(lambda m: (2 * _n(m) * (_n(m) + 1),)),
    "displacement_rates": Quantity(lambda m: (_n(m), _n(m))),
    "frame_jacobian": Quantity(lambda m: (6, _n(m)), of_frame=True),
    "frame_jacobian_rate": Quantity(lambda m: (6, _n(m)), of_frame=True),
    "frame_velocity_derivatives": Quantity(lambda m: (6, 2 * _n(m)), of_frame=True),
    "frame_drift": Quantity(lambda m: (6,), "", of_frame=True),
    "closing": Quantity(lambda m: (m.model.nq + 2,), ""),  # q, a determinant, a sum of squares
    "rollout": Quantity(lambda m: (m.model.nq + _n(m),), loadable=True),
}
