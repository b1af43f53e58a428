# SPDX-License-Identifier: BSD-2-Clause
"""What the rows of a nonsmooth step are: contacts, ropes, cables, stops and dry friction."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, Indices, single_array
from ..errors import InputError
from ..model.mechanism import Mechanism
from .impulses import DRY, NORMAL, SIDE, STOP

#: Largest correction that closes the loops after a step, relative to the step: it is of second
#: order in the step.
LARGEST_BEND = 0.25
#: Contacts, ropes and stops may be violated by this part of the robot's length, or this angle, at
#: the start: the first step corrects it with a speed of this per step.
_VIOLATED = 1e-3


class Stop(NamedTuple):
    """An end of the range of a joint."""

    rate: int  #: Index in v.
    position: int  #: Index in q.
    side: int  #: 1 for the lower end, -1 for the upper one.
    limit: float


class MotorGains(NamedTuple):
    """Gains of position control in the motors, shapes (motors,)."""

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
    """The rows of one mechanism: contacts, ropes, cables, stops, dry joints, dry lines, in order.

    A contact has three rows, along x, y and z of its ground.
    """

    mechanism: Mechanism
    gains: MotorGains

    def __post_init__(self) -> None:
        mechanism = self.mechanism
        acting = (self.gains.stiffness + self.gains.damping) > 0
        for k in np.flatnonzero(acting):
            on_cables = mechanism.lines.actuation[self.cables, k]
            on_others = np.delete(mechanism.lines.actuation[:, k], self.cables)
            if on_cables.any() and (
                np.count_nonzero(on_cables) > 1
                or on_others.any()
                or mechanism.actuation[:, k].any()
            ):
                name = mechanism.motor_names[k]
                problem = f"motor {name} pulls a cable and acts on other joints or lines; "
                raise InputError("motor_stiffness", problem + "give it its forces as tau")
        for k in np.flatnonzero(self.gains.stiffness):
            rates = np.setdiff1d(
                np.flatnonzero(mechanism.actuation[:, k]), mechanism.possible_springs
            )
            if len(rates):
                name = mechanism.motor_names[k]
                problem = f"motor {name} drives {mechanism.space.rate_names[rates[0]]}, which has "
                raise InputError("motor_stiffness", problem + "no position; give it damping only")

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
            for k in range(joint.nv if joint.nq == joint.nv else 0):
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
    def parts(self) -> tuple[slice, slice, slice, slice, slice]:
        """Where the rows of contacts, ropes, cables, stops and dry friction are."""
        contacts = self.mechanism.contacts
        sizes = 3 * len(contacts.points), len(contacts.ropes), len(self.cables)
        ends = np.cumsum([0, *sizes, len(self.stops), len(self.dry_friction)]).tolist()
        a, b, c, d, e = (slice(*pair) for pair in pairwise(ends))
        return a, b, c, d, e

    @cached_property
    def kinds(self) -> Indices:
        """Kinds of the rows, see `impulses`."""
        points, _, _, _, dry = self.parts
        kinds = np.full(dry.stop, STOP)
        kinds[points], kinds[dry] = SIDE, DRY
        kinds[2 : points.stop : 3] = NORMAL
        return kinds

    def bounds(self, h: float) -> Array:
        """Coefficients of friction, and the largest impulses of dry friction in a step."""
        points, _, _, _, dry = self.parts
        bounds = np.zeros(dry.stop)
        bounds[2 : points.stop : 3] = [x.friction for x in self.mechanism.contacts.points]
        bounds[dry] = h * self.dry_friction
        return bounds

    @cached_property
    def restitution(self) -> Array:
        """Restitution of each contact, shape (contacts,)."""
        return np.array([x.restitution for x in self.mechanism.contacts.points])

    @cached_property
    def least_gaps(self) -> Array:
        """The least gaps of contacts, ropes and stops that a motion can start with."""
        mechanism = self.mechanism
        of_lengths = len(mechanism.contacts.points) + len(mechanism.contacts.ropes)
        units = [mechanism.length] * of_lengths
        units += [float(mechanism.rate_scale[stop.rate]) for stop in self.stops]
        return -_VIOLATED * np.array(units)

    def stop_gaps(self, q: Array) -> Array:
        """How far each stop is away, shape (stops,)."""
        return np.array([x.side * (q[x.position] - x.limit) for x in self.stops])

    def motor_positions(self, q: Array, lengths: Array) -> Array:
        """Positions of the motors, shape (motors,): of tendons and lines the weighted lengths."""
        model = self.mechanism.model
        displacement = pin.difference(model, pin.neutral(model), q)
        return displacement @ self.mechanism.actuation + lengths @ self.mechanism.lines.actuation

    @cached_property
    def on_joints(self) -> Array:
        """Which impulses of stops and dry joints act on which rates, 1 or -1, shape (m, nv)."""
        _, _, _, stops, dry = self.parts
        matrix = np.zeros((dry.stop, self.mechanism.model.nv))
        for k, stop in enumerate(self.stops, stops.start):
            matrix[k, stop.rate] = stop.side
        matrix[range(dry.start, dry.start + len(self.dry_rates)), self.dry_rates] = 1
        return matrix
