# SPDX-License-Identifier: BSD-2-Clause
"""The fastest motion along a path within limits of the motors.

The path is a curve x(s) of the coordinates, 0 <= s <= 1; w and u are the first and second time
derivatives of s. `path_forces` has the parts of the limits that the motion uses by w and u. H. Pham
and Q.-C. Pham, A new approach to time-optimal path parameterization based on reachability analysis,
IEEE Trans. Robotics 34(3), 2018, solve for w^2. Viscous friction d(s) w is linearized about the
previous solution.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, positive_number
from ..closed_chain import ClosedChain
from ..engine import require_robot
from ..errors import ActuationError, MissingExtraError
from ..simulation.trajectories import Trajectory
from .path_forces import MARGIN, MotorLimits, Parts, PathForces
from .smooth_path import SmoothPath

#: Number of intervals at whose ends the dynamics is computed first.
_INTERVALS = 500
#: How often all intervals may be halved while the motion exceeds limits between their ends.
_HALVINGS = 4
#: Most passes of an iteration: on finer grids, and for viscous friction.
_PASSES = 20
#: Most pieces into which a pass divides an interval.
_PIECES = 20
#: Places in each interval where limits are tested.
_TESTED = np.linspace(0, 1, 6)
#: An interval is busy where more than this part of a limit is used: limits act on the motion there.
_BUSY = 0.99
#: Change of the used part within a busy interval that the second grid aims at. It is less than
#: 1 - `_BUSY`, so limits are resolved where they act.
_CHANGE = 8e-4
#: The iteration for viscous friction ends when w^2 changes by less than this fraction. The grid is
#: refined afterwards, so an exact solution on one grid is not needed.
_CONVERGED = 1e-3
#: Part of a limit that viscous friction may use at least in the first guess, so w is not zero.
_CREEP = 1e-3
#: Largest w^2 that toppra is given, in the unit of time in which w is about one.
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
        nodes = np.linspace(0, 1, _INTERVALS * 2**halvings + 1)
        forces = PathForces(limits, curve, nodes)
        profile = _fastest(forces)
        duration = profile.times[-1]
        t = np.linspace(0, duration, int(np.ceil(duration / step)) + 1)
        q, va, aa = profile.states(curve, profile.places(t))
        # The splines of the forces are worst in the middle between their nodes.
        middles = (nodes[1:] + nodes[:-1]) / 2
        between = limits.used(*profile.states(curve, middles))
        if limits.used(q, va, aa).max() <= 1 and between.max() <= 1:
            return chain.trajectory(t, q, va, aa, limits.torques_of(q, va, aa))
    raise ActuationError(
        f"the forces along the path jump, and pass limits by {between.max() - 1:.1%} at "
        f"{middles[between.argmax()]:.1%} of it: its samples lie on no smooth curve"
    )


class _Profile(NamedTuple):
    """How fast the path is followed: u is constant between the points of a grid.

    So w^2 is linear in s between them, with the slope 2 u.
    """

    #: Points of the grid, shape (N + 1,).
    s: Array
    #: w^2 there, shape (N + 1,).
    x: Array

    @property
    def u(self) -> Array:
        """Second derivatives of s by time, shape (N,)."""
        return np.diff(self.x) / np.diff(self.s) / 2

    @property
    def times(self) -> Array:
        """When the points of the grid are passed, shape (N + 1,)."""
        w = np.sqrt(self.x)
        return np.append(0, np.cumsum(2 * np.diff(self.s) / (w[1:] + w[:-1])))

    def places(self, t: Array) -> Array:
        """The points s of the path at times t."""
        times = self.times
        i = np.clip(np.searchsorted(times, t, "right") - 1, 0, len(times) - 2)
        late = t - times[i]
        s = self.s[i] + np.sqrt(self.x[i]) * late + self.u[i] * late**2 / 2
        return np.clip(s, self.s[i], self.s[i + 1])

    def states(self, path: SmoothPath, s: Array) -> tuple[Array, Array, Array]:
        """q, va, aa at points of the path."""
        i = np.clip(np.searchsorted(self.s, s, "right") - 1, 0, len(self.s) - 2)
        x = np.interp(s, self.s, self.x)[:, None]
        u = self.u[i, None]
        q, first, second = path.at(s)
        return q, np.sqrt(x) * first, x * second + u * first

    def used(self, forces: PathForces) -> Array:
        """The largest part of a limit that is used, shape (tested points, N intervals)."""
        s = self.s[:-1] + np.diff(self.s) * _TESTED[:, None]
        x = np.interp(s, self.s, self.x).ravel()
        a, b, c, d, dry, most = forces.at(s.ravel())
        u = np.tile(self.u, len(_TESTED))[:, None]
        w = np.sqrt(x)[:, None]
        friction = d * w + np.where(w > 0, dry, 0)
        parts = a * u + b * w**2 + c + friction
        return np.maximum(parts.max(axis=1), w[:, 0] / most).reshape(s.shape)


def _fastest(forces: PathForces) -> _Profile:
    """The fastest profile, on a grid that is refined until it keeps the limits."""
    s = np.linspace(0, 1, _INTERVALS + 1)
    guess = _start(s, forces) if forces.viscous else None
    for attempt in range(_PASSES):
        profile = _Profile(s, _solved(s, forces, guess))
        used = profile.used(forces)
        worst = used.max(axis=0)
        exceeds = worst > 1 - MARGIN / 4
        if attempt > 0 and not exceeds.any():
            break
        # The more an interval exceeds a limit, the finer it is divided.
        pieces = np.where(exceeds, 2 + (worst - 1) / MARGIN, 1)
        if attempt == 0:
            busy_pieces = np.where(worst > _BUSY, np.ptp(used, axis=0) / _CHANGE, 1)
            pieces = np.maximum(pieces, busy_pieces)
        finer = _divided(s, np.ceil(np.clip(pieces, 1, _PIECES)))
        if guess is not None:
            guess = np.interp(finer, s, profile.x)
        s = finer
    return profile


def _divided(s: Array, pieces: Array) -> Array:
    """A grid with each interval divided into so many equal pieces; `pieces` has shape (N,)."""
    ends = np.append(0, np.cumsum(pieces))
    return np.interp(np.arange(ends[-1] + 1), ends, s)


def _start(s: Array, forces: PathForces) -> Array:
    """First guess of w^2 for the linearization: not above what viscous friction allows."""
    parts = forces.at(s)
    x = _linear(s, forces.unit, parts)
    free = np.maximum(1 - parts.c - parts.dry, _CREEP)
    with np.errstate(divide="ignore"):
        return np.minimum(x, (free / np.abs(parts.d)).min(axis=1) ** 2)


def _solved(s: Array, forces: PathForces, guess: Array | None) -> Array:
    """The largest w^2 within the limits at points s, shape (N + 1,).

    Viscous friction needs a guess of w^2; it is None if there is no viscous friction.
    """
    parts = forces.at(s)
    if guess is None:
        return _linear(s, forces.unit, parts)
    x = guess
    for _ in range(_PASSES):
        # d w is linear in w^2 about the last solution: d w = d w_0 / 2 + d / (2 w_0) w^2.
        w = np.sqrt(x)[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = np.where(w > 0, parts.d / (2 * w), 0)
        linear = parts._replace(b=parts.b + slope, c=parts.c + parts.d * w / 2)
        previous = x
        x = _linear(s, forces.unit, linear)
        if (np.abs(x - previous) <= _CONVERGED * x).all():
            break
    return x


def _linear(s: Array, unit: float, parts: Parts) -> Array:
    """The largest w^2 within the limits without the part d, at rest at the ends, by toppra."""
    try:
        from toppra import SplineInterpolator
        from toppra.algorithm import TOPPRA
        from toppra.constraint import LinearConstraint
    except ImportError:
        raise MissingExtraError("toppra", "timing") from None
    # The tolerances of toppra are absolute, so time is scaled until w is about one.
    a = parts.a / unit**2
    b = parts.b / unit**2
    c = parts.c
    dry = parts.dry.copy()
    dry[[0, -1]] = 0.0  # at rest there is none
    # Limits hold at both ends of each interval, with the larger Coulomb friction of both. Between
    # them u is constant, so w^2 grows by 2 u ds, and b w^2 at the end depends on u too.
    dry = np.maximum(dry[:-1], dry[1:])
    a_at_end = a[1:] + 2 * np.diff(s)[:, None] * b[1:]
    a_rows = np.hstack([a[:-1], a_at_end])
    b_rows = np.hstack([b[:-1], b[1:]])
    c_rows = np.hstack([c[:-1] + dry, c[1:] + dry])
    # toppra expects rows at each point of the grid; the last point repeats the last interval.
    rows = [np.vstack([x, x[-1]]) for x in (a_rows, b_rows, c_rows)]
    k = a_rows.shape[1]
    squares = np.minimum(((1 - MARGIN) * parts.most * unit) ** 2, _FASTEST)
    bounds = np.column_stack([np.zeros_like(s), squares])
    constraint = (*rows, np.eye(k), np.full(k, 1 - MARGIN))

    class Rows(LinearConstraint):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__()
            self.identical = True

        def compute_constraint_params(self, path: object, grid: Array) -> Any:
            return (*constraint, None, bounds)

    line = SplineInterpolator([0.0, 1.0], [[0.0], [1.0]])
    solver = TOPPRA([Rows()], line, gridpoints=s, solver_wrapper="seidel")
    _, w, _, K = solver.compute_parameterization(0.0, 0.0, return_data=True)
    if w is None or not np.isfinite(w).all():
        lost = s[np.isnan(K).any(axis=1)]
        at = f" beyond {lost.max():.0%} of it" if lost.size else ""
        raise ActuationError(f"the limits allow no motion from rest to rest along the path{at}")
    return np.asarray((w / unit) ** 2)
