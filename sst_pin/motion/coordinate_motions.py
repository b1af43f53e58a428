# SPDX-License-Identifier: BSD-2-Clause
"""Motions of any closed chain given by its coordinates alone: the other joints follow."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ..arrays import finite_array
from ..chain.closed_chain import ClosedChain
from ..errors import ClosureError, DescriptionError, InputError, UnknownNameError
from .samples import sample_times, spline
from .trajectories import Trajectory

Array = NDArray[np.float64]

#: A step is halved until what Newton's method adds to the rates' guess is this small beside it.
_CORRECTION = 0.1
_HALVINGS = 12


def coordinate_motion(
    chain: ClosedChain, t: ArrayLike, x: ArrayLike, start: ArrayLike | None = None
) -> Trajectory:
    """The motion and the torques for given coordinates over time.

    The other joints are computed from sample to sample, in steps short enough to stay in the same
    assembly. Rates are derivatives of splines of degree five through the samples.

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
    times = sample_times(t, 3)
    values = finite_array("x", x, (len(chain.coordinates),))
    if values.shape != (len(times), len(chain.coordinates)):
        raise InputError(
            "x", f"shape {values.shape}, expected {(len(times), len(chain.coordinates))}"
        )
    q = np.empty((len(times), len(chain.position_names)))
    first = dict(zip(chain.coordinates, values[0], strict=True))
    q[0] = start_configuration(chain, first, start)
    for i in range(1, len(times)):
        try:
            q[i] = _follow(chain, q[i - 1], values[i] - values[i - 1], _HALVINGS)
        except ClosureError as error:
            error.name_samples([(i,)], len(times))
            raise
    curve = spline(times, values)
    return chain.trajectory(times, q, curve.derivative(1)(times), curve.derivative(2)(times))


def start_configuration(
    chain: ClosedChain, positions: Mapping[str, float], guess: ArrayLike | None = None
) -> Array:
    """A configuration with closed loops where some joints stand as given.

    Args:
        chain: Any closed chain.
        positions: By the names of joints that turn or slide; the coordinates among them are held,
            the others choose the assembly.
        guess: The other joints, shape (nq,); by default the configuration that the description
            calls `home`, else all joints at zero, else a generic assembled one.

    Returns:
        Shape (nq,).

    Raises:
        UnknownNameError: For a name that is no such joint's.
        ClosureError: When the loops cannot be closed there.
    """
    model = chain.model
    if guess is None:
        guesses = []
        with suppress(DescriptionError, ClosureError):
            guesses.append(chain.home)
        guesses = guesses or [pin.neutral(model)]
        with suppress(ClosureError):
            guesses.append(chain.generic_configuration())
    else:
        guesses = [finite_array("start", guess, (model.nq,))]
    failure: ClosureError | None = None
    for each in guesses:
        try:
            return chain.assemble(_put(chain, each, positions))
        except ClosureError as error:
            failure = failure or error
    assert failure is not None
    raise failure


def angles_and_lengths(chain: ClosedChain) -> dict[str, str]:
    """Names of joints with one coordinate, and "rad" or "m" for each."""
    units = dict(zip(chain.position_names, chain.joint_units, strict=True))
    endless = {name[:-4]: "rad" for name, unit in units.items() if _is_cosine(name, unit, units)}
    return {name: unit for name, unit in units.items() if unit} | endless


def _is_cosine(name: str, unit: str, units: Mapping[str, str]) -> bool:
    return not unit and name.endswith("_cos") and f"{name[:-4]}_sin" in units


def _put(chain: ClosedChain, q: Array, positions: Mapping[str, float]) -> Array:
    known, names = angles_and_lengths(chain), list(chain.position_names)
    q = np.array(q)
    for name, value in positions.items():
        if name not in known:
            raise UnknownNameError("revolute or prismatic joint", name, known)
        if name in names:
            q[names.index(name)] = value
        else:
            q[names.index(f"{name}_cos")] = np.cos(value)
            q[names.index(f"{name}_sin")] = np.sin(value)
    return q


def _follow(chain: ClosedChain, q: Array, step: Array, halvings: int) -> Array:
    """Where the coordinates are a step further, on the same assembly."""
    if not step.any():
        return q
    way = chain.joint_rates(q, step)
    guess = pin.integrate(chain.model, q, way)
    try:
        found = chain.assemble(guess)
        correction = np.abs(pin.difference(chain.model, guess, found)).max()
        near = correction <= _CORRECTION * np.abs(way).max()
    except ClosureError:
        if not halvings:
            raise
        near = False
    if near:
        return found
    if not halvings:
        raise ClosureError(
            "the loops cannot be closed further along the motion: out of reach, or singular", 0.0
        )
    middle = _follow(chain, q, step / 2, halvings - 1)
    return _follow(chain, middle, step / 2, halvings - 1)
