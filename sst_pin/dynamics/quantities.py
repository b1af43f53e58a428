# SPDX-License-Identifier: BSD-2-Clause
"""The quantities that have kernels."""

from collections.abc import Mapping
from typing import Literal, NamedTuple

#: Names of the quantities. All but "closing", "rollout" and "frame_placement" are methods of
#: `Reference`; "frame_placement" has kernels for Warp only, and no row in `QUANTITIES`.
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
    "frame_placement",
    "closing",
    "rollout",
]


class Properties(NamedTuple):
    """Properties of a quantity."""

    #: Whether a kernel can compute it by directions. A direction is a unit rate of a coordinate, or
    #: a parameter, and gives a column of the result. Several directions of one sample then fill the
    #: lanes of a register that otherwise hold samples; see `Quantity.along`.
    by_directions: bool = False
    #: Whether external wrenches may act.
    loadable: bool = False
    #: Whether Coulomb friction is smooth, within `Quantity.sign_width`: derivatives need that.
    smooth: bool = False
    #: Whether it is a quantity of a frame.
    of_frame: bool = False


QUANTITIES: Mapping[Name, Properties] = {
    "torques": Properties(loadable=True),
    "generalized_forces": Properties(loadable=True),
    "accelerations": Properties(loadable=True),
    "torque_derivatives": Properties(by_directions=True, loadable=True, smooth=True),
    "acceleration_derivatives": Properties(by_directions=True, loadable=True, smooth=True),
    "reactions": Properties(loadable=True),
    "torque_regressor": Properties(by_directions=True),
    "rates": Properties(),
    "joint_accelerations": Properties(),
    "actuator_jacobian": Properties(),
    "reduced_terms": Properties(by_directions=True),
    "displacement_rates": Properties(by_directions=True),
    "frame_jacobian": Properties(by_directions=True, of_frame=True),
    "frame_jacobian_rate": Properties(by_directions=True, of_frame=True),
    "frame_velocity_derivatives": Properties(by_directions=True, of_frame=True),
    "frame_drift": Properties(of_frame=True),
    "closing": Properties(),  # the closed q, the determinant of the pivots, the squared residual
    "rollout": Properties(loadable=True),  # states with a fixed step
}


class Quantity(NamedTuple):
    """A quantity that an engine computes, and the key of its kernel.

    Attributes:
        name: Its name in the table of quantities.
        frame: Name of the frame, for a quantity of a frame.
        loaded: Whether external wrenches act.
        along: Whether its kernel computes one sample at a time, several directions side by side.
        sign_width: Width within which Coulomb friction is smooth, for derivatives.
    """

    name: Name
    frame: str | None = None
    loaded: bool = False
    along: bool = False
    sign_width: float | None = None

    @property
    def properties(self) -> Properties:
        """Its row in the table of quantities."""
        return QUANTITIES[self.name]

    @property
    def entry(self) -> str:
        """The name of its functions in C, of which each library has those of one quantity."""
        parts = [str(self.name)]
        if self.along:
            parts.append("along")
        if self.loaded:
            parts.append("loaded")
        return "_".join(parts)

    def __str__(self) -> str:
        return self.entry if self.frame is None else f"{self.entry} {self.frame}"
