# SPDX-License-Identifier: BSD-2-Clause
"""Eqs. (7) and (92) as first-order differential equations of the state (q, va), Sect. 6.2."""

from __future__ import annotations

from collections import deque
from functools import partial
from math import isfinite
from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..errors import InputError, SSTError
from ..states import StateSpace
from .inputs import Input

#: Step of the finite differences; relative for entries of y above 1.
_DIFFERENCE = 1e-8
#: The most evaluations that an explicit integrator of SciPy needs for one step (DOP853).
_STAGES = 12


class MotionState(NamedTuple):
    """A state of a motion.

    Attributes:
        t: Time, [s].
        space: The state space of y. The rates in y are those of its `coordinates`, which are
            indices in v.
        q: Configuration with closed loops, shape (nq,).
        y: State of the integrator: the configuration, whose loops an integration closes only
            nearly, and the rates of the coordinates; shape (nq + n,).
    """

    t: float
    space: StateSpace
    q: Array
    y: Array

    @property
    def rates(self) -> Array:
        """Rates of the coordinates of `space`, shape (n,)."""
        return self.y[len(self.q) :]

    def in_coordinates_of(self, space: StateSpace) -> MotionState:
        """The same state with the rates of other coordinates; its y has closed loops."""
        rates = self.rates
        if space is not self.space:
            rates = self.space.joint_rates(self.q, rates)[space.coordinates]
        return MotionState(self.t, space, self.q, np.concatenate([self.q, rates]))


class Samples(NamedTuple):
    """Samples of a motion in the robot's coordinates.

    Attributes:
        q: Configurations, shape (N, nq).
        va: Rates, shape (N, n).
        aa: Accelerations, shape (N, n).
        tau: Torques of the motors, shape (N, motors).
    """

    q: Array
    va: Array
    aa: Array
    tau: Array


