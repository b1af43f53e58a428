# SPDX-License-Identifier: BSD-2-Clause
"""More motors than freedoms: torques that make no motion, and limits respected by their help.

With the actuator Jacobian J the torques J^T tau = f bring about a motion, and tau may change along
null(J^T), the directions of preload.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, as_array, finite_array, for_each_sample, of_samples
from ..errors import ActuationError, InputError, SingularConfigurationError
from ..model.mechanism import Mechanism
from ..model.thresholds import BALANCED, RANK_TOLERANCE, UNSUPPLIED
from .least_torques import finest, smallest_torques

if TYPE_CHECKING:
    from .reference import Reference

#: Torques may pass limits by this part of the largest: rounding of a projection onto them.
_ROUNDING = 1e-12
#: Residual of a feasible least-distance problem is 1 or less, of one without a solution 0.
_FEASIBLE = 1e-12


def directions(mechanism: Mechanism, J: Array, reference: Array | None, on_error: str) -> Array:
    """Orthonormal directions of preload, continuous along the last batch axis, (..., motors, k).

    J are actuator Jacobians, shape (..., motors, n). Each sample's basis is the one next to that of
    the sample before it, the first one's is next to that of a regular reference, shape (motors, n);
    without one the first sample is it.
    """
    units = mechanism.rate_scale[mechanism.coordinates]
    batch, core = J.shape[:-2], J.shape[-2:]
    flat = (J * units).reshape(prod(batch), *core)
    finite = np.isfinite(flat).all(axis=(1, 2))
    starts = flat[finite] if reference is None else [reference * units]
    first, rank = _null_space(starts[0] if len(starts) else np.zeros(core))
    found = np.full((len(flat), *first.shape), np.nan)
    fewer = np.zeros(len(flat), dtype=bool)
    for i in np.flatnonzero(finite):
        basis, own = _null_space(flat[i])
        fewer[i] = own != rank
        if fewer[i]:
            continue
        along = i % batch[-1] if batch else 0
        before = found[i - 1] if along and np.isfinite(found[i - 1]).all() else first
        U, _, Vt = np.linalg.svd(basis.T @ before)
        found[i] = basis @ (U @ Vt)
    if fewer.any() and on_error == "raise":
        problem = f"the motors hold less than {rank} freedoms here: directions of preload change"
        raise of_samples(SingularConfigurationError(problem, np.inf), fewer.reshape(batch))
    return found.reshape(*batch, *first.shape)


def _null_space(J: Array) -> tuple[Array, int]:
    """Torques that make no motion, shape (motors, k), and the rank of J."""
    U, s, _ = np.linalg.svd(J)
    rank = int(np.count_nonzero(s > RANK_TOLERANCE * s.max(initial=0.0)))
    return U[:, rank:], rank


def adjusted(
    reference: Reference,
    motions: Sequence[Array | None],
    found: Sequence[Array],
    preload: ArrayLike | None,
    limits: ArrayLike | None,
    weights: ArrayLike | None,
    how: Mapping[str, Any],
) -> Array:
    """The smallest torques, shape (..., motors), with a preload along a basis, within limits.

    `motions` are q, va, aa and wrenches, `found` their smallest torques, f, actuator Jacobians and
    directions of preload. `how` has on_error and out.
    """
    motors, k = found[-1].shape[-2:]
    amounts = as_array("preload", np.zeros(k) if preload is None else preload, (k,))
    if how["on_error"] == "raise":
        amounts = finite_array("preload", amounts, (k,))
    allowed = None if limits is None else limits_of(limits, motors)
    given = None if weights is None else np.asarray(weights, dtype=float)

    def one(
        q: Array,
        va: Array,
        aa: Array,
        load: Array | None,
        least: Array,
        f: Array,
        J: Array,
        basis: Array,
        along: Array,
    ) -> Array:
        tau = least if preload is None else least + basis.dot(along)
        if not np.isfinite(tau).all():
            return np.full(motors, np.nan)  # of a sample at fault
        if allowed is not None:
            tau = _within(reference.mechanism, tau, basis, allowed, given)
        off = np.abs(f - J.T.dot(tau)) + BALANCED * np.abs(J.T).dot(np.abs(tau))
        if tau is not least and not (off <= UNSUPPLIED * np.abs(f) + reference.negligible).all():
            # Kernels round in other places than the reference path, which judges.
            A = reference.actuator_jacobian(q).T
            tau = _balanced(A, reference.generalized_forces(q, va, aa, load), tau, allowed)
            reference.require_supplied(q, va, aa, load, tau)
        return tau

    arrays = [*motions, *found, amounts]
    return for_each_sample(one, arrays, [1, 1, 1, 2, 1, 1, 2, 2, 1], (motors,), **how)


def _balanced(A: Array, f: Array, tau: Array, limits: Array | None) -> Array:
    """Torques with the rounding of A tau = f put right, by small ones most, within limits."""
    free = np.full(len(tau), True)
    if limits is not None:
        free = (limits[:, 0] < tau) & (tau < limits[:, 1])
    smallest, _ = smallest_torques(A * free, np.ones(len(A)), np.ones(len(tau)), finest(tau))
    tau = tau + smallest(f - A.dot(tau))
    return tau if limits is None else np.clip(tau, *limits.T)


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
    over = np.maximum(limits[:, 0] - tau, tau - limits[:, 1]).max(initial=0)
    if over <= _ROUNDING * np.abs(tau).max(initial=0):
        return tau
    return _nearest(mechanism, tau, basis, limits, weights)


def _nearest(
    mechanism: Mechanism, tau: Array, basis: Array, limits: Array, weights: Array | None
) -> Array:
    """The nearest torques by least distance programming (Lawson and Hanson 1974, chapter 23)."""
    from scipy.optimize import nnls

    if weights is not None:  # a basis that is orthonormal with these weights
        basis = basis @ np.linalg.inv(np.linalg.qr(np.sqrt(weights)[:, None] * basis, mode="r"))
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
