# SPDX-License-Identifier: BSD-2-Clause
"""Names, units and parts of the mechanism of a robot, as properties."""

from abc import abstractmethod

from ..arrays import Array, Indices
from ..former_names import FormerName
from .appearance import Appearance, appearance_of
from .closures import Constraint
from .contacts import Contact, Rope
from .lines import LineForce
from .mechanism import Friction, Mechanism
from .weight_shares import Share, shares_by_name

#: Names of other packages, and the names to use instead.
_INSTEAD = {
    "inverse_dynamics": "compute_torques(q, va, aa)",
    "forward_dynamics": "compute_accelerations(q, va, tau)",
    "mass_matrix": "reduced_terms(q, va).inertia",
    "jacobian": "frame_jacobian(q, frame)",
    "forward_kinematics": "frame_placement(q, frame)",
    "inverse_kinematics": "frame_configuration(frame, position, rotation)",
    "to_mjcf": "sst_pin.write_mjcf(chain, path)",
}


class RobotProperties:
    """Names, units and parts of a robot, from its `mechanism`."""

    actuated = FormerName("motor_indices")
    joint_units = FormerName("position_units")
    forces = FormerName("lines")

    @property
    @abstractmethod
    def mechanism(self) -> Mechanism:
        """A copy of the tree, with closures, coordinates, motors and forces."""

    @property
    def closures(self) -> tuple[Constraint, ...]:
        """The closures of the tree."""
        return self.mechanism.closures

    @property
    def lines(self) -> tuple[LineForce, ...]:
        """Springs, dampers and cylinders along lines between two frames."""
        return self.mechanism.lines.forces

    @property
    def contacts(self) -> tuple[Contact | Rope, ...]:
        """The contacts, then the ropes."""
        return self.mechanism.contacts.points + self.mechanism.contacts.ropes

    @property
    def weight_shares(self) -> dict[str, Share]:
        """Shares of the bodies that do not have their whole weight, by the names of joints.

        A share is a number or [share, x, y, z], as for the constructor.
        """
        return shares_by_name(self.mechanism.model, self.mechanism.weight_shares)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, in the order of the tree."""
        return self.mechanism.space.joint_names

    @property
    def position_names(self) -> tuple[str, ...]:
        """Name of each entry of q: the name of the joint, with a suffix if it has several."""
        return self.mechanism.space.position_names

    @property
    def position_units(self) -> tuple[str, ...]:
        """Unit of each entry of q: "rad", "m", or "" for quaternions, cosines and sines."""
        return self.mechanism.space.position_units

    @property
    def rate_names(self) -> tuple[str, ...]:
        """Name of each entry of v: the name of the joint, with a suffix if it has several."""
        return self.mechanism.space.rate_names

    @property
    def rate_units(self) -> tuple[str, ...]:
        """Unit of each entry of v without "per second": "rad" or "m"."""
        return self.mechanism.space.rate_units

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the independent joints, or of single rates of a joint."""
        return self.mechanism.coordinate_names

    @property
    def degrees_of_freedom(self) -> int:
        """Number n of the coordinates' rates.

        If no configuration with closed loops was found, it raises a `DescriptionError`.
        """
        self.mechanism.require_assembly()
        return len(self.mechanism.coordinates)

    @property
    def motor_names(self) -> tuple[str, ...]:
        """Name of each motor, in the order of tau."""
        return self.mechanism.motor_names

    @property
    def motor_units(self) -> tuple[str, ...]:
        """Unit of each motor torque: "Nm" or "N", by the joints it acts on; "N" on a line."""
        return self.mechanism.motor_units

    @property
    def motor_indices(self) -> Indices:
        """Indices in v of the motors' joints, in the order of the motors, read-only."""
        return self.mechanism.driven

    @property
    def actuation(self) -> Array:
        """B, shape (nv, motors): joint forces are B tau; zero columns for motors on lines."""
        return self.mechanism.actuation

    @property
    def friction(self) -> Friction:
        """Friction of all joints, read-only."""
        return self.mechanism.friction

    @property
    def appearance(self) -> Appearance:
        """What its pictures show besides its bodies."""
        mechanism = self.mechanism
        return appearance_of(mechanism.model, mechanism.closures)

    def __dir__(self) -> list[str]:
        return [name for name in super().__dir__() if name not in _INSTEAD]


class _Instead:
    """An attribute that is missing, and whose error says what to use.

    `__getattr__` would do, but with it Python looks up every attribute more slowly.
    """

    def __init__(self, name: str, cure: str) -> None:
        self._name = name
        self._cure = cure

    def __get__(self, robot: object, kind: type) -> None:
        text = f"{kind.__name__} has no {self._name}; use {self._cure}"
        raise AttributeError(text, name=self._name, obj=robot)


for _name, _cure in _INSTEAD.items():
    setattr(RobotProperties, _name, _Instead(_name, _cure))
