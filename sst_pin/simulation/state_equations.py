# SPDX-License-Identifier: BSD-2-Clause
"""Eqs. (7) and (92) as first-order differential equations of the state (q, va), Sect. 6.2."""

from __future__ import annotations

from functools import partial
from math import isfinite

import numpy as np

from ..arrays import Array
from ..errors import InputError, SSTError
from ..states import States
from .inputs import Input

#: Step of the finite differences; relative for entries of y above 1.
_DIFFERENCE = 1e-8


class StateEquations:
    """y' = f(t, y) with y = (q, rates of the coordinates of `states`).

    `robot_states` are the states in the robot's coordinates; torques and loads are functions of
    these. `states` are in other coordinates while those of the robot do not determine the motion
    well.

    Attributes:
        states: The states of y.
        failure: The last error at a trial state.
        close_first: Whether f first moves y onto the closures.
        evaluations: Torques and loads of the last evaluations of f.
    """

    def __init__(self, robot_states: States, torque: Input, load: Input | None) -> None:
        self.robot_states = self.states = robot_states
        self.torque = torque
        self.load = load
        self.failure: SSTError | None = None
        self.close_first = False
        self.evaluations = list[tuple[Array, Array | None]]()
        self._last_jacobian = np.zeros(())

    def robot_state(self, state: Array) -> tuple[Array, Array]:
        """q with closed loops, and the rates of the robot's coordinates."""
        q = self.states.closed(state)
        va = state[len(q) :]
        if self.states is not self.robot_states:
            va = self.states.joint_rates(q, va)[self.robot_states.coordinates]
        return q, va

    def _inputs(self, time: float, state: Array) -> tuple[Array, Array | None]:
        robot_state = partial(self.robot_state, state)
        load = None if self.load is None else self.load.at(time, robot_state)
        return self.torque.at(time, robot_state), load

    def rate(self, time: float, state: Array) -> Array:
        """f(t, y); NaN where the loops cannot be closed."""
        if not isfinite(state.dot(state)):
            return np.full_like(state, np.nan)
        try:
            if self.close_first:
                q = self.states.closed(state)
                state = np.concatenate([q, state[len(q) :]])
            tau, load = self._inputs(time, state)
            self.evaluations.append((tau, load))
            return self.states.rate(state, tau, load)
        except InputError:
            raise  # the caller's torque is at fault
        except SSTError as error:
            # A trial step was too long; the integrator answers NaN with a shorter one.
            self.failure = error
            return np.full_like(state, np.nan)

    def jacobian(self, time: float, state: Array) -> Array:
        """Derivatives of f by y; those of a torque function are differences."""
        if not self._last_jacobian.shape:
            self._last_jacobian = np.zeros((len(state), len(state)))
        if not isfinite(state.dot(state)):
            return self._last_jacobian
        try:
            tau, load = self._inputs(time, state)
            by_state, by_tau = self.states.derivatives(state, tau, load)
            steps = _DIFFERENCE * np.maximum(1, np.abs(state))
            neighbours = state + np.diag(steps)
            ahead = [self.torque.at(time, partial(self.robot_state, y)) for y in neighbours]
            self._last_jacobian = by_state + by_tau.dot(((ahead - tau) / steps[:, None]).T)
        except InputError:
            raise
        except SSTError as error:  # at a trial state that is too far away
            self.failure = error
        return self._last_jacobian

    def joint_motion(self, time: float, state: Array) -> tuple[Array, Array, Array]:
        """q with closed loops, v and v_dot of all joints."""
        q = self.states.closed(state)
        va = state[len(q) :]
        state = np.concatenate([q, state[len(q) :]])
        aa = self.states.rate(state, *self._inputs(time, state))[len(q) :]
        return q, *self.states.joint_motion(q, va, aa)

    def inputs_along(self, times: Array, states: Array) -> tuple[Array, Array | None]:
        """Torques, shape (N, motors), and loads, (N, r, 6), at times and states."""
        q = self.states.closed(states)
        va = self._robot_rates(q, states[:, q.shape[1] :])
        load = None if self.load is None else self.load.along(times, q, va)
        return self.torque.along(times, q, va), load

    def _robot_rates(self, q: Array, rates: Array) -> Array:
        """Rates of the robot's coordinates, shape (N, n)."""
        if self.states is self.robot_states:
            return rates
        v = [self.states.joint_rates(*x) for x in zip(q, rates, strict=True)]
        return np.array(v)[:, self.robot_states.coordinates]

    def along(self, times: Array, states: Array) -> tuple[Array, Array, Array, Array]:
        """q, va, aa of the robot's coordinates, and torques, at times and states."""
        q = self.states.closed(states)
        rates = states[:, q.shape[1] :]
        va = self._robot_rates(q, rates)
        tau = self.torque.along(times, q, va)
        load = None if self.load is None else self.load.along(times, q, va)
        aa = self.states.rate(states, tau, load)[:, q.shape[1] :]
        if self.states is not self.robot_states:
            v_dot = [self.states.joint_motion(*x)[1] for x in zip(q, rates, aa, strict=True)]
            aa = np.array(v_dot)[:, self.robot_states.coordinates]
        return q, va, aa, tau
