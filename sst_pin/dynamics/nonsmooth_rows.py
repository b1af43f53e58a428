# SPDX-License-Identifier: BSD-2-Clause
"""The rows of a nonsmooth step: contacts, ropes, cables, stops and dry friction.

A row is a direction of motion: there is a rate along it, and an impulse acts along it in a step.
Each kind of row has a law that relates rate and impulse. A stop, for instance, can only push, and
it pushes only if the joint would go beyond it. `impulses` lists these laws and computes the
impulses. A contact has three rows, along x, y and z of its ground; the last one is its normal row.
Each rope, each cable (a line that only pulls), each stop, and each joint or line with dry friction
has one row.

`NonsmoothRows` lists the rows of a mechanism with the numbers that are the same in all steps.
`nonsmooth_step` computes those that depend on the state.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, Indices, single_array
from ..errors import InputError
from ..model.mechanism import Mechanism
from .impulses import DRY, NORMAL, SIDE, STOP

#: A step goes straight ahead along the rates, which opens the loops a little. A correction then
#: closes them: it bends the step. This is the largest correction, relative to the step. Corrections
#: are of second order in the step, so a larger one means that the step is too long.
LARGEST_BEND = 0.25
#: At the start, contacts, ropes and stops may be violated by this part of the robot's length, or by
#: this angle. The first step removes the violation at once, so that a larger one would be a jump.
_VIOLATED = 1e-3


class Stop(NamedTuple):
    """An end of the range of a joint."""

    rate: int  #: Index of the joint's rate in v.
    position: int  #: Index of the joint's coordinate in q.
    side: int  #: 1 for the lower end, -1 for the upper one.
    limit: float  #: Position at the end, [rad] or [m].


class Parts(NamedTuple):
    """The parts of the rows, in this order."""

    contacts: slice
    ropes: slice
    cables: slice
    stops: slice
    dry_joints: slice
    dry_lines: slice


class MotorGains(NamedTuple):
    """Gains of position control in the motors, per motor position and rate, shapes (motors,)."""

    stiffness: Array
    damping: Array


def motor_gains(stiffness: ArrayLike | None, damping: ArrayLike | None, motors: int) -> MotorGains:
    """The gains of a user, checked; None is zero."""
    return MotorGains(
        _gains("motor_stiffness", stiffness, motors), _gains("motor_damping", damping, motors)
    )


def _gains(name: str, value: ArrayLike | None, motors: int) -> Array:
    gains = np.zeros(motors) if value is None else single_array(name, value, (motors,))
    if (gains < 0).any():
        raise InputError(name, f"{gains.min():g} is negative")
    return gains


@dataclass(frozen=True, eq=False)
class NonsmoothRows:
    """The rows of one mechanism, in the order of `Parts`."""

    mechanism: Mechanism
    gains: MotorGains

    def __post_init__(self) -> None:
        has_gains = (self.gains.stiffness + self.gains.damping) > 0
        for motor in np.flatnonzero(has_gains).tolist():
            self._require_cable_alone(motor)
        for motor in np.flatnonzero(self.gains.stiffness).tolist():
            self._require_position(motor)

    def _require_cable_alone(self, motor: int) -> None:
        """Refuse gains of a motor that pulls a cable and acts on anything else.

        The gains are added to the cable's stiffness and damping. This has the same effect as the
        gains only if the motor acts on this cable alone.
        """
        mechanism = self.mechanism
        on_cables = mechanism.lines.actuation[self.cables, motor]
        on_others = np.delete(mechanism.lines.actuation[:, motor], self.cables)
        acts_on_others = on_others.any() or mechanism.actuation[:, motor].any()
        if on_cables.any() and (np.count_nonzero(on_cables) > 1 or acts_on_others):
            name = mechanism.motor_names[motor]
            problem = f"motor {name} pulls a cable and acts on other joints or lines; "
            raise InputError("motor_stiffness", problem + "give it its forces as tau")

    def _require_position(self, motor: int) -> None:
        """Refuse stiffness of a motor that drives a rate without a position."""
        mechanism = self.mechanism
        rates = np.flatnonzero(mechanism.actuation[:, motor])
        without_position = np.setdiff1d(rates, mechanism.possible_springs)
        if len(without_position):
            name = mechanism.motor_names[motor]
            rate = mechanism.space.rate_names[without_position[0]]
            problem = f"motor {name} drives {rate}, which has no position; give it damping only"
            raise InputError("motor_stiffness", problem)

    @cached_property
    def cables(self) -> Indices:
        """Indices of the lines that only pull."""
        return np.flatnonzero(self.mechanism.lines.pull_only)

    @cached_property
    def stops(self) -> Sequence[Stop]:
        """Both ends of joints with one coordinate for each rate, where they are finite."""
        model = self.mechanism.model
        stops = list[Stop]()
        for joint in list(model.joints)[1:]:
            if joint.nq != joint.nv:
                continue
            for k in range(joint.nv):
                at = joint.idx_q + k
                low = model.lowerPositionLimit[at]
                high = model.upperPositionLimit[at]
                for side, limit in ((1, float(low)), (-1, float(high))):
                    if abs(limit) < 1e30:  # files write 1e30 and more for no limit
                        stops.append(Stop(joint.idx_v + k, at, side, limit))
        return stops

    @cached_property
    def dry_rates(self) -> Indices:
        """Rates with dry friction."""
        return np.flatnonzero(self.mechanism.friction.coulomb)

    @cached_property
    def dry_lines(self) -> Indices:
        """Indices of the lines with dry friction."""
        return np.flatnonzero(self.mechanism.lines.coulomb)

    @cached_property
    def dry_friction(self) -> Array:
        """The largest forces of dry friction, of joints, then of lines."""
        on_joints = self.mechanism.friction.coulomb[self.dry_rates]
        on_lines = self.mechanism.lines.coulomb[self.dry_lines]
        return np.concatenate([on_joints, on_lines])

    @cached_property
    def parts(self) -> Parts:
        """The slices of the rows that belong to each part."""
        contacts = self.mechanism.contacts
        slices = []
        start = 0
        for size in (
            3 * len(contacts.points),
            len(contacts.ropes),
            len(self.cables),
            len(self.stops),
            len(self.dry_rates),
            len(self.dry_lines),
        ):
            slices.append(slice(start, start + size))
            start += size
        return Parts(*slices)

    @property
    def count(self) -> int:
        """Number m of the rows."""
        return int(self.parts.dry_lines.stop)

    @property
    def normals(self) -> slice:
        """The normal rows of the contacts."""
        return slice(2, self.parts.contacts.stop, 3)

    @property
    def dry(self) -> slice:
        """The rows of dry friction, of joints, then of lines."""
        return slice(self.parts.dry_joints.start, self.parts.dry_lines.stop)

    @cached_property
    def kinds(self) -> Indices:
        """Kinds of the rows, see `impulses`, shape (m,)."""
        kinds = np.full(self.count, STOP)  # of ropes, cables and stops
        kinds[self.parts.contacts] = SIDE
        kinds[self.normals] = NORMAL
        kinds[self.dry] = DRY
        return kinds

    def bounds(self, h: float) -> Array:
        """Friction coefficients of normal rows, and largest impulses of dry friction in a step h.

        Shape (m,); zero for the other rows.
        """
        bounds = np.zeros(self.count)
        bounds[self.normals] = [x.friction for x in self.mechanism.contacts.points]
        bounds[self.dry] = h * self.dry_friction
        return bounds

    @cached_property
    def restitution(self) -> Array:
        """Restitution of each contact, shape (contacts,)."""
        return np.array([x.restitution for x in self.mechanism.contacts.points])

    @cached_property
    def gap_rows(self) -> Indices:
        """Indices of the rows whose rate closes a gap: normal rows, then ropes, then stops."""
        row = np.arange(self.count)
        return np.concatenate([row[self.normals], row[self.parts.ropes], row[self.parts.stops]])

    @cached_property
    def gap_scale(self) -> Array:
        """Scale of each gap, in the order of `gap_rows`: gap / gap_scale is free of units."""
        mechanism = self.mechanism
        of_lengths = len(mechanism.contacts.points) + len(mechanism.contacts.ropes)
        scale = [mechanism.length] * of_lengths
        scale += [float(mechanism.rate_scale[stop.rate]) for stop in self.stops]
        return np.array(scale)

    @cached_property
    def least_gaps(self) -> Array:
        """The least gaps that a motion can start with, in the order of `gap_rows`.

        They are negative, in the unit of the gap: metres, or radians for stops of rotations.
        """
        return -_VIOLATED * self.gap_scale

    def stop_gaps(self, q: Array) -> Array:
        """Distances from the stops, negative beyond them, shape (stops,), [rad] or [m]."""
        return np.array([x.side * (q[x.position] - x.limit) for x in self.stops])

    def motor_positions(self, q: Array, lengths: Array) -> Array:
        """Positions of the motors, shape (motors,).

        The position of a motor is the sum of the positions of its joints, from the neutral
        configuration, and of the lengths of its lines. Each of them is multiplied by the force that
        the motor gives to this joint or line per unit of torque, its entry in `actuation`.
        """
        model = self.mechanism.model
        displacement = pin.difference(model, pin.neutral(model), q)
        return displacement @ self.mechanism.actuation + lengths @ self.mechanism.lines.actuation

    @cached_property
    def on_joints(self) -> Array:
        """Forces on the joints by unit impulses of stops and dry friction, shape (m, nv).

        Entry (i, k) is 1 or -1 if row i acts on rate k. Other rows are zero: they do not act on one
        joint.
        """
        matrix = np.zeros((self.count, self.mechanism.model.nv))
        for row, stop in enumerate(self.stops, self.parts.stops.start):
            matrix[row, stop.rate] = stop.side
        for row, rate in enumerate(self.dry_rates, self.parts.dry_joints.start):
            matrix[row, rate] = 1
        return matrix