class StateEquations:
    """y' = f(t, y) with y = (q, rates of the coordinates of `space`).

    Torques and loads are functions of q and of the rates of the robot's coordinates. The rates in y
    belong to other coordinates while those of the robot do not determine the motion well.

    Args:
        robot_space: The state space with the robot's coordinates.
        torque: Torques of the motors.
        load: External wrenches, or None.
        space: The state space of y; by default that of the robot.
        close_first: Whether f first moves y onto the closures. Compiled kernels do not, but take
            loops that are nearly closed. Near a singular configuration, such small errors of q
            change f too much.

    Attributes:
        failure: The last error at a trial state; None if there was none.
        evaluations: Torques and loads of the last evaluations of f, in the order of the calls.
            `InputWatch` compares them with torques and loads at times between them.
    """

    def __init__(
        self,
        robot_space: StateSpace,
        torque: Input,
        load: Input | None,
        space: StateSpace | None = None,
        *,
        close_first: bool = False,
    ) -> None:
        self.robot_space = robot_space
        self.torque = torque
        self.load = load
        self.space = robot_space if space is None else space
        self.close_first = close_first
        self.failure: SSTError | None = None
        self.evaluations = deque[tuple[Array, Array | None]](maxlen=_STAGES)
        self._last_jacobian: Array | None = None

    def in_coordinates_of(self, space: StateSpace, *, close_first: bool = False) -> StateEquations:
        """The equations of the same motion for states in other coordinates."""
        return StateEquations(
            self.robot_space, self.torque, self.load, space, close_first=close_first
        )

    def robot_state(self, state: Array) -> tuple[Array, Array]:
        """q with closed loops, and the rates of the robot's coordinates, of one state."""
        q = self.space.closed(state)
        rates = state[len(q) :]
        if self.space is self.robot_space:
            return q, rates
        return q, self.space.joint_rates(q, rates)[self.robot_space.coordinates]

    def _inputs(self, time: float, state: Array) -> tuple[Array, Array | None]:
        """Torques and load at one time and state."""
        robot_state = partial(self.robot_state, state)
        load = None if self.load is None else self.load.at(time, robot_state)
        return self.torque.at(time, robot_state), load

    def rate(self, time: float, state: Array) -> Array:
        """f(t, y); NaN where the loops cannot be closed."""
        if not isfinite(state.dot(state)):
            return np.full_like(state, np.nan)
        try:
            if self.close_first:
                q = self.space.closed(state)
                state = np.concatenate([q, state[len(q) :]])
            tau, load = self._inputs(time, state)
            self.evaluations.append((tau, load))
            return self.space.rate(state, tau, load)
        except InputError:
            raise  # the caller's torque is at fault
        except SSTError as error:
            # A trial step was too long; the integrator answers NaN with a shorter one.
            self.failure = error
            return np.full_like(state, np.nan)

    def jacobian(self, time: float, state: Array) -> Array:
        """Derivatives of f by y, shape (nq + n, nq + n).

        With f(y, tau(y)) they are df/dy + df/dtau dtau/dy. The derivatives of a torque function are
        computed by differences. The load must not depend on the state: its derivatives are left
        out. At a trial state where loops cannot be closed there are no derivatives; the last ones
        are returned.
        """
        if self._last_jacobian is None:
            self._last_jacobian = np.zeros((len(state), len(state)))
        if not isfinite(state.dot(state)):
            return self._last_jacobian
        try:
            tau, load = self._inputs(time, state)
            by_state, by_tau = self.space.derivatives(state, tau, load)
            steps = _DIFFERENCE * np.maximum(1, np.abs(state))
            neighbours = state + np.diag(steps)  # row j is y with its entry j changed
            tau_ahead = [self.torque.at(time, partial(self.robot_state, y)) for y in neighbours]
            # Row j is the derivative by entry j of y; transposed it has shape (motors, nq + n).
            tau_by_state = ((tau_ahead - tau) / steps[:, None]).T
            self._last_jacobian = by_state + by_tau.dot(tau_by_state)
        except InputError:
            raise
        except SSTError as error:
            self.failure = error
        return self._last_jacobian

    def joint_motion(self, time: float, state: Array) -> tuple[Array, Array, Array]:
        """q with closed loops, v and v_dot of all joints."""
        q = self.space.closed(state)
        rates = state[len(q) :]
        closed = np.concatenate([q, rates])
        tau, load = self._inputs(time, closed)
        accelerations = self.space.rate(closed, tau, load)[len(q) :]
        v, v_dot = self.space.joint_motion(q, rates, accelerations)
        return q, v, v_dot

    def inputs_along(self, times: Array, states: Array) -> tuple[Array, Array | None]:
        """Torques, shape (N, motors), and wrenches on the r bodies, (N, r, 6), at N states."""
        q, va = self._robot_states(states)
        return self._inputs_at(times, q, va)

    def samples_along(self, times: Array, states: Array) -> Samples:
        """Samples of the motion at times and states."""
        q, va = self._robot_states(states)
        tau, load = self._inputs_at(times, q, va)
        nq = q.shape[1]
        accelerations = self.space.rate(states, tau, load)[:, nq:]
        if self.space is self.robot_space:
            return Samples(q, va, accelerations, tau)
        v_dot = []
        for q_k, rates, acceleration in zip(q, states[:, nq:], accelerations, strict=True):
            _, v_dot_k = self.space.joint_motion(q_k, rates, acceleration)
            v_dot.append(v_dot_k)
        aa = np.array(v_dot)[:, self.robot_space.coordinates]
        return Samples(q, va, aa, tau)

    def _robot_states(self, states: Array) -> tuple[Array, Array]:
        """q with closed loops, shape (N, nq), and rates of the robot's coordinates, (N, n)."""
        q = self.space.closed(states)
        rates = states[:, q.shape[1] :]
        if self.space is self.robot_space:
            return q, rates
        v = [self.space.joint_rates(q_k, rate) for q_k, rate in zip(q, rates, strict=True)]
        return q, np.array(v)[:, self.robot_space.coordinates]

    def _inputs_at(self, times: Array, q: Array, va: Array) -> tuple[Array, Array | None]:
        """Torques and loads at times, for q (N, nq) and rates va of the robot's coordinates."""
        load = None if self.load is None else self.load.along(times, q, va)
        return self.torque.along(times, q, va), load
