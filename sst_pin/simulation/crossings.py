# SPDX-License-Identifier: BSD-2-Clause
"""Smooth motions through a singular configuration of the mechanism.

Several branches of motions meet at this configuration. `SingularityCrossing` steps over it with the
parts of this module:

1. `Branch` extrapolates the motion before the configuration by polynomials. They close the loops
   on one branch only.
2. `crossing_of` finds the configuration on the branch, as a `Crossing`. It refuses configurations
   at which the branch behind is not determined.
3. `gauss_step` makes an implicit Runge-Kutta step over the configuration. The branch is its initial
   guess. No stage of the step is at the configuration, where the equations of motion are singular.
4. `mismatch` tells how well the end of the step fits the branch.
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
#: A singular value below this part of its value at the start counts as zero. The singular time is
#: known for the extrapolated motion only, and the singular values at this time are not quite zero.
_VANISHED = 0.03
#: Halfway from the start to the singular configuration, the smallest singular value is between
#: these parts of its value at the start if it falls linearly, to about a half. Where branches are
#: tangent to each other, it falls with the square of the remaining time, to a quarter.
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
            pairs = np.stack([values, unit * derivatives], axis=1)  # (N, value or derivative, ...)
            return KroghInterpolator(x, pairs.reshape(len(x), -1))

        q_dot = np.array([space.q_dot(q_k, v_k) for q_k, v_k in zip(q, v, strict=True)])
        self._q = interpolator(q, q_dot)
        self._v = interpolator(v, v_dot)

    def q(self, t: float) -> Array:
        """The configuration at a time, shape (nq,)."""
        return self._normalised(np.asarray(self._q((t - self._start) / self._unit)))

    def v(self, t: float) -> Array:
        """Rates of all joints at a time, shape (nv,)."""
        return np.asarray(self._v((t - self._start) / self._unit))

    def v_dot(self, t: float) -> Array:
        """Accelerations of all joints at a time, shape (nv,)."""
        return np.asarray(self._v.derivative((t - self._start) / self._unit)) / self._unit


def singular_values(space: StateSpace, q: Array) -> Array:
    """The r singular values of Phi that are not zero at every configuration, the largest first.

    Phi has nv columns, and the mechanism has n degrees of freedom. So r = nv - n singular values of
    Phi are positive where the mechanism is regular. If rows are redundant, Phi has more singular
    values, which are zero at every configuration.
    """
    Phi = space.Phi(q)
    r = Phi.shape[1] - len(space.coordinates)
    return np.asarray(np.linalg.svd(Phi, compute_uv=False)[:r])


class _ConstraintJacobian:
    """Phi along a branch, and the r singular values of `singular_values`.

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
        """The r singular values at a time, the largest first."""
        return singular_values(self._space, self._branch.q(t))

    def _reduced(self, t: float) -> Array:
        """The reduced matrix U^T Phi V, with Phi at a time, shape (r, r).

        The columns of U and V are the first r singular vectors of Phi at the start. So the matrix
        is diagonal at the start, with the r positive singular values. Unlike Phi, it is square: it
        has a determinant, and along the branch it is singular where Phi loses rank.
        """
        return self._U.T @ self.at(t) @ self._V

    def least_vectors(self, t: float) -> tuple[Array, Array]:
        """The singular vectors u and w of the smallest singular value of the reduced matrix.

        They are in the axes of Phi, with shapes (rows,) and (nv,): u^T Phi w is this value.
        """
        left_vectors, _, right_vectors = np.linalg.svd(self._reduced(t))
        return left_vectors[:, -1] @ self._U.T, self._V @ right_vectors[-1]

    def determinant_sign(self, t: float) -> float:
        """Sign of the determinant of the reduced matrix.

        It changes each time that one singular value passes through zero.
        """
        sign, _ = np.linalg.slogdet(self._reduced(t))
        return float(sign)


def crossing_of(space: StateSpace, branch: Branch, start: float, remaining: float) -> Crossing:
    """The singular configuration on a branch, expected a time `remaining` after `start`, [s].

    Raises:
        BranchError: If the branch through it is not determined.
    """
    jacobian = _ConstraintJacobian(space, branch, start)
    time = _singular_time(jacobian, start, start + _AHEAD * remaining)
    count_as_zero_below = _VANISHED * jacobian.values_at_start
    lost = int(np.count_nonzero(jacobian.singular_values(time) < count_as_zero_below))
    _require_determined_branch(jacobian, start, time, lost)
    rank = jacobian.rank
    return Crossing(time, branch.q(time), rank_before=rank, rank=rank - lost)


def _singular_time(jacobian: _ConstraintJacobian, start: float, until: float) -> float:
    """The time from `start` to `until` where Phi loses rank, [s].

    The smallest of the r singular values is zero at this time. A singular value is never negative,
    so its root cannot be bracketed. With the singular vectors u and w of this value, u^T Phi w is
    about the singular value with a sign, and Brent's method finds the root of this function. The
    vectors vary a little along the branch: the first root is found with the vectors at the start,
    the second one with the vectors at the first root.
    """
    first_root = _root_of_least_value(jacobian, start, start, until)
    return _root_of_least_value(jacobian, first_root, start, until)


