# SPDX-License-Identifier: BSD-2-Clause
"""Joints of a robot and the motors that move them through linkages: positions, and the Jacobian.

The configuration for positions of the joints follows by closing the loops along a path to them. For
positions of the motors there are two ways. If each motor moves one joint of its own, such as the
crank of a four-bar, these joints become coordinates in a copy of the robot, and the path leads
along them. Otherwise, such as for a motor on a line, Newton's method finds the positions of the
joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Flags, Indices, finite_array, for_each_sample, single_array
from ..arrays import names as checked_names
from ..closed_chain import ClosedChain
from ..errors import ActuationError, InputError, WorkspaceError
from ..loops.coordinate_choice import choose_coordinates
from ..loops.ranks import scaled_Phi
from ..loops.start import start_of
from ..model.named_positions import positions_of
from ..model.thresholds import RANK_TOLERANCE

#: The path to positions of motors is divided into pieces of this size, [rad] or robot lengths.
_PIECE = 0.2
#: Most steps of Newton's method in a piece; it converges quadratically.
_STEPS = 20
#: Size of the last step of Newton's method, [rad] or robot lengths: some thousand roundings.
_LAST_STEP = 1e-12


class _MotorCoordinates(NamedTuple):
    """A robot whose first coordinates are the joints of some motors.

    A motion along these coordinates, unlike one along the joints of the linkage, can pass a dead
    point: a configuration such as that of a crank in line with its rod, where a motor turns and the
    joint of the linkage stands still.
    """

    chain: ClosedChain
    #: Numbers of these motors among the motors of a `Linkage`, in the order of the coordinates.
    motors: list[int]
    #: Rate of each of these motors divided by the rate of its joint.
    ratios: Array

    def moved(self, q: Array, distance: Array) -> Array:
        """The configuration after all motors of the linkage move by distances, shape (motors,).

        Motors that are not in `motors` follow the others.
        """
        step = np.zeros(self.chain.degrees_of_freedom)
        step[: len(self.motors)] = distance[self.motors] / self.ratios
        return self.chain.engine.moved(q, step)


class Linkage:
    """Positions of some joints and of their motors, and J: motor rates = J joint rates.

    Attributes:
        chain: The robot with the joints as coordinates, beside others that are independent of them.
        joints: Their names.
        motors: Names of the motors that move these joints.
    """

    def __init__(self, chain: ClosedChain, joints: Sequence[str]) -> None:
        self.joints = tuple(checked_names("joints", joints))
        if not self.joints:
            raise InputError("joints", "name one or more")
        space = chain.mechanism.space
        # This call raises an error unless each joint turns about one axis or slides along one.
        positions_of(space, chain.generic_configuration(), self.joints)
        rates = space.rates_of(self.joints)
        others = _coordinates_beside(chain, rates)
        self.chain = chain.with_coordinates([*self.joints, *others])
        coordinates = self.chain.mechanism.coordinates.tolist()
        #: Numbers of the joints among the coordinates.
        self._joint_columns = np.array([coordinates.index(rate) for rate in rates])

        # The motors that move with the joints.
        J = self._unitless_jacobian()
        moves_with_joints = np.abs(J[:, self._joint_columns]).max(axis=1) > RANK_TOLERANCE
        #: Numbers of these motors among the motors of the robot, and units of their positions.
        self._motor_rows = np.flatnonzero(moves_with_joints)
        self._motor_units = chain.mechanism.motor_scale[self._motor_rows]
        self.motors = tuple(self.chain.motor_names[k] for k in self._motor_rows)
        # Which other coordinates these motors move too, shape (motors, coordinates).
        moves_others = np.abs(J[self._motor_rows]) > RANK_TOLERANCE
        moves_others[:, self._joint_columns] = False
        self._require_held(J, moves_others)
        self._require_own_motors(moves_others)

        # A joint without limits is a cosine and a sine in q, so no position has its name.
        is_endless = ~np.isin(space.rate_names, space.position_names)
        factors = np.abs(chain.mechanism.actuation[:, self._motor_rows])
        #: How far each motor moves in a full turn of its joint, if the joint has no limits: then
        #: the robot is in the same configuration again. 0 for motors of joints with limits.
        self._motor_turns = 2 * np.pi * factors.T @ is_endless

    def _unitless_jacobian(self) -> Array:
        """Rates of all motors by rates of all coordinates, free of units, (motors, coordinates).

        They are those at a generic configuration, where no entry vanishes by chance.
        """
        mechanism = self.chain.mechanism
        J = self.chain.actuator_jacobian(self.chain.generic_configuration())
        units_of_coordinates = mechanism.rate_scale[mechanism.coordinates]
        return np.asarray(J / mechanism.motor_scale[:, None] * units_of_coordinates)

    def _require_held(self, J: Array, moves_others: Flags) -> None:
        """Raise an error if joints, or other coordinates that their motors move, are free.

        A coordinate is free if it can move while all motors are fixed: if the null space of J, the
        Jacobian of `_unitless_jacobian`, has an entry for it. `moves_others` says which other
        coordinates each motor moves, shape (motors, coordinates).
        """
        names = self.chain.mechanism.coordinate_rate_names
        motors = ", ".join(self.motors)
        _, sizes, Vt = np.linalg.svd(J)
        null_space = Vt[np.count_nonzero(sizes > RANK_TOLERANCE) :]
        is_free = np.abs(null_space).max(axis=0, initial=0.0) > RANK_TOLERANCE
        others = np.flatnonzero(moves_others.any(axis=0))
        free_others = [names[k] for k in others if is_free[k]]
        if free_others:
            cure = f"give a motor to {', '.join(free_others)}, "
            cure += f"or ClosedChain(..., locked={free_others})"
            raise ActuationError(f"the motors {motors} leave {', '.join(free_others)} free: {cure}")
        free_joints = [names[k] for k in self._joint_columns if is_free[k]]
        if free_joints:
            joints = ", ".join(free_joints)
            raise ActuationError(f"the motors {motors or '(none)'} do not hold the joints {joints}")

    def _require_own_motors(self, moves_others: Flags) -> None:
        """Raise an error if a motor of the joints also moves with other coordinates."""
        names = self.chain.mechanism.coordinate_rate_names
        for motor, coordinate in np.argwhere(moves_others):
            problem = f"motor {self.motors[motor]} also moves with {names[coordinate]}"
            raise InputError("joints", f"{problem}: name all joints of its linkage")

    def from_joints(self, positions: ArrayLike, start: ArrayLike | None = None) -> Array:
        """Configurations, shape (..., nq), for positions of the joints.

        The joints are moved there from the start without passing a singular configuration, so the
        assembly mode is the one of the start.

        Args:
            positions: Shape (..., joints), [rad] or [m].
            start: A configuration with closed loops, shape (nq,); by default `home`. It also gives
                the other coordinates.

        Raises:
            ClosureError: If a position cannot be reached in this way.
        """
        first = self._start(start)

        def one(x: Array) -> Array:
            """The configuration for one set of positions of the joints."""
            return self._with_joints_moved(first, x - self.joint_positions(first))

        targets = finite_array("positions", positions, (len(self.joints),))
        return for_each_sample(one, [targets], (1,), first.shape)

    def from_motors(self, positions: ArrayLike, start: ArrayLike | None = None) -> Array:
        """Configurations, shape (..., nq), for positions of the motors; see `from_joints`.

        Args:
            positions: Shape (..., motors), [rad] or [m]; for a motor on a line its length.
            start: As in `from_joints`.

        Raises:
            ClosureError, SingularConfigurationError: If the positions are out of reach.
            WorkspaceError: If no positions of the joints give these positions of the motors.
        """
        first = self._start(start)
        motor_coordinates = self._motor_coordinates

        def one(target: Array) -> Array:
            """The configuration for one set of positions of the motors."""
            distance = self._distance_to(first, target)
            if motor_coordinates is None:
                q = self._by_newton(first, distance)
            else:
                q = motor_coordinates.moved(first, distance)
            # Newton's method converges quadratically: if its steps were small at the end, the error
            # is far below sqrt(_LAST_STEP). Otherwise the method has not converged.
            error = self._distance_to(q, target) / self._motor_units
            if np.abs(error).max() > np.sqrt(_LAST_STEP):
                raise WorkspaceError(
                    f"no positions of the joints {', '.join(self.joints)} bring the motors "
                    f"{', '.join(self.motors)} to {target.round(6).tolist()}"
                )
            return q

        targets = finite_array("positions", positions, (len(self.motors),))
        return for_each_sample(one, [targets], (1,), first.shape)

    def _by_newton(self, q: Array, distance: Array) -> Array:
        """The configuration after the motors move by distances, shape (motors,), from q.

        The path of the motors is divided into pieces. At the end of each, Newton's method finds the
        positions of the joints: their step is J^+ times the distance that is left.
        """
        start = self.motor_positions(q)
        largest = np.abs(distance / self._motor_units).max()
        pieces = max(1, int(np.ceil(largest / _PIECE)))
        for piece in range(1, pieces + 1):
            target = start + distance * (piece / pieces)
            for _ in range(_STEPS):
                J = self.actuator_jacobian(q)
                step: Array = np.linalg.pinv(J) @ self._distance_to(q, target)
                q = self._with_joints_moved(q, step)
                if np.abs(step).max() <= _LAST_STEP * self.chain.mechanism.length:
                    break
        return q

    @cached_property
    def _motor_coordinates(self) -> _MotorCoordinates | None:
        """The robot whose first coordinates are the joints on which the motors act.

        They replace the joints of the linkage; the other coordinates of `chain` stay. The result is
        None if a motor acts on several joints or on a line.
        """
        mechanism = self.chain.mechanism
        B = mechanism.actuation[:, self._motor_rows]
        is_on_line = mechanism.lines.actuation[:, self._motor_rows].any()
        is_in_one_joint = np.count_nonzero(B, axis=0) == 1
        if is_on_line or not is_in_one_joint.all():
            return None
        # There may be more motors than joints: take the first motors that are independent. The
        # others follow them.
        J = self.actuator_jacobian(self.chain.generic_configuration())
        J = J / self._motor_units[:, None]
        motors: list[int] = []
        for k in range(len(J)):
            if np.linalg.matrix_rank(J[[*motors, k]], tol=RANK_TOLERANCE) > len(motors):
                motors.append(k)
        rates = np.abs(B[:, motors]).argmax(axis=0)  # the only nonzero entry of each column
        joints_of_motors = [mechanism.space.rate_names[k] for k in rates]
        others = [name for name in self.chain.coordinates if name not in self.joints]
        chain = self.chain.with_coordinates([*joints_of_motors, *others])
        return _MotorCoordinates(chain, motors, ratios=B[rates, motors])

    def joint_positions(self, q: ArrayLike) -> Array:
        """Positions of the joints, shape (..., joints)."""
        return positions_of(self.chain.mechanism.space, self._configurations(q), self.joints)

    def motor_positions(self, q: ArrayLike) -> Array:
        """Positions of the motors, shape (..., motors); for a motor on a line its length."""
        mechanism = self.chain.mechanism
        array = self._configurations(q)
        B = mechanism.actuation[:, self._motor_rows]
        driven = np.flatnonzero(B.any(axis=1))
        at_joints = positions_of(
            mechanism.space, array, [mechanism.space.rate_names[k] for k in driven]
        )
        on_lines = self.chain.line_lengths(array) @ mechanism.lines.actuation[:, self._motor_rows]
        return np.asarray(at_joints @ B[driven] + on_lines)

    def actuator_jacobian(self, q: ArrayLike) -> Array:
        """J: rates of the motors by rates of the joints, shape (..., motors, joints)."""
        J = self.chain.actuator_jacobian(q)
        return np.asarray(J[..., self._motor_rows, :][..., self._joint_columns])

    def _configurations(self, q: ArrayLike) -> Array:
        """Configurations as an array, shape (..., nq)."""
        return finite_array("q", q, (self.chain.mechanism.model.nq,))

    def _start(self, start: ArrayLike | None) -> Array:
        """The start of the path, its loops closed."""
        size = (self.chain.mechanism.model.nq,)
        q = start_of(self.chain.engine) if start is None else single_array("start", start, size)
        return self.chain.assemble(q)

    def _with_joints_moved(self, q: Array, change: Array) -> Array:
        """The configuration after the joints move from q by a change, shape (joints,)."""
        step = np.zeros(self.chain.degrees_of_freedom)
        step[self._joint_columns] = change
        return self.chain.engine.moved(q, step)

    def _distance_to(self, q: Array, target: Array) -> Array:
        """Distances of the motors at q from their target, without full turns, (motors,)."""
        distance = target - self.motor_positions(q)
        turns = np.round(distance / np.where(self._motor_turns, self._motor_turns, 1))
        return np.asarray(distance - self._motor_turns * turns)

    def __repr__(self) -> str:
        name = f"{type(self).__name__} of {self.chain.mechanism.model.name}"
        return f"{name}: joints {', '.join(self.joints)}; motors {', '.join(self.motors)}"


def _coordinates_beside(chain: ClosedChain, rates: Indices) -> list[str]:
    """Coordinates of a chain that can move while some rates are zero, at a generic configuration.

    A joint whose motor moves the fixed joints through a linkage is not one of them. So joints
    without a motor are chosen first.
    """
    engine = chain.engine
    space = chain.mechanism.space
    # Joints without a motor come first, as False is less than True.
    names = sorted(chain.coordinates, key=lambda name: name in chain.motor_names)
    groups = [space.rates_of([name]) for name in names]
    Phi = scaled_Phi(engine.mechanism, engine.loops.assembly.loops, chain.generic_configuration())
    independent = choose_coordinates(engine.mechanism, Phi, [rates, *groups])
    movable = np.setdiff1d(independent, rates)
    coordinates = []
    for name, group in zip(names, groups, strict=True):
        if np.isin(group, movable).all():
            coordinates.append(name)
    return coordinates
