# SPDX-License-Identifier: BSD-2-Clause
"""Motions of a closed chain as variables of a nonlinear program, by direct collocation.

A motion is cut into intervals of equal length; torques are held over each, as a digital controller
does. Within an interval the coordinates and their rates are polynomials through its Radau points,
where the equations of motion hold: with constant torques the motion is smooth there, and the error
goes with the fifth power of the interval's length. The passive joints are algebraic variables: at
each point the closures hold.

pip install 'sst-pin[compile]'      # CasADi, which brings IPOPT
"""

from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

import sst_pin

Array = NDArray[np.float64]
DEGREE = 3  # of the polynomials


class Solution(NamedTuple):
    """A motion found.

    Attributes:
        t: Times of the points, the start first, shape (points + 1,), [s].
        q: Configurations at t, shape (points + 1, nq).
        va: Rates of the coordinates at t, shape (points + 1, n).
        tau: Torques of each interval, shape (intervals, motors).
        duration: [s].
        iterations: Most iterations of IPOPT.
    """

    t: Array
    q: Array
    va: Array
    tau: Array
    duration: float
    iterations: int


class Transcription:
    """The nonlinear program of a motion from rest; add an objective and constraints, then solve.

    Args:
        chain: The robot; as many motors as coordinates, a motor on each.
        start: Configuration at the start, at rest, shape (nq,).
        intervals: How many pieces of constant torque.

    Attributes:
        opti: The `casadi.Opti` that holds all below.
        duration: [s].
        q: Configurations at the points, shape (nq, points), three points for each interval.
        va: Rates of the coordinates at the points, shape (n, points).
        tau: Torques of each interval, shape (motors, intervals).
        fractions: Times of the points over the duration, shape (points,).
    """

    def __init__(self, chain: sst_pin.ClosedChain, start: ArrayLike, intervals: int) -> None:
        self._start = np.asarray(start, dtype=float)
        self._coordinates = [chain.position_names.index(name) for name in chain.coordinates]
        n = chain.degrees_of_freedom
        points = DEGREE * intervals
        self.opti = opti = ca.Opti()
        self.duration = opti.variable()
        self.q = opti.variable(len(self._start), points)
        self.va = opti.variable(n, points)
        self.tau = opti.variable(n, intervals)
        nodes = ca.collocation_points(DEGREE, "radau")
        self.fractions = (np.arange(intervals)[:, None] + nodes).ravel() / intervals
        slopes, _, weights = (np.array(x) for x in ca.collocation_coeff(nodes))
        self._weights = np.tile(weights.ravel(), intervals) / intervals
        dynamics = point_equations(chain).map(intervals)
        step = self.duration / intervals
        angles = self.q[self._coordinates, :]
        for j in range(DEGREE):
            turned = _slope(angles, self._start[self._coordinates], slopes[:, j])
            gained = _slope(self.va, np.zeros(n), slopes[:, j])
            q = self.q[:, j::DEGREE]
            va = self.va[:, j::DEGREE]
            opti.subject_to(ca.vec(turned - step * va) == 0)
            opti.subject_to(ca.vec(dynamics(q, va, gained / step, self.tau)) == 0)

    def end_at(self, q: ArrayLike) -> None:
        """Come to rest at a configuration, shape (nq,)."""
        goal = np.asarray(q, dtype=float)[self._coordinates]
        self.opti.subject_to(self.q[self._coordinates, -1] == goal)
        self.opti.subject_to(self.va[:, -1] == 0)

    def bound(self, low: ArrayLike, what: ca.MX, high: ArrayLike) -> None:
        """Limits of rows of a matrix, one for each row or one for all."""
        low, high = (np.broadcast_to(x, what.shape[:1])[:, None] for x in (low, high))
        low, high = (np.tile(x, what.shape[1]).T.ravel() for x in (low, high))
        self.opti.subject_to(self.opti.bounded(low, ca.vec(what), high))

    def torques(self) -> ca.MX:
        """Torques at the points, shape (motors, points)."""
        return ca.kron(self.tau, np.ones((1, DEGREE)))

    def integral(self, x: ca.MX) -> ca.MX:
        """Integral over the motion of what has the values x at the points, shape (1, points)."""
        return self.duration * ca.mtimes(x, self._weights)

    def guess_line(self, q: ArrayLike, duration: float) -> None:
        """Guess the straight line to a configuration, shape (nq,): loops open, rates zero."""
        way = np.asarray(q, dtype=float) - self._start
        self.opti.set_initial(self.q, self._start[:, None] + way[:, None] * self.fractions)
        self.opti.set_initial(self.duration, duration)

    def guess(self, motion: sst_pin.Trajectory) -> None:
        """Guess a motion, its samples those of the points, [0, fractions] of its duration."""
        self.opti.set_initial(self.q, motion.q[1:].T)
        self.opti.set_initial(self.va, motion.va[1:].T)
        pieces = motion.tau[1:].reshape(-1, DEGREE, self.tau.shape[0])
        self.opti.set_initial(self.tau, pieces.mean(axis=1).T)
        self.opti.set_initial(self.duration, motion.t[-1])

    def solve(self, print_level: int = 0) -> Solution:
        """Find the motion with IPOPT.

        Args:
            print_level: Print level of IPOPT.

        Raises:
            RuntimeError: When IPOPT does not converge.
        """
        opti = self.opti
        options = {"print_time": False, "detect_simple_bounds": True}
        opti.solver("ipopt", options, {"print_level": print_level, "sb": "yes"})
        found = opti.solve()
        seconds = float(found.value(self.duration))
        return Solution(
            np.append(0, seconds * self.fractions),
            np.vstack([self._start, found.value(self.q).T]),
            np.vstack([np.zeros(len(self._coordinates)), found.value(self.va).T]),
            found.value(self.tau).T,
            seconds,
            found.stats()["iter_count"],
        )


def point_equations(chain: sst_pin.ClosedChain) -> ca.Function:
    """What is zero at a point: (q, va, aa, tau) to the equations of motion and of the closures."""
    functions = chain.casadi()
    n = chain.degrees_of_freedom
    nq = len(chain.position_names)
    q, va, aa, tau = (ca.SX.sym(*x) for x in (("q", nq), ("va", n), ("aa", n), ("tau", n)))
    equations = ca.vertcat(functions.torques(q, va, aa) - tau, functions.residual(q))
    return ca.Function("point", [q, va, aa, tau], [equations])


def _slope(x: ca.MX, first: Array, weights: Array) -> ca.MX:
    """Slopes of the polynomials of all intervals at one of their points, times their length."""
    starts = ca.horzcat(first, x[:, DEGREE - 1 : -1 : DEGREE])
    return starts * weights[0] + sum(x[:, i::DEGREE] * weights[i + 1] for i in range(DEGREE))
