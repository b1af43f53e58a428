# SPDX-License-Identifier: BSD-2-Clause
"""Controllers that follow a motion: each gives the motors' torques for a time and a state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, finite_array, in_one_turn, one_or_each
from ..closed_chain import ClosedChain
from ..dynamics.torque_sharing import finite_limits, within_limits
from ..engine import require_robot
from ..errors import ActuationError, InputError
from ..loops.mobility import rotating_freely
from ..model.named_positions import positions_of
from ..simulation.coordinate_motions import positions_along
from ..simulation.samples import spline
from ..simulation.trajectories import Trajectory, require_motion
from ..summaries import listed

#: Time steps of a motion are equal if they differ by less than this part of their mean: rounding of
#: times such as those of numpy.linspace.
_EQUAL_STEPS = 1e-9
#: Least eigenvalue of a positive definite matrix of weights, relative to the largest: its inverse
#: still has a few digits.
_DEFINITE = 1e-12
#: Eigenvalues are exact to this part of the largest.
_ROUNDING = 1e-15


class _Errors(NamedTuple):
    """Desired minus actual values, and the desired accelerations, each of shape (n,)."""

    positions: Array
    rates: Array
    desired_accelerations: Array


class Controller(ABC):
    """A robot's model, the motion to follow and limits of torques: the base of all controllers.

    Before and after the motion, its first or last configuration is held.

    Args:
        chain: The model of the robot; its motors must hold all coordinates, each of which turns
            about an axis or slides along one.
        motion: The motion to follow, of this robot.
        limits: Largest torque of each motor, shape (motors,) or (), or least and largest ones,
            shape (motors, 2); none by default.

    Raises:
        InputError: For a motion of another robot, or one with fewer than three samples.
        ActuationError: If the motors do not hold all coordinates.
    """

    def __init__(
        self, chain: ClosedChain, motion: Trajectory, *, limits: ArrayLike | None = None
    ) -> None:
        require_robot("chain", chain)
        self.chain = chain
        self.motion = motion
        require_motion(motion, chain.mechanism)
        if len(motion) < 3:
            raise InputError("motion", "at least three samples are needed")
        mobility = chain.mobility(motion.q[0])
        if not mobility.sufficient:
            problem = (
                f"no motor holds {listed(mobility.loose_joints)}: no controller can follow a motion"
            )
            if mobility.idle_joints:
                problem += f"; {rotating_freely(mobility.idle_joints)}"
            raise ActuationError(problem)
        motors = len(chain.motor_names)
        self.limits = None if limits is None else finite_limits(limits, motors, "limits")
        self._is_angle = np.array(chain.mechanism.coordinate_rate_units) == "rad"
        self._path = spline(motion.t, positions_along(chain.mechanism, motion))
        self._rates = self._path.derivative(1)
        self._accelerations = self._path.derivative(2)

    def torque(self, t: float, q: Array, va: Array) -> Array:
        """Torques of the motors, within the limits, shape (motors,).

        A preload of surplus motors keeps them within the limits. If none can, they are clipped.
        Usable as `torque=` of `simulate`.

        Args:
            t: Time, [s].
            q: Configuration, shape (nq,).
            va: Rates of the coordinates, shape (n,).
        """
        tau = self._torque(t, q, va)
        if self.limits is None:
            return tau
        least, largest = self.limits.T
        if (tau < least).any() or (tau > largest).any():
            tau = within_limits(tau, self.chain.preload_directions(q), self.limits)
        return np.clip(tau, least, largest)

    @abstractmethod
    def _torque(self, t: float, q: Array, va: Array) -> Array:
        """Torques of the motors without limits."""

    def _errors(self, t: float, q: Array, va: Array) -> _Errors:
        """Errors at a time; those of angles are without full turns."""
        t_in_motion = self._time_in_motion(t)
        positions = positions_of(self.chain.mechanism.space, q, self.chain.coordinates)
        error = self._path(t_in_motion) - positions
        error[self._is_angle] = in_one_turn(error[self._is_angle])
        is_in_motion = t == t_in_motion
        if is_in_motion:
            desired_rates = self._rates(t)
            desired_accelerations = self._accelerations(t)
        else:  # before or after the motion: hold
            desired_rates = np.zeros_like(va)
            desired_accelerations = np.zeros_like(va)
        return _Errors(error, desired_rates - va, desired_accelerations)

    def _time_in_motion(self, t: float) -> float:
        """The time, clipped to the interval of the motion."""
        return float(min(max(t, self.motion.t[0]), self.motion.t[-1]))

    def _motor_torques(self, q: Array, f: Array) -> Array:
        """The smallest torques that give forces f along the coordinates."""
        J = self.chain.actuator_jacobian(q)
        return np.asarray(np.linalg.lstsq(J.T, f, rcond=None)[0])

    def _gains(self, name: str, value: ArrayLike) -> Array:
        """A gain for each coordinate, from one or from each, shape (n,)."""
        return one_or_each(name, value, self.chain.degrees_of_freedom, or_zero=True)


class _Feedback(Controller):
    """Controllers with gains of positions and of rates."""

    def __init__(
        self,
        chain: ClosedChain,
        motion: Trajectory,
        *,
        kp: ArrayLike,
        kd: ArrayLike,
        limits: ArrayLike | None = None,
    ) -> None:
        super().__init__(chain, motion, limits=limits)
        self.kp = self._gains("kp", kp)
        self.kd = self._gains("kd", kd)


class ComputedTorque(_Feedback):
    """Inverse dynamics with feedback: errors decay in the same way in every configuration.

    If the model is exact, the errors e of the coordinates obey e'' + kd e' + kp e = 0. The other
    arguments are as in `Controller`.

    Args:
        kp: Position gains, () or shape (n,), [1/s^2].
        kd: Rate gains, () or shape (n,), [1/s].

    Example:
        >>> x = np.full((3, 1), chain.home[0])
        >>> motion = sst_pin.coordinate_motion(chain, [0, 0.5, 1.0], x)
        >>> control = sst_pin.ComputedTorque(chain, motion, kp=400, kd=40)
        >>> control.torque(0.0, chain.home, np.zeros(1)).round(2)
        array([0.16])
    """

    def _torque(self, t: float, q: Array, va: Array) -> Array:
        errors = self._errors(t, q, va)
        aa = errors.desired_accelerations
        aa = aa + self.kd * errors.rates + self.kp * errors.positions
        return self.chain.compute_torques(q, va, aa)


class GravityPD(_Feedback):
    """PD control with gravity compensation.

    From the model it uses only gravity, springs and forces along lines. The other arguments are
    those of `Controller`.

    Args:
        kp: Position gains, () or shape (n,), [N m/rad] or [N/m].
        kd: Rate gains, () or shape (n,), [N m s/rad] or [N s/m].
    """

    def _torque(self, t: float, q: Array, va: Array) -> Array:
        errors = self._errors(t, q, va)
        zero = np.zeros_like(va)
        hold = self.chain.compute_torques(q, zero, zero)
        return hold + self._motor_torques(q, self.kp * errors.positions + self.kd * errors.rates)


class TrackingLQR(Controller):
    """The torques of the motion plus the linear feedback of least cost along it.

    The cost is the sum of x^T Q x + u^T R u over the samples of the motion. Here x is the actual
    state (coordinates, rates) minus the desired one, and u = -gains x is the change of the torques.
    Before and after the motion, the robot is held at its first or last configuration. The
    other arguments are those of `Controller`; the time steps of the motion must be equal.

    Args:
        Q: Weights of x, shape (2 n,) or (2 n, 2 n).
        R: Weights of u, shape (motors,) or (motors, motors).

    Attributes:
        gains: Feedback at each sample, shape (N, motors, 2 n).

    Raises:
        InputError: For unequal time steps, a Q that is not positive semidefinite, an R that is not
            positive definite, or if no linear feedback holds the end of the motion.
    """

    def __init__(
        self,
        chain: ClosedChain,
        motion: Trajectory,
        *,
        Q: ArrayLike,
        R: ArrayLike,
        limits: ArrayLike | None = None,
    ) -> None:
        from scipy.interpolate import make_interp_spline
        from scipy.linalg import LinAlgError, solve_discrete_are

        super().__init__(chain, motion, limits=limits)
        steps = np.diff(motion.t)
        if np.ptp(steps) > _EQUAL_STEPS * steps.mean():
            raise InputError("motion", "its times must have equal steps")
        n = chain.degrees_of_freedom
        motors = len(chain.motor_names)
        cost = _weights("Q", Q, 2 * n, 0.0)
        effort = _weights("R", R, motors, _DEFINITE)
        A, B = chain.linearize(motion.q, motion.va, motion.tau, dt=float(steps.mean()))
        # x^T P x is the least cost of all that follows a sample with the state x. After the motion,
        # the robot is held at its last sample.
        try:
            P = solve_discrete_are(A[-1], B[-1], cost, effort)
        except LinAlgError:
            raise InputError("Q", "no linear feedback holds the end of the motion") from None
        # Riccati's equation from the end of the motion to its start: u = -K x has the least cost.
        # With errors = desired - actual = -x, the feedback is K errors.
        self.gains = np.empty((len(motion), motors, 2 * n))
        for k in reversed(range(len(motion))):
            K = np.linalg.solve(effort + B[k].T @ P @ B[k], B[k].T @ P @ A[k])
            P = cost + A[k].T @ P @ (A[k] - B[k] @ K)
            P = (P + P.T) / 2  # P is symmetric; without this, rounding would grow
            self.gains[k] = K
        self._gains_at = make_interp_spline(motion.t, self.gains, k=1)
        self._torques_of_motion = spline(motion.t, motion.tau)
        # Torques that hold the robot at the start and at the end.
        zero = np.zeros((2, n))
        self._holding = chain.compute_torques(motion.q[[0, -1]], zero, zero)

    def _torque(self, t: float, q: Array, va: Array) -> Array:
        t_in_motion = self._time_in_motion(t)
        errors = self._errors(t, q, va)
        if t < t_in_motion:  # before the motion
            tau = self._holding[0]
        elif t > t_in_motion:  # after it
            tau = self._holding[1]
        else:
            tau = self._torques_of_motion(t)
        feedback = self._gains_at(t_in_motion) @ np.concatenate([errors.positions, errors.rates])
        return tau + feedback


def _weights(name: str, value: ArrayLike, size: int, least: float) -> Array:
    """The matrix of weights, shape (size, size), of a matrix or its diagonal.

    It must be symmetric, without an eigenvalue below `least` times the largest.
    """
    weights = finite_array(name, value, ())
    matrix = np.diag(weights) if weights.shape == (size,) else weights
    if matrix.shape != (size, size) or not np.allclose(matrix, matrix.T):
        raise InputError(name, f"needed: shape ({size},), or a symmetric ({size}, {size})")
    values = np.linalg.eigvalsh(matrix)
    if values[-1] <= 0 or values[0] < (least - _ROUNDING) * values[-1]:
        raise InputError(name, "not positive")
    return matrix
