# SPDX-License-Identifier: BSD-2-Clause
"""Motions of any closed chain given by its coordinates alone: the other joints follow."""

from __future__ import annotations

import warnings
from copy import copy

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, finite_array
from ..closed_chain import ClosedChain
from ..errors import ClosureError, DescriptionWarning, InputError
from ..loops.starts import placed
from ..model.named_positions import taken
from ..summaries import listed
from .samples import sample_times, spline
from .trajectories import Trajectory


def coordinate_motion(
    chain: ClosedChain, t: ArrayLike, x: ArrayLike, start: ArrayLike | None = None
) -> Trajectory:
    """The motion and the torques for given coordinates over time.

    The other joints are computed from sample to sample, in steps short enough to stay in the same
    assembly mode: never across a singular configuration. Rates are derivatives of splines of degree
    five through the samples.

    Args:
        chain: Any closed chain with revolute or prismatic coordinates.
        t: Times, increasing, shape (N,), N >= 3, [s].
        x: Coordinates, shape (N, n), [rad] or [m].
        start: A configuration, shape (nq,), which selects the assembly: from there, if its loops
            are closed, the coordinates are moved to the first sample; otherwise it is a guess of
            all joints at t[0]. By default `home`, else the robot as it is drawn.

    Warns:
        DescriptionWarning: If the assembly at t[0] was chosen here, or an angle jumps by about a
            full turn.

    Raises:
        InputError: For a wrong shape, or a coordinate that is neither an angle nor a length.
        ClosureError: If the loops cannot be closed along the motion; it names the sample.

    Example:
        >>> t = np.linspace(0, 1, 21)
        >>> crank = chain.home[0] + 0.2 * np.sin(t)
        >>> motion = sst_pin.coordinate_motion(chain, t, crank[:, None], chain.home)
        >>> motion.q.shape, motion.tau.shape
        ((21, 3), (21, 1))
    """
    chain, times = copy(chain), sample_times(t, 3)
    values = finite_array("x", x, (len(chain.coordinates),))
    if values.shape != (len(times), len(chain.coordinates)):
        raise InputError(
            "x", f"shape {values.shape}, expected {(len(times), len(chain.coordinates))}"
        )
    values = without_full_turns(chain, values)
    _warn_of_full_turns(chain, values)
    q = configurations_of(chain, values, start)
    curve = spline(times, values)
    return chain.trajectory(times, q, curve.derivative(1)(times), curve.derivative(2)(times))


def _warn_of_full_turns(chain: ClosedChain, x: Array) -> None:
    """Say which angles, shape (N, n), that change little else jump by about a full turn."""
    steps = np.abs(np.diff(x, axis=0))
    jumps = (steps > 1.5 * np.pi).any(axis=0) & (np.median(steps, axis=0) < np.pi / 2)
    names = zip(chain.coordinates, chain.mechanism.coordinate_rate_units, jumps, strict=True)
    if found := [name for name, unit, jump in names if unit == "rad" and jump]:
        warnings.warn(
            f"x: {listed(found)} jump by a full turn or more between samples, which takes large "
            "rates and torques; if they were measured modulo one turn, use numpy.unwrap",
            DescriptionWarning,
            stacklevel=3,
        )


def coordinate_positions(chain: ClosedChain, q: Array) -> Array:
    """Positions of the coordinates along a motion q, shape (N, nq), without jumps, shape (N, n)."""
    space = chain.mechanism.space
    return without_full_turns(chain, taken(space, space.without_jumps(q), chain.coordinates))


def positions_along(chain: ClosedChain, motion: Trajectory) -> Array:
    """Positions of the coordinates along a motion, full turns as its rates tell, shape (N, n)."""
    x = taken(chain.mechanism.space, motion.q, chain.coordinates)
    turning = np.array([unit == "rad" for unit in chain.mechanism.coordinate_rate_units])
    moved = np.diff(motion.t)[:, None] * (motion.va[1:] + motion.va[:-1]) / 2
    turns = np.round((moved - np.diff(x, axis=0)) / (2 * np.pi)) * turning
    x[1:] += 2 * np.pi * np.cumsum(turns, axis=0)
    return x


def without_full_turns(chain: ClosedChain, x: Array) -> Array:
    """Positions of the coordinates, shape (N, n); joints that turn without end do not jump."""
    endless = [name not in chain.mechanism.space.position_names for name in chain.coordinates]
    return np.where(endless, np.unwrap(x, axis=0), x)


def configurations_of(chain: ClosedChain, x: Array, start: ArrayLike | None = None) -> Array:
    """Configurations, shape (N, nq), for samples of the coordinates, shape (N, n), in one mode.

    `start` and errors are those of `coordinate_motion`.
    """
    q = np.empty((len(x), len(chain.position_names)))
    q[0] = placed(chain, dict(zip(chain.coordinates, x[0], strict=True)), start)
    for i in range(1, len(x)):
        try:
            q[i] = chain.engine.reference.moved(q[i - 1], x[i] - x[i - 1])
        except ClosureError as error:
            error.name_samples([(i,)], len(x))
            raise
    return q
