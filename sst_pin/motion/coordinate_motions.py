# SPDX-License-Identifier: BSD-2-Clause
"""Motions of any closed chain given by its coordinates alone: the other joints follow."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from contextlib import suppress
from copy import copy

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, finite_array
from ..chain.backend import States
from ..chain.closed_chain import ClosedChain
from ..chain.named_positions import angles_and_lengths, put, taken
from ..chain.thresholds import CLOSURE_TOLERANCE, MAX_CONDITION_NUMBER
from ..errors import ClosureError, DescriptionError, DescriptionWarning, InputError, SSTError
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
        start: A guess of all joints at t[0], shape (nq,), which selects the assembly; by default
            `home` or, without it, all joints at zero.

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
    q = configurations_of(chain, values, start)
    curve = spline(times, values)
    return chain.trajectory(times, q, curve.derivative(1)(times), curve.derivative(2)(times))


def coordinate_positions(chain: ClosedChain, q: Array) -> Array:
    """Positions of the coordinates along a motion q, shape (N, nq), without jumps, shape (N, n).

    Raises:
        UnknownNameError: For a coordinate that neither turns about an axis nor slides.
    """
    space = chain.mechanism.space
    return without_full_turns(chain, taken(space, space.without_jumps(q), chain.coordinates))


def positions_along(chain: ClosedChain, motion: Trajectory) -> Array:
    """Positions of the coordinates along a motion, full turns as its rates tell, shape (N, n).

    Raises:
        UnknownNameError: For a coordinate that neither turns about an axis nor slides.
    """
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
    """Configurations for samples of the coordinates, shape (N, n), in one assembly mode.

    Args:
        chain: Any closed chain.
        x: The samples.
        start: As for `coordinate_motion`.

    Returns:
        Shape (N, nq).

    Raises:
        ClosureError: If the loops cannot be closed along the motion; it names the sample.
    """
    q = np.empty((len(x), len(chain.position_names)))
    q[0] = start_configuration(chain, dict(zip(chain.coordinates, x[0], strict=True)), start)
    states = chain._states(0.0)
    for i in range(1, len(x)):
        try:
            q[i] = followed(chain, states, q[i - 1], x[i] - x[i - 1])
        except ClosureError as error:
            error.name_samples([(i,)], len(x))
            raise
    return q


def start_configuration(
    chain: ClosedChain, positions: Mapping[str, float], guess: ArrayLike | None = None
) -> Array:
    """A configuration with closed loops where some joints stand as given.

    Args:
        chain: Any closed chain.
        positions: By the names of joints that turn or slide; the coordinates among them are held,
            the others choose the assembly.
        guess: The other joints, shape (nq,); by default the configuration that the description
            calls `home`, else one closed near zero, else a generic assembled one.

    Returns:
        Shape (nq,).

    Warns:
        DescriptionWarning: If neither the description nor the caller chooses the assembly mode.

    Raises:
        UnknownNameError: For a name that is no such joint's.
        ClosureError: When the loops cannot be closed there.
    """
    if guess is None:
        guesses = [start_of(chain)]
        with suppress(ClosureError):
            guesses.append(chain.generic_configuration())
        _warn_of_choice(chain, positions)
    else:
        guesses = [finite_array("start", guess, (chain.mechanism.model.nq,))]
    failure: ClosureError | None = None
    for each in guesses:
        try:
            return chain.assemble(put(chain.mechanism.space, each, positions))
        except ClosureError as error:
            failure = failure or error
    assert failure is not None
    raise failure


def start_of(chain: ClosedChain) -> Array:
    """The configuration where a chain stands first: home, else closed near zero, shape (nq,).

    Where the loops of this cannot be closed, they are open in the result.
    """
    model = chain.mechanism.model
    try:
        return chain.home
    except ClosureError:
        return np.array(model.referenceConfigurations["home"])
    except DescriptionError:
        neutral: Array = pin.neutral(model)
    try:
        return chain.assemble(neutral, fixed=())
    except ClosureError:
        return neutral


def _warn_of_choice(chain: ClosedChain, positions: Mapping[str, float]) -> None:
    """Say that the assembly was chosen here, unless the description or the caller has done so."""
    model = chain.mechanism.model
    free = set(angles_and_lengths(chain.mechanism.space)) - positions.keys()
    with suppress(DescriptionError):
        chain.home  # noqa: B018
        return
    if not free:
        return
    neutral = pin.neutral(model)
    if np.abs(chain.residual(neutral)).max(initial=0.0) < CLOSURE_TOLERANCE:
        return  # the description is drawn assembled
    warnings.warn(
        f"model {model.name}: no configuration is named home, so the loops were closed in an "
        "assembly mode chosen here; other modes need other torques. Check the start; to choose it, "
        "name a configuration home (an SRDF beside the URDF, a keyframe of an MJCF, or "
        'model.referenceConfigurations["home"]), or give positions of dependent joints too',
        DescriptionWarning,
        stacklevel=4,
    )


def followed(chain: ClosedChain, states: States, start: Array, step: Array) -> Array:
    """Where the coordinates, shape (n,), are a step further, in the same assembly mode."""
    if not step.any():
        return start

    def way(q: Array, low: float, high: float) -> Array | None:
        try:
            ahead = chain.joint_rates(q, (high - low) * step)
            return chain.assemble(pin.integrate(chain.mechanism.model, q, ahead))
        except SSTError:
            return None

    reached, found = states.follow(start, way, MAX_CONDITION_NUMBER)
    if reached < 1:
        raise ClosureError(
            "the loops cannot be closed further along the motion: out of reach, or singular", 0.0
        )
    return found
