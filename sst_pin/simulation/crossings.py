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

#: The search for a singular configuration ends after this many times the expected time, which is
#: only a linear estimate.
_AHEAD = 2.0
#: A singular value below this part of its value at the start counts as zero.
_VANISHED = 0.03
#: Halfway there, one that falls linearly is about half of its value at the start: between these
#: parts. Where branches are tangent, it falls with the square of the time, to a quarter.
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
    """A motion as polynomials of degree 2 N - 1: Hermite's interpolation through N states.

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


class _ConstraintJacobian:
    """Phi along a branch, and its singular values that are not zero everywhere.

    Phi has nv columns, and the mechanism has n degrees of freedom. So r = nv - n singular values of
    Phi are positive where the mechanism is regular. The others, of redundant rows, are zero.

    Attributes:
        rank: r, the rank of Phi at the start.
        values_at_start: The r singular values there, the largest first.
    """

    def __init__(self, space: StateSpace, branch: Branch, start: float) -> None:
        self._space = space
        self._branch = branch
        U, values, Vt = np.linalg.svd(self.at(start))
        self.rank = Vt.shape[0] - len(space.coordinates)
        self.values_at_start = values[: self.rank]
        self._U = U[:, : self.rank]
        self._V = Vt[: self.rank].T

    def at(self, t: float) -> Array:
        """Phi at a time, shape (rows, nv)."""
        return self._space.Phi(self._branch.q(t))

    def singular_values(self, t: float) -> Array:
        """The r largest singular values at a time, the largest first."""
        return np.asarray(np.linalg.svd(self.at(t), compute_uv=False)[: self.rank])

    def _reduced(self, t: float) -> Array:
        """U^T Phi V with the r singular vectors U and V at the start, shape (r, r).

        It has no singular value that is zero everywhere: it is diagonal at the start, and along the
        branch it is singular where Phi loses rank. So it has a determinant and a smallest value.
        """
        return self._U.T @ self.at(t) @ self._V

    def least_vectors(self, t: float) -> tuple[Array, Array]:
        """The left and the right singular vector of the smallest of the r values at a time."""
        left_vectors, _, right_vectors = np.linalg.svd(self._reduced(t))
        return left_vectors[:, -1] @ self._U.T, self._V @ right_vectors[-1]

    def determinant_sign(self, t: float) -> float:
        """Sign of det(U^T Phi V), which each singular value that passes zero changes."""
        sign, _ = np.linalg.slogdet(self._reduced(t))
        return float(sign)


def crossing_of(space: StateSpace, branch: Branch, start: float, remaining: float) -> Crossing:
    """The singular configuration on a branch, expected at `remaining` after `start`.

    Raises:
        BranchError: If the branch through it is not determined.
    """
    jacobian = _ConstraintJacobian(space, branch, start)
    time = _singular_time(jacobian, start, start + _AHEAD * remaining)
    zero = _VANISHED * jacobian.values_at_start
    lost = int(np.count_nonzero(jacobian.singular_values(time) < zero))
    _require_determined_branch(jacobian, start, time, lost)
    rank = jacobian.rank
    return Crossing(time, branch.q(time), rank_before=rank, rank=rank - lost)


def _singular_time(jacobian: _ConstraintJacobian, start: float, until: float) -> float:
    """The time from `start` to `until` where Phi loses rank, [s].

    Its smallest singular value vanishes there. A singular value has no sign, so its root cannot be
    bracketed. With its singular vectors u and w, the function u^T Phi w is about this value with a
    sign: Brent's method finds its root. The vectors are first those at the start, then those at
    this root, because they vary a little along the branch.
    """
    from scipy.optimize import brentq

    time = start
    for _ in range(2):
        u, w = jacobian.least_vectors(time)

        def signed_value(t: float, u: Array = u, w: Array = w) -> float:
            return float(u @ jacobian.at(t) @ w)

        if signed_value(start) * signed_value(until) > 0:
            raise BranchError(f"{_UNDETERMINED}: the extrapolated motion does not cross it")
        # As exactly as numbers allow: the step across is centred at this time.
        time = float(brentq(signed_value, start, until, xtol=1e-15, rtol=1e-14))
    return time


def _require_determined_branch(
    jacobian: _ConstraintJacobian, start: float, time: float, lost: int
) -> None:
    """Refuse a singular configuration that does not determine the branch behind it.

    Args:
        jacobian: Phi along the branch.
        start: A time before the singular configuration.
        time: The time of the singular configuration.
        lost: How many ranks Phi loses there.
    """
    # Each lost rank changes the sign of the determinant once; another singular configuration would
    # change it too.
    behind = 2 * time - start
    change = jacobian.determinant_sign(start) * jacobian.determinant_sign(behind)
    if change != (-1) ** lost:
        raise BranchError(f"{_UNDETERMINED}: another singular configuration is next to it")
    # The smallest singular value falls linearly unless branches are tangent to each other.
    smallest = jacobian.singular_values((start + time) / 2)[-1] / jacobian.values_at_start[-1]
    if not lost or not _HALFWAY[0] < smallest < _HALFWAY[1]:
        raise BranchError(f"{_UNDETERMINED}: branches are tangent to each other there")


class _ButcherTableau(NamedTuple):
    """Coefficients of an implicit Runge-Kutta method with s stages.

    Attributes:
        c: Times of the stages and of the end, in lengths of the step, shape (s + 1,).
        A: Shape (s + 1, s): the stages are y_i = y_0 + h sum_j A_ij f(t_0 + c_j h, y_j). The last
            row, whose entries are often called b, gives the end.
    """

    c: Array
    A: Array


def _gauss_tableau(stages: int) -> _ButcherTableau:
    """Gauss' method, of order 2 s for s stages: they are at the roots of a Legendre polynomial.

    It is a collocation method: A_ij is the integral from 0 to c_i of the Lagrange polynomial that
    is one at stage j and zero at the others (E. Hairer, S. P. Nørsett, G. Wanner, Solving Ordinary
    Differential Equations I, Sect. II.7).
    """
    roots, _ = np.polynomial.legendre.leggauss(stages)
    nodes = (1 + roots) / 2  # from (-1, 1) to (0, 1)
    c = np.append(nodes, 1)
    # The columns of the inverse have the coefficients of the Lagrange polynomials, by powers.
    powers = np.arange(stages)
    lagrange_coefficients = np.linalg.inv(nodes[:, None] ** powers)
    integrals_of_powers = c[:, None] ** (powers + 1) / (powers + 1)
    return _ButcherTableau(c, integrals_of_powers.dot(lagrange_coefficients))


def gauss_step(
    space: StateSpace,
    rate: Callable[[float, Array], Array],
    start: float,
    state: Array,
    end: float,
    guess: Branch,
) -> tuple[Array, Array]:
    """A step of Gauss' implicit method of order 16: times and states of start, stages and end.

    The stages are found by fixed-point iteration from those of `guess`; after each iteration loops
    are closed.
    """
    tableau = _gauss_tableau(_STAGES)
    h = end - start
    times = start + h * tableau.c  # of the stages and the end
    coordinates = space.coordinates
    states = np.array([[*guess.q(t), *guess.v(t)[coordinates]] for t in times])
    nq = states.shape[1] - len(coordinates)
    change = np.inf
    for _ in range(_ITERATIONS):
        states[:, :nq] = space.closed(states)
        rates = np.array([rate(t, y) for t, y in zip(times[:-1], states[:-1], strict=True)])
        before = states
        states = state + h * tableau.A.dot(rates)
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