def _root_of_least_value(
    jacobian: _ConstraintJacobian, time_of_vectors: float, start: float, until: float
) -> float:
    """The time where u^T Phi w is zero, [s], with the vectors u and w of `time_of_vectors`."""
    from scipy.optimize import brentq

    u, w = jacobian.least_vectors(time_of_vectors)

    def signed_value(t: float) -> float:
        return float(u @ jacobian.at(t) @ w)

    if signed_value(start) * signed_value(until) > 0:
        raise BranchError(f"{_UNDETERMINED}: the extrapolated motion does not cross it")
    # The root is found to rounding, because the step across is centred at this time.
    return float(brentq(signed_value, start, until, xtol=1e-15, rtol=1e-14))


def _require_determined_branch(
    jacobian: _ConstraintJacobian, start: float, time: float, lost: int
) -> None:
    """Refuse a singular configuration that does not determine the branch behind it.

    Args:
        jacobian: Phi along the branch.
        start: The time at which the step over the singular configuration starts.
        time: The time of the singular configuration.
        lost: By how many the rank of Phi is smaller at this configuration.
    """
    # The step ends as long after the singular configuration as it starts before it. In between, the
    # determinant changes its sign once for each lost rank. A further change is that of another
    # singular configuration.
    end = 2 * time - start
    change = jacobian.determinant_sign(start) * jacobian.determinant_sign(end)
    if change != (-1) ** lost:
        raise BranchError(f"{_UNDETERMINED}: another singular configuration is next to it")
    # The smallest singular value falls linearly, to zero, unless branches are tangent to each
    # other. `lost` is 0 if this value is not near zero at the root of u^T Phi w.
    halfway = jacobian.singular_values((start + time) / 2)[-1] / jacobian.values_at_start[-1]
    falls_linearly = _HALFWAY[0] < halfway < _HALFWAY[1]
    if lost == 0 or not falls_linearly:
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
    """Gauss' method, which has order 2 s with s stages, at the roots of a Legendre polynomial.

    It is a collocation method: A_ij is the integral from 0 to c_i of the Lagrange polynomial that
    is one at stage j and zero at the others (E. Hairer, S. P. Nørsett, G. Wanner, Solving Ordinary
    Differential Equations I, Sect. II.7).
    """
    roots, _ = np.polynomial.legendre.leggauss(stages)
    nodes = (1 + roots) / 2  # from (-1, 1) to (0, 1)
    c = np.append(nodes, 1)
    # Lagrange polynomial j is sum_k a_kj x^k. It is 1 at node j and 0 at the others, so the matrix
    # of a_kj is the inverse of the Vandermonde matrix of the nodes.
    k = np.arange(stages)
    vandermonde = nodes[:, None] ** k
    lagrange_coefficients = np.linalg.inv(vandermonde)
    # The integral of x^k from 0 to c_i is c_i^(k + 1) / (k + 1).
    integrals_of_powers = c[:, None] ** (k + 1) / (k + 1)
    return _ButcherTableau(c, integrals_of_powers.dot(lagrange_coefficients))


def gauss_step(
    space: StateSpace,
    rate: Callable[[float, Array], Array],
    start: float,
    state: Array,
    end: float,
    guess: Branch,
) -> tuple[Array, Array]:
    """A step of Gauss' implicit method with s = 8 stages, of order 16.

    The stages are found by fixed-point iteration from the states of `guess` at the same times.
    After each iteration the loops are closed.

    Args:
        space: The state space of the states.
        rate: Computes the rate of a state at a time.
        start: Time of the start, [s].
        state: The state at the start, shape (nq + n,).
        end: Time of the end, [s].
        guess: The expected motion.

    Returns:
        Times, shape (s + 2,), and states, shape (s + 2, nq + n), at the start, the stages and the
        end.
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
        # An iteration that does not halve the change has reached rounding. Only the ratio of two
        # changes counts, so their units do not matter.
        if not change < last_change / 2:
            break
    states[:, :nq] = space.closed(states)
    return np.append(start, times), np.vstack([state, states])


def mismatch(
    mechanism: Mechanism, branch: Branch, t: float, q: Array, v: Array, duration: float
) -> float:
    """How far q and v at a time are from a branch, relative to the motion during a step.

    `duration` is that of the step, [s]. An error of v counts as the error of q that it makes in
    this time.
    """
    scale = mechanism.rate_scale  # so that metres and radians can be compared
    q_error = pin.difference(mechanism.model, branch.q(t), q) / scale
    v_error = duration * (v - branch.v(t)) / scale
    travel = duration * float(np.abs(v / scale).max())
    error = max(float(np.abs(q_error).max()), float(np.abs(v_error).max()))
    return error / max(travel, 1e-300)
