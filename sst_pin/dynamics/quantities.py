# SPDX-License-Identifier: BSD-2-Clause
"""The quantities that a chain computes, in one table."""

from collections.abc import Callable, Mapping
from typing import Literal, NamedTuple

from ..arrays import Array
from ..model.mechanism import Mechanism
from . import reactions, regressor
from .reference import Reference

#: Names of the quantities. All but "closing" and "rollout" are methods of `Reference`.
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

    #: The function of the reference path that computes one sample.
    reference: Callable[..., Array]
    #: Shape of the result of one sample.
    shape: Callable[[Mechanism], tuple[int, ...]]
    #: Whether a kernel can compute it direction by direction: one result for each coordinate.
    by_directions: bool = False
    #: Whether external wrenches may act.
    loadable: bool = False
    #: Whether Coulomb friction is smooth, within the `sign_width` of the key.
    smooth: bool = False
    #: Whether it is a quantity of a frame.
    of_frame: bool = False
    #: Whether tau may be None and then follows from the other arguments.
    tau_optional: bool = False


def _integrators_only(*_: object) -> Array:
    raise AssertionError("on the reference path `states` computes it")


def _n(mechanism: Mechanism) -> int:
    """Number of rates of the coordinates."""
    return len(mechanism.coordinates)


def _motors(mechanism: Mechanism) -> int:
    return mechanism.motors.shape[1]


def _of_motors(mechanism: Mechanism) -> tuple[int, ...]:
    return (_motors(mechanism),)


def _of_coordinates(mechanism: Mechanism) -> tuple[int, ...]:
    return (_n(mechanism),)


def _of_joints(mechanism: Mechanism) -> tuple[int, ...]:
    return (mechanism.model.nv,)


def _twists(mechanism: Mechanism) -> tuple[int, ...]:
    """A twist for each coordinate."""
    return 6, _n(mechanism)


QUANTITIES: Mapping[Name, Properties] = {
    "torques": Properties(Reference.torques, _of_motors, loadable=True),
    "generalized_forces": Properties(Reference.generalized_forces, _of_coordinates, loadable=True),
    "accelerations": Properties(Reference.accelerations, _of_coordinates, loadable=True),
    "torque_derivatives": Properties(
        Reference.torque_derivatives,
        lambda m: (_n(m), 3 * _n(m)),
        by_directions=True,
        loadable=True,
        smooth=True,
    ),
    "acceleration_derivatives": Properties(
        Reference.acceleration_derivatives,
        lambda m: (_n(m), 2 * _n(m) + _motors(m)),
        by_directions=True,
        loadable=True,
        smooth=True,
    ),
    "reactions": Properties(
        Reference.reactions,
        lambda m: (reactions.size_of(m),),
        loadable=True,
        tau_optional=True,
    ),
    "torque_regressor": Properties(
        Reference.torque_regressor, lambda m: (_n(m), regressor.size_of(m)), by_directions=True
    ),
    "rates": Properties(Reference.rates, _of_joints),
    "joint_accelerations": Properties(Reference.joint_accelerations, _of_joints),
    "actuator_jacobian": Properties(Reference.actuator_jacobian, lambda m: (_motors(m), _n(m))),
    # Inertia and Coriolis matrix, forces of gravity and of friction.
    "reduced_terms": Properties(
        Reference.reduced_terms, lambda m: (2 * _n(m) * (_n(m) + 1),), by_directions=True
    ),
    "displacement_rates": Properties(
        Reference.displacement_rates, lambda m: (_n(m), _n(m)), by_directions=True
    ),
    "frame_jacobian": Properties(
        Reference.frame_jacobian, _twists, by_directions=True, of_frame=True
    ),
    "frame_jacobian_rate": Properties(
        Reference.frame_jacobian_rate, _twists, by_directions=True, of_frame=True
    ),
    "frame_velocity_derivatives": Properties(
        Reference.frame_velocity_derivatives,
        lambda m: (6, 2 * _n(m)),
        by_directions=True,
        of_frame=True,
    ),
    "frame_drift": Properties(Reference.frame_drift, lambda m: (6,), of_frame=True),
    # A closed q, a determinant and a sum of squares.
    "closing": Properties(_integrators_only, lambda m: (m.model.nq + 2,)),
    # The states q and va of a rollout.
    "rollout": Properties(_integrators_only, lambda m: (m.model.nq + _n(m),), loadable=True),
}


class Quantity(NamedTuple):
    """A quantity that an engine computes.

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
        """The name of its functions in C."""
        parts = [str(self.name)]
        if self.along:
            parts.append("along")
        if self.loaded:
            parts.append("loaded")
        return "_".join(parts)

    def __str__(self) -> str:
        return self.entry if self.frame is None else f"{self.entry} {self.frame}"
