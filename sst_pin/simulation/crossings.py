# SPDX-License-Identifier: BSD-2-Clause
"""Smooth motions through a singular configuration of the mechanism.

Several branches of motions meet at this configuration. Polynomials extrapolate the motion before
it; they close the loops on one branch only. They are the initial guess of an implicit Runge-Kutta
step over the configuration. No stage of the step is at the configuration.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..model.mechanism import Mechanism
from ..states import StateSpace

#: The search for a singular configuration ends after this many times the expected time.
_AHEAD = 2.0
#: A singular value below this part of its value at the start counts as zero.
_VANISHED = 0.03
#: Halfway there, one that falls linearly is between these parts of its value at the start.
_HALFWAY = (0.3, 0.7)
#: Stages of the step, an even number so that none is in the middle.
_STAGES = 8
#: The most iterations of the step.
_ITERATIONS = 20
#: The first words of a `BranchError` error.
_UNDETERMINED = "the branch behind it is not determined"


class BranchError(Exception):
    """No motion leads through a singular configuration; the text says why."""


class Crossing(NamedTuple):
    """A singular configuration that a motion went through.

    Attributes:
        time: Time, [s].
        q: The configuration, shape (nq,).
        rank_before: Rank of the closures' Jacobian Phi next to it.
        rank: Rank of Phi there, smaller by the degrees of freedom that the mechanism gains.

    Example:
        >>> bars = {"crank": 0.2, "rocker": 0.2, "coupler": 0.3, "ground": 0.3, "point": 0.3}
        >>> chain = sst_pin.robots.four_bar(**bars)  # a parallelogram
        >>> t = [0, 0.3]
        >>> motion = chain.simulate([0], chain.home, [-1], t, through_singularities=True)
        >>> [(crossing.rank_before, crossing.rank) for crossing in motion.crossings]
        [(2, 1)]
    """

    time: float
    q: Array
    rank_before: int
    rank: int


class Branch:
    """Polynomials of degree 2 N - 1 through N states of a motion and their derivatives.

    Args:
        mechanism: The robot.
        times: Times of the states in any order, shape (N,), [s].
        q: Configurations, shape (N, nq).
        v: Rates of all joints, shape (N, nv).
        v_dot: Accelerations of all joints, shape (N, nv).
        unit: Unit of time of the polynomials, about the length of the extrapolation, [s].
    """

    def __init__(
        self, mechanism: Mechanism, times: Array, q: Array, v: Array, v_dot: Array, unit: float
    ) -> None:
        from scipy.interpolate import KroghInterpolator

        space = mechanism.space
        self._start = times[0]
        self._unit = unit
        self._normalised = space.normalised
        # SciPy takes each time twice: first with the value, then with the derivative.
        x = np.repeat((times - times[0]) / unit, 2)

        def interpolator(values: Array, derivatives: Array) -> KroghInterpolator:
            rows = np.stack([values, unit * derivatives], axis=1)
            return KroghInterpolator(x, rows.reshape(len(x), -1))

        q_dot = np.array([space.coordinate_rates(q_k, v_k) for q_k, v_k in zip(q, v, strict=True)])
        self._q = interpolator(q, q_dot)
        self._v = interpolator(v, v_dot)

    def q(self, t: float) -> Array:
        """The configuration."""
        return self._normalised(np.asarray(self._q((t - self._start) / self._unit)))

    def v(self, t: float) -> Array:
        """Rates of all joints."""
        return np.asarray(self._v((t - self._start) / self._unit))

    def v_dot(self, t: float) -> Array:
        """Accelerations of all joints."""
        return np.asarray(self._v.derivative((t - self._start) / self._unit)) / self._unit


def crossing_of(space: StateSpace, branch: Branch, start: float, remaining: float) -> Crossing:
    """The singular configuration on a branch, expected at `remaining` after `start`.

    Phi loses rank where its smallest singular value vanishes. With its singular vectors u and w
    the function u^T Phi w changes its sign there, so that its root is found by bisection.

    Raises:
        BranchError: If the branch through it is not determined.
    """
    from scipy.optimize import brentq

    def Phi(t: float) -> Array:
        return space.Phi(branch.q(t))

    U, values, Vt = np.linalg.svd(Phi(start))
    # Without the singular values that are zero everywhere, Phi is the square matrix
    # rows Phi rates, shape (rank, rank).
    rank = Vt.shape[0] - len(space.coordinates)
    rows = U[:, :rank].T
    rates = Vt[:rank].T

    # The time of the crossing. The singular vectors are first those at the start, then those at the
    # time found with them, because they vary a little along the branch.
    time = start
    until = start + _AHEAD * remaining
    for _ in range(2):
        left_vectors, _, right_vectors = np.linalg.svd(rows @ Phi(time) @ rates)
        u = left_vectors[:, -1] @ rows
        w = rates @ right_vectors[-1]

        def smallest_value(t: float, u: Array = u, w: Array = w) -> float:
            return float(u @ Phi(t) @ w)  # with its sign

        if smallest_value(start) * smallest_value(until) > 0:
            raise BranchError(f"{_UNDETERMINED}: the extrapolated motion does not cross it")
        time = float(brentq(smallest_value, start, until, xtol=1e-15, rtol=1e-14))

    values_there = np.linalg.svd(Phi(time), compute_uv=False)
    lost = int(np.count_nonzero(values_there[:rank] < _VANISHED * values[:rank]))
    # Each lost rank changes the sign of the determinant once; another singular configuration would
    # change it too.
    sign_before, _ = np.linalg.slogdet(rows @ Phi(start) @ rates)
    sign_behind, _ = np.linalg.slogdet(rows @ Phi(2 * time - start) @ rates)
    if sign_before * sign_behind != (-1) ** lost:
        raise BranchError(f"{_UNDETERMINED}: another singular configuration is next to it")
    # The smallest singular value falls linearly unless branches are tangent to each other.
    values_halfway = np.linalg.svd(Phi((start + time) / 2), compute_uv=False)
    part = values_halfway[rank - 1] / values[rank - 1]
    if not lost or not _HALFWAY[0] < part < _HALFWAY[1]:
        raise BranchError(f"{_UNDETERMINED}: branches are tangent to each other there")
    return Crossing(time, branch.q(time), rank, rank - lost)


def gauss_step(
    space: StateSpace,
    rate: Callable[[float, Array], Array],
    start: float,
    state: Array,
    end: float,
    guess: Branch,
) -> tuple[Array, Array]:
    """A step of Gauss' implicit method of order 16: times and states of start, stages and end.

    With h the step, x_i in (0, 1) the stages, and A_ij the integral of the Lagrange polynomial of
    stage j from 0 to x_i (to 1 for the end), y_i = y_0 + h sum_j A_ij f(t_j, y_j). The stages are
    found by iteration from those of `guess`; after each iteration loops are closed.
    """
    nodes, _ = np.polynomial.legendre.leggauss(_STAGES)
    x = (1 + nodes) / 2  # from (-1, 1) to (0, 1)
    upper = np.append(x, 1)[:, None]  # upper limits of the integrals
    powers = np.arange(_STAGES)
    integrals_of_powers = upper ** (powers + 1) / (powers + 1)
    A = integrals_of_powers.dot(np.linalg.inv(x[:, None] ** powers))
    h = end - start
    times = start + h * upper[:, 0]  # of the stages and the end
    coordinates = space.coordinates
    states = np.array([[*guess.q(t), *guess.v(t)[coordinates]] for t in times])
    nq = states.shape[1] - len(coordinates)
    change = np.inf
    for _ in range(_ITERATIONS):
        states[:, :nq] = space.closed(states)
        rates = np.array([rate(t, y) for t, y in zip(times[:-1], states[:-1], strict=True)])
        before = states
        states = state + h * A.dot(rates)
        last_change = change
        change = float(np.abs(states - before).max())
        if not change < last_change / 2:  # the rest is rounding
            break
    states[:, :nq] = space.closed(states)
    return np.append(start, times), np.vstack([state, states])


def mismatch(
    mechanism: Mechanism, branch: Branch, t: float, q: Array, v: Array, remaining: float
) -> float:
    """How far q and v at a time are from a branch, relative to the motion in `remaining`."""
    scale = mechanism.rate_scale
    q_error = pin.difference(mechanism.model, branch.q(t), q) / scale
    v_error = remaining * (v - branch.v(t)) / scale
    travel = remaining * float(np.abs(v / scale).max())
    error = max(float(np.abs(q_error).max()), float(np.abs(v_error).max()))
    return error / max(travel, 1e-300)
