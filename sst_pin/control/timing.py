# SPDX-License-Identifier: BSD-2-Clause
"""The fastest motion along a path within limits of the motors.

The path is a curve x(s) of the coordinates, 0 <= s <= 1; w and u are the first and second time
derivatives of s. The motion keeps a limit of torques or accelerations if

    a(s) u + b(s) w^2 + c(s) + d(s) w + dry(s) <= 1.

The terms are parts of the limit, used for inertia (a), velocity (b), weights and springs (c),
viscous friction (d), and Coulomb friction (dry). `path_forces` computes these functions for all
limits. A limit of rates is an upper bound of w.

H. Pham and Q.-C. Pham, A new approach to time-optimal path parameterization based on reachability
analysis, IEEE Trans. Robotics 34(3), 2018, find the largest w^2(s) for d = 0; then the sum is
linear in u and w^2. Viscous friction d w is linearized about the previous solution.

There are two sets of values of s. The dynamics is computed at the nodes, with splines between them.
The acceleration u is constant between the points of the grid.

- `time_optimal` is the main function. It refines the nodes.
- `_fastest` finds the profile w^2(s) for the splines. It refines the grid.
- `_largest_w_squared` iterates over viscous friction on one grid.
- `_without_viscous_friction` asks toppra for the largest w^2 on the grid.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Flags, positive_number
from ..closed_chain import ClosedChain
from ..engine import require_robot
from ..errors import ActuationError, MissingExtraError
from ..simulation.trajectories import Trajectory
from .path_forces import Parts, PathForces
from .path_limits import MARGIN, MotorLimits
from .smooth_path import SmoothPath

#: Number of intervals between the first nodes, and of the first grid.
_INTERVALS = 500
#: How often the number of intervals between nodes may be doubled while the motion exceeds limits.
_HALVINGS = 4
#: Largest number of passes of an iteration: over finer grids, and over viscous friction.
_PASSES = 20
#: Largest number of pieces into which a pass divides an interval of the grid.
_PIECES = 20
#: Points in each interval where limits are tested, as parts of the interval.
_TESTED = np.linspace(0, 1, 6)
#: An interval of the grid is busy if more than this part of a limit is used in it: there the limits
#: determine the motion.
_BUSY = 0.99
#: A busy interval is divided into pieces in each of which the used part changes by this number. It
#: is much less than 1 - `_BUSY`, so that busy intervals are resolved.
_CHANGE = 8e-4
#: The iteration for viscous friction ends when w^2 changes by less than this fraction. The grid is
#: refined afterwards, so an exact solution on one grid is not needed.
_CONVERGED = 1e-3
#: The first guess lets viscous friction use at least this part of a limit, so that w is not zero.
_CREEP = 1e-3
#: Bound of w^2 for toppra where rates have no limits, in the unit of time in which w is about one.
_FASTEST = 1e8


def time_optimal(
    chain: ClosedChain,
    path: ArrayLike,
    *,
    torques: ArrayLike | None = None,
    rates: ArrayLike | None = None,
    accelerations: ArrayLike | None = None,
    dt: float = 1e-3,
) -> Trajectory:
    """The fastest motion along a path, from rest to rest, within limits of the motors.

    The path is a smooth curve through the configurations; their times do not matter. The torques
    include all forces of the model, also friction. The limits also hold between the points of the
    grid, which is refined until they do. Surplus motors may use any preload within the limits.
    Method: H. Pham and Q.-C. Pham, IEEE Trans. Robotics 34(3), 2018.

    Args:
        chain: A robot whose motors hold all coordinates, each of which turns or slides.
        path: Configurations with closed loops, shape (N, nq), N >= 3.
        torques: Largest torque of each motor, shape () or (motors,), or least and largest ones,
            shape (motors, 2), [N m] or [N]; None for no limit, as below.
        rates: Largest rates of the motors, in the same shapes, [rad/s] or [m/s].
        accelerations: Largest accelerations of the motors, [rad/s^2] or [m/s^2].
        dt: Longest step between samples of the motion, [s].

    Raises:
        InputError: For a path that does not move, turns back or jumps.
        ActuationError: If the motors cannot hold the robot at the ends of the path, cannot follow
            it within the limits, or if its samples do not lie on a smooth curve.
        MissingExtraError: Without toppra, `sst-pin[timing]`.

    Example:
        >>> path = robot.inverse_kinematics(sst_pin.paper_circle(np.linspace(0, 0.5, 201)).R)
        >>> motion = sst_pin.time_optimal(robot, path, torques=30.0)
        >>> print(f"{motion.t[-1]:.1f} s, {np.abs(motion.tau).max():.1f} N m")
        0.5 s, 30.0 N m
    """
    require_robot("chain", chain)
    limits = MotorLimits(chain, torques, rates, accelerations)
    curve = SmoothPath(chain, path)
    step = positive_number("dt", dt)
    for halvings in range(_HALVINGS + 1):
        # `forces` are splines through the dynamics at the nodes.
        nodes = np.linspace(0, 1, _INTERVALS * 2**halvings + 1)
        forces = PathForces(limits, curve, nodes)
        profile = _fastest(forces)
        duration = profile.times[-1]
        t = np.linspace(0, duration, int(np.ceil(duration / step)) + 1)
        q, va, aa = profile.states(curve, profile.places(t))
        # Test the limits with the dynamics, not the splines: at the samples of the result, and in
        # the middle between nodes, where splines are least accurate.
        middles = (nodes[1:] + nodes[:-1]) / 2
        used_at_middles = limits.used(*profile.states(curve, middles))
        if limits.used(q, va, aa).max() <= 1 and used_at_middles.max() <= 1:
            return chain.trajectory(t, q, va, aa, limits.torques_of(q, va, aa))
    raise ActuationError(
        f"the forces along the path jump, and pass limits by {used_at_middles.max() - 1:.1%} at "
        f"{middles[used_at_middles.argmax()]:.1%} of it: its samples lie on no smooth curve"
    )


class _Profile(NamedTuple):
    """How fast the path is followed: u is constant between the N + 1 points of a grid.

    So w^2 is linear in s between them: d(w^2)/ds = 2 w (dw/dt) / (ds/dt) = 2 u.
    """

    #: Points of the grid, shape (N + 1,).
    s: Array
    #: w^2 there, shape (N + 1,).
    w_squared: Array

    @property
    def u(self) -> Array:
        """Second derivatives of s by time, shape (N,)."""
        return np.diff(self.w_squared) / np.diff(self.s) / 2

    @property
    def times(self) -> Array:
        """Times at which the points of the grid are passed, shape (N + 1,)."""
        w = np.sqrt(self.w_squared)
        # With a constant u, the mean of w over the time of an interval is the mean of both ends.
        return np.append(0, np.cumsum(2 * np.diff(self.s) / (w[1:] + w[:-1])))

    def places(self, t: Array) -> Array:
        """The points s of the path at times t."""
        times = self.times
        # The interval i of each time.
        i = np.clip(np.searchsorted(times, t, "right") - 1, 0, len(times) - 2)
        since = t - times[i]
        # u is constant: s = s_i + w_i t + u t^2 / 2.
        s = self.s[i] + np.sqrt(self.w_squared[i]) * since + self.u[i] * since**2 / 2
        return np.clip(s, self.s[i], self.s[i + 1])

    def states(self, path: SmoothPath, s: Array) -> tuple[Array, Array, Array]:
        """q, va, aa at points of the path."""
        # The interval i of each point.
        i = np.clip(np.searchsorted(self.s, s, "right") - 1, 0, len(self.s) - 2)
        w_squared = np.interp(s, self.s, self.w_squared)[:, None]
        u = self.u[i, None]
        q, first, second = path.at(s)  # x' and x''
        return q, np.sqrt(w_squared) * first, w_squared * second + u * first

    def used(self, forces: PathForces) -> Array:
        """The largest part of a limit that is used, shape (tested points, N intervals)."""
        tested = self.s[:-1] + np.diff(self.s) * _TESTED[:, None]  # shape (tested points, N)
        # The points of all intervals in one row, and u and w there as columns beside the sums.
        s = tested.ravel()
        w_squared = np.interp(s, self.s, self.w_squared)[:, None]
        w = np.sqrt(w_squared)
        u = np.tile(self.u, len(_TESTED))[:, None]
        parts = forces.at(s)
        dry = np.where(w > 0, parts.dry, 0)  # no Coulomb friction is used at rest
        sums = parts.a * u + parts.b * w_squared + parts.c + parts.d * w + dry
        used = np.maximum(sums.max(axis=1), w[:, 0] / parts.largest_w)
        return used.reshape(tested.shape)


def _fastest(forces: PathForces) -> _Profile:
    """The fastest profile, on a grid that is refined until the profile keeps the limits.

    Limits are exceeded only between the points of the grid. After the first pass, intervals where
    limits act are also divided.
    """
    s = np.linspace(0, 1, _INTERVALS + 1)
    guess = _first_guess(s, forces) if forces.viscous else None
    for attempt in range(_PASSES):
        profile = _Profile(s, _largest_w_squared(s, forces, guess))
        used = profile.used(forces)
        # At the points of the grid, at most 1 - MARGIN is used; between them, more may be used. The
        # last quarter of the margin is left for the difference of the splines from the dynamics.
        exceeds = used.max(axis=0) > 1 - MARGIN / 4
        if attempt > 0 and not exceeds.any():
            break
        pieces = _pieces(used, exceeds)
        if attempt == 0:  # the second grid resolves where limits act
            pieces = np.maximum(pieces, _pieces_of_busy(used))
        finer = _divided(s, np.ceil(np.clip(pieces, 1, _PIECES)))
        if guess is not None:
            guess = np.interp(finer, s, profile.w_squared)
        s = finer
    return profile


def _pieces(used: Array, exceeds: Flags) -> Array:
    """Numbers of pieces into which intervals are divided, shape (N,).

    An interval that exceeds a limit gets two pieces, and one more for each `MARGIN` beyond the
    limit. The others stay whole.

    Args:
        used: The largest part of a limit that is used, shape (tested points, N).
        exceeds: Which intervals exceed a limit, shape (N,).
    """
    return np.where(exceeds, 2 + (used.max(axis=0) - 1) / MARGIN, 1)


def _pieces_of_busy(used: Array) -> Array:
    """Numbers of pieces in which the used part changes by `_CHANGE`; 1 if not busy, shape (N,)."""
    is_busy = used.max(axis=0) > _BUSY
    return np.where(is_busy, np.ptp(used, axis=0) / _CHANGE, 1)


def _divided(s: Array, pieces: Array) -> Array:
    """A grid in which each interval of s is divided into equal pieces.

    `pieces` has the number of pieces of each interval, shape (N,).
    """
    # Numbers of the points of s among the points of the new grid.
    numbers = np.append(0, np.cumsum(pieces))
    return np.interp(np.arange(numbers[-1] + 1), numbers, s)


def _first_guess(s: Array, forces: PathForces) -> Array:
    """First guess of w^2 for the linearization: not above what viscous friction allows.

    Without motion the parts c + dry are used, and d w can use the rest of each limit.
    """
    parts = forces.at(s)
    w_squared = _without_viscous_friction(s, forces.unit, parts)
    rest = np.maximum(1 - parts.c - parts.dry, _CREEP)
    with np.errstate(divide="ignore"):
        w_by_friction = (rest / np.abs(parts.d)).min(axis=1)
    return np.minimum(w_squared, w_by_friction**2)


def _largest_w_squared(s: Array, forces: PathForces, guess: Array | None) -> Array:
    """The largest w^2 within the limits at points s, shape (N + 1,).

    Viscous friction needs a guess of w^2; it is None if there is no viscous friction.
    """
    parts = forces.at(s)
    if guess is None:
        return _without_viscous_friction(s, forces.unit, parts)
    w_squared = guess
    for _ in range(_PASSES):
        # Taylor's series of d w in w^2 about the last solution w_0: d w_0 / 2 + d / (2 w_0) w^2.
        w_0 = np.sqrt(w_squared)[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = np.where(w_0 > 0, parts.d / (2 * w_0), 0)
        linearized = parts._replace(b=parts.b + slope, c=parts.c + parts.d * w_0 / 2)
        previous = w_squared
        w_squared = _without_viscous_friction(s, forces.unit, linearized)
        if (np.abs(w_squared - previous) <= _CONVERGED * w_squared).all():
            break
    return w_squared


class _IntervalLimits(NamedTuple):
    """The limits a u + b w^2 + c <= 1 - `MARGIN` in the N intervals of a grid.

    Here u is constant in an interval, and w is the rate at the start of the interval. The unit of
    time is one in which w is about one.

    Attributes:
        a, b, c: Shapes (N, limits).
        largest_w_squared: Limits of w^2 at the points of the grid, shape (N + 1,).
    """

    a: Array
    b: Array
    c: Array
    largest_w_squared: Array


def _interval_limits(s: Array, unit: float, parts: Parts) -> _IntervalLimits:
    """The limits at both ends of each interval, for parts without viscous friction.

    u is constant in an interval of the length ds, so that w^2 grows by 2 u ds. With the parts a, b
    and c at the end of the interval, and w at its start, the limits at the end are on

        a u + b (w^2 + 2 u ds) + c = (a + 2 ds b) u + b w^2 + c.

    This is the interpolation scheme of H. Pham and Q.-C. Pham. Coulomb friction is added to c. Both
    ends have the larger friction of the two.
    """
    a = parts.a / unit**2
    b = parts.b / unit**2
    c = parts.c
    dry = parts.dry.copy()
    dry[[0, -1]] = 0.0  # no Coulomb friction is used at rest
    dry = np.maximum(dry[:-1], dry[1:])  # of both ends
    a_at_end = a[1:] + 2 * np.diff(s)[:, None] * b[1:]
    return _IntervalLimits(
        a=np.hstack([a[:-1], a_at_end]),
        b=np.hstack([b[:-1], b[1:]]),
        c=np.hstack([c[:-1] + dry, c[1:] + dry]),
        largest_w_squared=np.minimum(((1 - MARGIN) * parts.largest_w * unit) ** 2, _FASTEST),
    )


def _without_viscous_friction(s: Array, unit: float, parts: Parts) -> Array:
    """The largest w^2 within the limits without the part d, at rest at the ends, by toppra.

    Time is scaled by `unit`, so that w is about one: the tolerances of toppra are absolute.
    """
    try:
        from toppra import SplineInterpolator
        from toppra.algorithm import TOPPRA
        from toppra.constraint import LinearConstraint
    except ImportError:
        raise MissingExtraError("toppra", "timing") from None
    limits = _interval_limits(s, unit, parts)

    class Limits(LinearConstraint):  # type: ignore[misc]
        """F (a u + b w^2 + c) <= g and bounds of w^2 at each point, in the form of toppra.

        toppra needs them at the N + 1 points of the grid. The last point starts no interval; it has
        the limits of the last interval.
        """

        def __init__(self) -> None:
            super().__init__()
            self.identical = True  # F and g are the same at all points

        def compute_constraint_params(self, path: object, grid: Array) -> Any:
            k = limits.a.shape[1]
            F = np.eye(k)
            g = np.full(k, 1 - MARGIN)
            bounds_of_u = None
            bounds_of_w_squared = np.column_stack([np.zeros_like(s), limits.largest_w_squared])
            a = np.vstack([limits.a, limits.a[-1]])
            b = np.vstack([limits.b, limits.b[-1]])
            c = np.vstack([limits.c, limits.c[-1]])
            return a, b, c, F, g, bounds_of_u, bounds_of_w_squared

    # toppra requires a path object, but all that matters of the path is in the limits.
    line = SplineInterpolator([0.0, 1.0], [[0.0], [1.0]])
    solver = TOPPRA([Limits()], line, gridpoints=s, solver_wrapper="seidel")
    _, w, _, K = solver.compute_parameterization(0.0, 0.0, return_data=True)
    if w is None or not np.isfinite(w).all():
        # K has the controllable w^2 at each point, NaN where there is none.
        lost = s[np.isnan(K).any(axis=1)]
        at = f" beyond {lost.max():.0%} of it" if lost.size else ""
        raise ActuationError(f"the limits allow no motion from rest to rest along the path{at}")
    return np.asarray((w / unit) ** 2)
