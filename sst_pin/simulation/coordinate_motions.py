# SPDX-License-Identifier: BSD-2-Clause
"""Motions of any closed chain from its coordinates over time."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..engine import Engine, Robot, require_robot
from ..errors import ClosureError, DescriptionWarning, InputError, warn_caller
from ..loops.start import placed
from ..model.mechanism import Mechanism
from ..model.named_positions import positions_of
from ..progress import counted
from ..summaries import listed
from .samples import rows_of_samples, sample_times, spline
from .trajectories import Trajectory, trajectory_of


def coordinate_motion(
    chain: Robot, t: ArrayLike, x: ArrayLike, start: ArrayLike | None = None
) -> Trajectory:
    """The motion and the torques for given coordinates over time.

    The other joints are computed from sample to sample, in the same assembly mode. Rates are
    derivatives of splines of degree five, or N - 1 for N < 6, through the samples.

    Args:
        chain: Any closed chain with revolute or prismatic coordinates.
        t: Times, increasing, shape (N,), N >= 3, [s].
        x: Coordinates, shape (N, n), [rad] or [m].
        start: A configuration, shape (nq,), which selects the assembly mode. If its loops are
            closed, the coordinates are moved from there to the first sample; otherwise it is a
            guess of all joints at t[0]. By default `home`, else a configuration near zero. A robot
            with brakes needs it: it has the positions at which they hold.

    Warns:
        DescriptionWarning: If nothing selects the assembly mode at t[0], or an angle jumps by
            about a full turn.

    Raises:
        InputError: For a wrong shape, a coordinate that is neither an angle nor a length, or a
            robot with brakes and no `start`.
        ClosureError: If the loops cannot be closed along the motion; it names the sample.

    Example:
        >>> t = np.linspace(0, 1, 21)
        >>> crank = chain.home[0] + 0.2 * np.sin(t)
        >>> motion = sst_pin.coordinate_motion(chain, t, crank[:, None], chain.home)
        >>> motion.q.shape, motion.tau.shape
        ((21, 3), (21, 1))
    """
    require_robot("chain", chain)
    return coordinate_trajectory(chain.engine, t, x, start)


def coordinate_trajectory(
    engine: Engine, t: ArrayLike, x: ArrayLike, start: ArrayLike | None
) -> Trajectory:
    """`coordinate_motion` by an engine."""
    times = sample_times(t, 3)
    shape = len(times), len(engine.mechanism.coordinates)
    values = without_full_turns(engine.mechanism, rows_of_samples("x", x, shape))
    _warn_of_full_turns(engine.mechanism, values)
    return motion_along(engine, times, configurations_of(engine, values, start), values)


def motion_along(engine: Engine, t: Array, q: Array, x: Array) -> Trajectory:
    """The motion through configurations, shape (N, nq), with coordinates x, shape (N, n)."""
    curve = spline(t, x)
    va = curve.derivative(1)(t)
    aa = curve.derivative(2)(t)
    tau = engine.torques(q, va, aa)
    return trajectory_of(engine.mechanism, t, q, va, aa, tau)


def _warn_of_full_turns(mechanism: Mechanism, x: Array) -> None:
    """Warn of angles, shape (N, n), that mostly change little but jump by about a full turn."""
    steps = np.abs(np.diff(x, axis=0))
    some_step_is_long = (steps > 1.5 * np.pi).any(axis=0)
    most_steps_are_short = np.median(steps, axis=0) < np.pi / 2
    jumps = some_step_is_long & most_steps_are_short
    units = mechanism.coordinate_rate_units
    columns = zip(mechanism.coordinate_names, units, jumps, strict=True)
    names = [name for name, unit, jump in columns if unit == "rad" and jump]
    if names:
        warn_caller(
            f"x: {listed(names)} jump by a full turn or more between samples, which takes large "
            "rates and torques; if they were measured modulo one turn, use numpy.unwrap",
            DescriptionWarning,
        )


def coordinate_positions(mechanism: Mechanism, q: Array) -> Array:
    """Positions of the coordinates, shape (N, n), without jumps, for a motion q, shape (N, nq)."""
    x = positions_of(mechanism.space, mechanism.space.without_jumps(q), mechanism.coordinate_names)
    return without_full_turns(mechanism, x)


def positions_along(mechanism: Mechanism, motion: Trajectory) -> Array:
    """Positions of the coordinates along a motion, (N, n), unwrapped to agree with its rates."""
    x = positions_of(mechanism.space, motion.q, mechanism.coordinate_names)
    # Between two samples, the integral of the rates (trapezoidal rule) and the difference of the
    # angles differ by full turns.
    integrals = np.diff(motion.t)[:, None] * (motion.va[1:] + motion.va[:-1]) / 2
    turns = np.round((integrals - np.diff(x, axis=0)) / (2 * np.pi))
    is_length = [unit != "rad" for unit in mechanism.coordinate_rate_units]
    turns[:, is_length] = 0
    x[1:] += 2 * np.pi * np.cumsum(turns, axis=0)
    return x


def without_full_turns(mechanism: Mechanism, x: Array) -> Array:
    """Positions x of the coordinates, (N, n), with the angles of unbounded joints unwrapped."""
    # The entries of an unbounded joint in q, a cosine and a sine, do not have its name.
    entries = mechanism.space.position_names
    unbounded = [name not in entries for name in mechanism.coordinate_names]
    return np.where(unbounded, np.unwrap(x, axis=0), x)


def require_start_with_brakes(mechanism: Mechanism, start: ArrayLike | None) -> None:
    """Refuse a robot with brakes without a start.

    The coordinates do not say at which positions the brakes hold, and these need not be at home.
    """
    brakes = [brake.name for brake in mechanism.brakes]
    if brakes and start is None:
        problem = f"needed, because only a configuration says where brakes hold {listed(brakes)}"
        raise InputError("start", f"{problem}; give start=, such as chain.home")


def configurations_of(engine: Engine, x: Array, start: ArrayLike | None = None) -> Array:
    """Configurations, shape (N, nq), for samples of the coordinates, shape (N, n), in one mode.

    `start` and errors are those of `coordinate_motion`.
    """
    require_start_with_brakes(engine.mechanism, start)
    q = np.empty((len(x), engine.mechanism.model.nq))
    first = dict(zip(engine.mechanism.coordinate_names, x[0], strict=True))
    q[0] = placed(engine, first, start)
    for i in counted(range(1, len(x)), "coordinates of a motion", len(x)):
        try:
            q[i] = engine.moved(q[i - 1], x[i] - x[i - 1])
        except ClosureError as error:
            error.name_samples([(i,)], len(x))
            raise
    return q
