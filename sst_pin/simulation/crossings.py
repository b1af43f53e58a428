# SPDX-License-Identifier: BSD-2-Clause
"""Smooth motions through a singular configuration of the mechanism.

Several branches of motions meet at this configuration. Polynomials extrapolate the motion before
it; they close the loops on one branch only. They are the initial guess of an implicit Runge-Kutta
step over the configuration. No stage of the step is at the configuration.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..model.mechanism import Mechanism
from ..states import States

#: The search for a singular configuration ends after this many times the expected time.
_AHEAD = 2.0
#: A singular value below this part of its first size counts as zero.
_VANISHED = 0.03
#: Halfway there, a singular value that falls linearly is between these parts of its first size.
_HALFWAY = (0.3, 0.7)
#: Stages of the step, an even number so that none is in the middle, and the most iterations.
_STAGES, _ITERATIONS = 8, 20


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

    The states are at `times`, (N,), in any order; v and v_dot are those of all joints, (N, nv).
    `unit` is about the length of the extrapolation, [s].
    """

    def __init__(
        self, mechanism: Mechanism, times: Array, q: Array, v: Array, v_dot: Array, unit: float
    ) -> None:
        from scipy.interpolate import KroghInterpolator

        space = mechanism.space
        q_dot = np.array([space.coordinate_rates(*each) for each in zip(q, v, strict=True)])
        x = np.repeat((times - times[0]) / unit, 2)
        self._start = times[0]
        self._unit = unit
        self._normalised = space.normalised
        self._q, self._v = (
            KroghInterpolator(x, np.stack([a, unit * b], axis=1).reshape(len(x), -1))
            for a, b in ((q, q_dot), (v, v_dot))
        )

    def q(self, t: float) -> Array:
        """The configuration."""
        return self._normalised(np.asarray(self._q((t - self._start) / self._unit)))

    def v(self, t: float) -> Array:
        """Rates of all joints."""
        return np.asarray(self._v((t - self._start) / self._unit))

    def v_dot(self, t: float) -> Array:
        """Accelerations of all joints."""
        return np.asarray(self._v.derivative((t - self._start) / self._unit)) / self._unit


def crossing_of(states: States, branch: Branch, start: float, remaining: float) -> Crossing | str:
    """The `Crossing` on a branch about `remaining` after `start`, or why there is none."""
    from scipy.optimize import brentq

    U, before, Vt = np.linalg.svd(states.Phi(branch.q(start)))
    rank = Vt.shape[0] - len(states.coordinates)
    # Leave out the singular vectors of values that are zero everywhere.
    rows = U[:, :rank].T
    rates = Vt[:rank].T
    at = start
    until = start + _AHEAD * remaining
    for _ in range(2):  # singular vectors vary a little along the branch
        left_vectors, _, right_vectors = np.linalg.svd(rows @ states.Phi(branch.q(at)) @ rates)
        u = left_vectors[:, -1] @ rows
        w = rates @ right_vectors[-1]

        def signed(t: float, u: Array = u, w: Array = w) -> float:
            return float(u @ states.Phi(branch.q(t)) @ w)

        if signed(start) * signed(until) > 0:
            return "the extrapolated motion does not cross it"
        at = float(brentq(signed, start, until, xtol=1e-15, rtol=1e-14))
    there = np.linalg.svd(states.Phi(branch.q(at)), compute_uv=False)[:rank]
    lost = int(np.count_nonzero(there < _VANISHED * before[:rank]))
    halfway = np.linalg.svd(states.Phi(branch.q((start + at) / 2)), compute_uv=False)[rank - 1]
    ends = [rows @ states.Phi(branch.q(t)) @ rates for t in (start, 2 * at - start)]
    if np.linalg.slogdet(np.array(ends)).sign.prod() != (-1) ** lost:
        return "another singular configuration is next to it"
    if not lost or not _HALFWAY[0] < halfway / before[rank - 1] < _HALFWAY[1]:
        return "branches are tangent to each other there"
    return Crossing(at, branch.q(at), rank, rank - lost)


def gauss_step(
    space: States,
    rate: Callable[[float, Array], Array],
    start: float,
    state: Array,
    end: float,
    guess: Branch,
) -> tuple[Array, Array]:
    """A step of Gauss' implicit method of order 16: times and states of start, stages and end."""
    x = (1 + np.polynomial.legendre.leggauss(_STAGES)[0]) / 2
    powers = np.arange(_STAGES)
    weights = np.append(x, 1)[:, None] ** (powers + 1) / (powers + 1)
    weights = weights.dot(np.linalg.inv(x[:, None] ** powers))  # integrals to the stages and to 1
    times = start + (end - start) * np.append(x, 1)
    coordinates = space.coordinates
    change = np.inf
    states = np.array([[*guess.q(t), *guess.v(t)[coordinates]] for t in times])
    nq = states.shape[1] - len(coordinates)
    for _ in range(_ITERATIONS):
        states[:, :nq] = space.closed(states)
        rates = np.array([rate(t, y) for t, y in zip(times[:-1], states, strict=False)])
        before = states
        states = state + (end - start) * weights.dot(rates)
        last = change
        change = float(np.abs(states - before).max())
        if not change < last / 2:  # the rest is rounding
            break
    states[:, :nq] = space.closed(states)
    return np.append(start, times), np.vstack([state, states])


def mismatch(
    mechanism: Mechanism, branch: Branch, t: float, motion: Sequence[Array], remaining: float
) -> float:
    """How far q and v at a time are from a branch, relative to the motion in `remaining`."""
    q, v, _ = motion
    scale = mechanism.rate_scale
    off = pin.difference(mechanism.model, branch.q(t), q), remaining * (v - branch.v(t))
    travel = remaining * float(np.abs(v / scale).max())
    return max(float(np.abs(x / scale).max()) for x in off) / max(travel, 1e-300)
