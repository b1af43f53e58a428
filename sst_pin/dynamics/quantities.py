# SPDX-License-Identifier: BSD-2-Clause
"""The quantities that have kernels, and the keys of their kernels.

A kernel fills the lanes of a vector register with samples, one in each lane. Some quantities have a
second kind of kernel, which fills the lanes with directions of one sample. A direction is a unit
rate of a coordinate, or a parameter; it gives one column of the result. This kind is faster for
single samples and for large robots.
"""

from collections.abc import Mapping
from typing import Literal, NamedTuple

#: Names of the quantities.
Name = Literal[
    # Methods of `Reference`:
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
    "displacement_rates",  # how moving joint axes change displacements of the coordinates
    "frame_jacobian",
    "frame_jacobian_rate",
    "frame_velocity_derivatives",
    "frame_drift",  # acceleration of the frame for aa = 0
    # The closed q, the determinant of the pivots, and the squared residual of the loops:
    "closing",
    # The states of a motion with a fixed step:
    "rollout",
    # Position and orientation of a frame, for Warp only; so it has no row in `QUANTITIES`:
    "frame_placement",
]


class Properties(NamedTuple):
    """Properties of a quantity.

    Attributes:
        by_directions: Whether a kernel can fill its lanes with directions.
        loadable: Whether external wrenches may act.
        smooth: Whether Coulomb friction is smoothed, because the quantity is a derivative; see
            `Quantity.sign_width`.
        of_frame: Whether it is a quantity of a frame.
    """

    by_directions: bool = False
    loadable: bool = False
    smooth: bool = False
    of_frame: bool = False


#: All quantities with kernels in C.
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
    "closing": Properties(),
    "rollout": Properties(loadable=True),
}


class Quantity(NamedTuple):
    """A quantity that an engine computes, and the key of its kernel.

    Attributes:
        name: Its name.
        frame: Name of the frame, for a quantity of a frame.
        loaded: Whether external wrenches act.
        along: Whether the kernel fills its lanes with directions, as `Properties.by_directions`
            allows.
        sign_width: For derivatives, the rate at which the smoothed sign of Coulomb friction,
            tanh(v / sign_width), is at 76 %, [rad/s] or [m/s].
    """

    name: Name
    frame: str | None = None
    loaded: bool = False
    along: bool = False
    sign_width: float | None = None

    @property
    def properties(self) -> Properties:
        """The properties of the quantity; a KeyError for a quantity that only Warp computes."""
        return QUANTITIES[self.name]

    @property
    def entry(self) -> str:
        """Name of the functions of its library in C, such as torque_derivatives_along_loaded.

        It has neither `frame` nor `sign_width`. Quantities with different ones have the same name
        but libraries of their own, so that names do not collide.
        """
        parts = [str(self.name)]
        if self.along:
            parts.append("along")
        if self.loaded:
            parts.append("loaded")
        return "_".join(parts)

    def __str__(self) -> str:
        return self.entry if self.frame is None else f"{self.entry} {self.frame}"
