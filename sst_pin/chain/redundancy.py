# SPDX-License-Identifier: BSD-2-Clause
"""More motors than freedoms: torques that make no motion, and limits respected by their help.

With the actuator Jacobian J the torques J^T tau = f bring about a motion, and tau may change along
null(J^T), the directions of preload.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, as_array, finite_array, name_samples
from ..errors import ActuationError, InputError, SingularConfigurationError
from .mechanism import Mechanism
from .thresholds import RANK_TOLERANCE

#: Torques may pass limits by this part of the largest: rounding of a projection onto them.
_ROUNDING = 1e-12
#: Residual of a feasible least-distance problem is 1 or less, of one without a solution 0.
_FEASIBLE = 1e-12


def directions(mechanism: Mechanism, J: Array, reference: Array | None) -> Array:
    """Orthonormal directions of preload, continuous along the last batch axis, (..., motors, k).

    J are actuator Jacobians, shape (..., motors, n). Each sample's basis is the one next to that of
    the sample before it, the first one's is next to that of a regular reference, shape (motors, n);
    without one the first sample is it.
    """
    units = mechanism.rate_scale[mechanism.coordinates]
    batch = J.shape[:-2]
    flat = (J * units).reshape(math.prod(batch), *J.shape[-2:])
    finite = flat[np.isfinite(flat).all(axis=(1, 2))]
    starts = finite if reference is None else [reference * units]
    first, rank = _null_space(starts[0] if len(starts) else np.zeros(flat.shape[1:]))
    found = np.empty((len(flat), len(first), first.shape[1]))
    for i, matrix in enumerate(flat):
        if not np.isfinite(matrix).all():
            found[i] = np.nan  # of samples at fault
            continue
        basis, own = _null_space(matrix)
        if own != rank:
            error = SingularConfigurationError(
                f"the motors hold {own} of {rank} freedoms here: directions of preload change",
                np.inf,
            )
            name_samples(error, [i], batch)
            raise error
        along = i % batch[-1] if batch else 0
        before = found[i - 1] if along and np.isfinite(found[i - 1]).all() else first
        U, _, Vt = np.linalg.svd(basis.T @ before)
        found[i] = basis @ (U @ Vt)
    return found.reshape(*batch, *first.shape)


def _null_space(J: Array) -> tuple[Array, int]:
    """Torques that make no motion, shape (motors, k), and the rank of J."""
    U, s, _ = np.linalg.svd(J)
    rank = int(np.count_nonzero(s > RANK_TOLERANCE * s.max(initial=0.0)))
    return U[:, rank:], rank


def adjusted(
    mechanism: Mechanism,
    tau: Array,
    basis: Array,
    preload: ArrayLike | None,
    limits: ArrayLike | None,
    weights: ArrayLike | None,
) -> Array:
    """The smallest torques, shape (..., motors), with a preload along a basis, within limits."""
    if preload is not None:
        amounts = finite_array("preload", preload, (basis.shape[-1],))
        try:
            tau = tau + np.einsum("...mk,...k->...m", basis, amounts)
        except ValueError:
            problem = f"shape {amounts.shape} does not broadcast with {tau.shape[:-1]} samples"
            raise InputError("preload", problem) from None
    if limits is not None:
        given = None if weights is None else np.asarray(weights, dtype=float)
        tau = _within(mechanism, tau, basis, limits_of(limits, tau.shape[-1]), given)
    return tau


def limits_of(limits: ArrayLike, motors: int, name: str = "limits") -> Array:
    """Least and largest torques, shape (motors, 2); from largest ones too, shape (motors,).

    `name` is what errors call them.
    """
    given = as_array(name, limits, ())
    if given.shape == (motors,):
        given = np.column_stack([-given, given])
    if given.shape != (motors, 2):
        raise InputError(name, f"shape {given.shape}, expected ({motors},) or ({motors}, 2)")
    if not (given[:, 0] < given[:, 1]).all():
        raise InputError(name, "each least torque must be below the largest")
    return given


def limits_of_each(name: str, value: ArrayLike, motors: int) -> Array:
    """Finite `limits_of`; one number counts for all motors."""
    given = finite_array(name, value, ())
    return limits_of(given if given.ndim else np.full(motors, given), motors, name)


def _within(
    mechanism: Mechanism, tau: Array, basis: Array, limits: Array, weights: Array | None
) -> Array:
    """The torques next to given ones that make the same motion within limits."""
    batch, result = tau.shape[:-1], tau.reshape(-1, tau.shape[-1]).copy()
    core = basis.shape[-2:]
    bases = np.broadcast_to(basis, (*batch, *core)).reshape(len(result), *core)
    rounding = _ROUNDING * np.abs(tau).max(initial=0.0, where=np.isfinite(tau))
    over = np.maximum(limits[:, 0] - result, result - limits[:, 1]).max(axis=1) > rounding
    for i in np.flatnonzero(over):
        try:
            result[i] = _nearest(mechanism, result[i], bases[i], limits, weights)
        except ActuationError as error:
            name_samples(error, [int(i)], batch)
            raise
    return result.reshape(tau.shape)


def _nearest(
    mechanism: Mechanism, tau: Array, basis: Array, limits: Array, weights: Array | None
) -> Array:
    """The nearest torques by least distance programming (Lawson and Hanson 1974, chapter 23)."""
    from scipy.optimize import nnls

    if weights is not None:  # a basis that is orthonormal with these weights
        basis = basis @ np.linalg.inv(np.linalg.cholesky(basis.T @ (weights[:, None] * basis))).T
    over = np.maximum(limits[:, 0] - tau, tau - limits[:, 1]).max()
    unit = max(np.abs(tau).max(), over)
    G = np.vstack([basis, -basis])
    h = np.concatenate([limits[:, 0] - tau, tau - limits[:, 1]]) / unit
    finite = np.isfinite(h)
    E, k = np.vstack([G[finite].T, h[finite]]), basis.shape[1]
    goal = np.zeros(k + 1)
    goal[k] = 1.0
    u, distance = nnls(E, goal)
    if distance <= np.sqrt(_FEASIBLE):
        raise _beyond(mechanism, tau, basis, limits, unit)
    r = E @ u - goal
    return np.asarray(np.clip(tau - unit * (basis @ (r[:k] / r[k])), *limits.T))


def _beyond(
    mechanism: Mechanism, tau: Array, basis: Array, limits: Array, unit: float
) -> ActuationError:
    """The error for torques that pass the limits whatever the preload."""
    from scipy.optimize import linprog

    k, one = basis.shape[1], np.ones((len(tau), 1))
    rows = np.vstack([np.hstack([basis, -one]), np.hstack([-basis, -one])])
    bounds = np.concatenate([limits[:, 1] - tau, tau - limits[:, 0]])
    finite = np.isfinite(bounds)
    best = linprog(
        [*[0] * k, 1], rows[finite], bounds[finite] / unit, bounds=[(None, None)] * k + [(0, None)]
    )
    least = tau + unit * (basis @ best.x[:k])
    excess = np.maximum(limits[:, 0] - least, least - limits[:, 1])
    most = (1 - 1e-6) * excess.max()
    beyond = {mechanism.motor_names[i]: float(excess[i]) for i in np.flatnonzero(excess >= most)}
    listed = ", ".join(f"{name} by {x:.4g}" for name, x in beyond.items())
    return ActuationError(
        f"the motion needs more than the limits of the motors allow, at least {listed} (N m or N)",
        beyond,
    )
