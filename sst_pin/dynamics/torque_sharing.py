# SPDX-License-Identifier: BSD-2-Clause
"""Torques of redundant motors: the smallest for a motion, preload, and limits.

Motor torques tau give the forces A tau along the coordinates. A = L^T B = J^T, shape (n, motors),
with v = L va, the actuation matrix B and the actuator Jacobian J. Torques in the null space of A
make no motion: they are a preload.

`least_torques` solves A tau = f, `preload_directions` is the null space of A along a batch, and
`shared_torques` adds a preload and keeps torques within limits, by `within_limits`.
"""

from __future__ import annotations

from math import prod

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, as_array, finite_array, for_each_sample, of_samples, single_array
from ..errors import ActuationError, InputError, SingularConfigurationError
from ..loops.ranks import rank_of
from ..model.mechanism import Mechanism

#: Torques that exceed limits by this part of the largest torque are within them: torques that have
#: been clipped to limits before exceed them by rounding.
_ROUNDING = 1e-12
#: A least-distance problem has no solution if its residual, free of units, is below this: the
#: residual is then rounding of numbers that are about one.
_NO_DISTANCE = 1e-6
#: Motors whose excess differs from the largest by less than this fraction are named together: in
#: legs that are alike, rounding decides which one is the largest.
_TIE = 1e-6


def least_torques(mechanism: Mechanism, A: Array, f: Array, weights: Array | None = None) -> Array:
    """The torques with A tau = f and the least sum of weights tau^2, shape (motors,).

    The part of f that no motor can produce is ignored.
    """
    G = inverse_for_torques(mechanism, A, weights)
    tau = G.dot(f)
    return tau + G.dot(f - A.dot(tau))  # removes the rounding of the first solution


def inverse_for_torques(mechanism: Mechanism, A: Array, weights: Array | None = None) -> Array:
    """G, shape (motors, n): tau = G f are the torques of `least_torques`, to rounding.

    Without weights and with A of full row rank, G is the pseudo-inverse of A.
    """
    units = mechanism.rate_scale[mechanism.coordinates]
    root_weights = np.ones(A.shape[1])
    if weights is not None:
        root_weights = np.sqrt(weights)
    # The sum of weights tau^2 is |x|^2 with x = root_weights tau. So x is the shortest solution of
    # (units A / root_weights) x = units f. The factors `units` make its rows free of units.
    U, s, Vt = np.linalg.svd(units[:, None] * A / root_weights, full_matrices=False)
    # The rank must not depend on the weights: it is that of A free of units.
    if (root_weights != mechanism.motor_scale).any():
        singular_values = np.linalg.svd(_without_units(mechanism, A), compute_uv=False)
    else:
        singular_values = s  # root_weights is motor_scale, so it is the same matrix
    rank = rank_of(np.asarray(singular_values, dtype=float))
    inverse = (Vt[:rank].T / s[:rank]).dot(U[:, :rank].T)
    return np.asarray(inverse * units / root_weights[:, None])


def null_space(mechanism: Mechanism, A: Array) -> Array:
    """Orthonormal torques that make no motion, shape (motors, k)."""
    _, s, Vt = np.linalg.svd(_without_units(mechanism, A))
    return np.linalg.qr(Vt[rank_of(s) :].T / mechanism.motor_scale[:, None])[0]


def _without_units(mechanism: Mechanism, A: Array) -> Array:
    """A free of units: rates and motors are divided by their scales."""
    units = mechanism.rate_scale[mechanism.coordinates]
    return np.asarray(units[:, None] * A / mechanism.motor_scale)


def preload_directions(
    mechanism: Mechanism, J: Array, reference: Array | None, on_error: str
) -> Array:
    """Orthonormal directions of preload, continuous along the last batch axis, (..., motors, k).

    Each sample has its null space of A; its basis in this space is the one nearest to the basis of
    the sample before it.

    Args:
        mechanism: The mechanism.
        J: Actuator Jacobians, shape (..., motors, n).
        reference: An actuator Jacobian, shape (motors, n). The first sample gets the basis that is
            nearest to the basis of this one. If None, it is that of the first finite sample.
        on_error: "raise" to refuse samples with another number of directions, "nan" for NaN there.

    Raises:
        SingularConfigurationError: If a sample has another number of directions.
    """
    batch = J.shape[:-2]
    core = J.shape[-2:]
    flat = J.reshape(prod(batch), *core)
    finite = np.isfinite(flat).all(axis=(1, 2))
    if reference is not None:
        first_jacobian = reference
    elif finite.any():
        first_jacobian = flat[finite][0]
    else:
        first_jacobian = np.zeros(core)
    first_basis = null_space(mechanism, first_jacobian.T)
    result = np.full((len(flat), *first_basis.shape), np.nan)
    of_other_size = np.zeros(len(flat), dtype=bool)
    for i in np.flatnonzero(finite):
        basis = null_space(mechanism, flat[i].T)
        if basis.shape != first_basis.shape:
            of_other_size[i] = True
            continue
        # The basis of the sample before it on the last batch axis, if there is one.
        neighbour = first_basis
        if batch and i % batch[-1] > 0 and np.isfinite(result[i - 1]).all():
            neighbour = result[i - 1]
        # The nearest basis of the same space (the orthogonal Procrustes problem).
        U, _, Vt = np.linalg.svd(basis.T @ neighbour)
        result[i] = basis @ (U @ Vt)
    if of_other_size.any() and on_error == "raise":
        rank = core[0] - first_basis.shape[1]
        problem = (
            f"the motors do not hold {rank} freedoms here, so the directions of preload change"
        )
        error = SingularConfigurationError(problem, np.inf)
        raise of_samples(error, of_other_size.reshape(batch))
    return result.reshape(*batch, *first_basis.shape)


def shared_torques(
    mechanism: Mechanism,
    least: Array,
    directions: Array,
    preload: ArrayLike | None,
    limits: ArrayLike | None,
    weights: ArrayLike | None,
    *,
    on_error: str,
    out: Array | None,
) -> Array:
    """The smallest torques plus a preload along directions, within limits, shape (..., motors)."""
    motors, k = directions.shape[-2:]
    # With on_error="nan", samples whose amounts are not finite get torques of NaN.
    amounts = as_array("preload", np.zeros(k) if preload is None else preload, (k,))
    if on_error == "raise":
        amounts = finite_array("preload", amounts, (k,))
    bounds = None
    if limits is not None:
        bounds = limits_of(limits, motors)
    weights_array = None
    if weights is not None:
        weights_array = np.asarray(weights, dtype=float)  # checked with the smallest torques

    def share(smallest: Array, basis: Array, along_basis: Array) -> Array:
        tau = smallest + basis @ along_basis
        if bounds is None or not np.isfinite(tau).all():
            return tau
        tau = within_limits(tau, basis, bounds, weights_array)
        _require_within(mechanism, tau, bounds)
        return tau

    arrays = (least, directions, amounts)
    return for_each_sample(share, arrays, (1, 2, 1), (motors,), on_error=on_error, out=out)


def weights_of(mechanism: Mechanism, weights: ArrayLike) -> Array:
    """Weights of the squared torques, positive, shape (motors,)."""
    array = single_array("weights", weights, (mechanism.motor_count,))
    if not (array > 0).all():
        raise InputError("weights", "must be positive")
    return array


def limits_of(limits: ArrayLike, motors: int, name: str = "limits") -> Array:
    """Least and largest torques, shape (motors, 2).

    Limits are the largest torques, shape () or (motors,), or the least and the largest ones, shape
    (motors, 2). Error messages use `name`.
    """
    bounds = as_array(name, limits, ())  # any shape
    if bounds.shape in ((), (motors,)):
        bounds = np.column_stack([np.full(motors, -bounds), np.full(motors, bounds)])
    if bounds.shape != (motors, 2):
        raise InputError(name, f"shape {bounds.shape}, expected ({motors},) or ({motors}, 2)")
    if not (bounds[:, 0] < bounds[:, 1]).all():
        raise InputError(name, "each least torque must be below the largest")
    return bounds


def finite_limits(limits: ArrayLike, motors: int, name: str) -> Array:
    """`limits_of`, for limits that must be finite."""
    array = finite_array(name, limits, ())  # any shape
    return limits_of(array, motors, name)


def within_limits(
    tau: Array, directions: Array, limits: Array, weights: Array | None = None
) -> Array:
    """The torques nearest to tau, within limits, that make the same motion, shape (motors,).

    `limits` has shape (motors, 2). If no such torques are within limits, the result are those whose
    largest excess is least; the caller refuses them.
    """
    excess = _excess(tau, limits).max(initial=0)
    if excess > _ROUNDING * np.abs(tau).max(initial=0):
        unit = max(float(np.abs(tau).max()), float(excess))
        nearest = _nearest(tau, directions, limits, weights, unit)
        if nearest is None:
            return _least_excess(tau, directions, limits, unit)
        tau = nearest
    return np.clip(tau, *limits.T)


def _nearest(
    tau: Array, basis: Array, limits: Array, weights: Array | None, unit: float
) -> Array | None:
    """The nearest torques by least distance programming (Lawson and Hanson 1974, chapter 23)."""
    from scipy.optimize import nnls

    if weights is not None:  # a basis that is orthonormal with these weights
        basis = basis @ np.linalg.inv(np.linalg.qr(np.sqrt(weights)[:, None] * basis, mode="r"))
    # The torques are tau + unit basis x with the shortest x that has G x >= h: one row for each
    # limit. Chapter 23: let u >= 0 minimize |E u - goal|, where E = [G^T; h^T] and goal is zero but
    # for a last entry of 1. The residual r = E u - goal then has E^T r >= 0, which is
    # G r[:k] + h r[k] >= 0, and r[k] = -|r|^2. If r is zero, no x has G x >= h. Otherwise r[k] < 0,
    # and division by -r[k] shows that x = -r[:k] / r[k] has G x >= h.
    G = np.vstack([basis, -basis])
    h = np.concatenate([limits[:, 0] - tau, tau - limits[:, 1]]) / unit
    finite = np.isfinite(h)
    E = np.vstack([G[finite].T, h[finite]])
    k = basis.shape[1]
    goal = np.zeros(k + 1)
    goal[k] = 1.0
    u, distance = nnls(E, goal)
    if distance <= _NO_DISTANCE:
        return None
    r = E @ u - goal
    return tau - unit * (basis @ (r[:k] / r[k]))


def _least_excess(tau: Array, basis: Array, limits: Array, unit: float) -> Array:
    """The torques of the same motion whose largest excess over limits is the least."""
    from scipy.optimize import linprog

    # Variables: the k amounts of preload, then the largest excess, which is minimized.
    k = basis.shape[1]
    one = np.ones((len(tau), 1))
    rows = np.vstack([np.hstack([basis, -one]), np.hstack([-basis, -one])])
    room = np.concatenate([limits[:, 1] - tau, tau - limits[:, 0]]) / unit
    finite = np.isfinite(room)
    cost = np.append(np.zeros(k), 1.0)
    variables = [(None, None)] * k + [(0, None)]
    best = linprog(cost, rows[finite], room[finite], bounds=variables)
    return tau + unit * (basis @ best.x[:k])


def _excess(tau: Array, limits: Array) -> Array:
    return np.maximum(limits[:, 0] - tau, tau - limits[:, 1])


def _require_within(mechanism: Mechanism, tau: Array, limits: Array) -> None:
    """Refuse torques of `within_limits` that exceed the limits."""
    excess = _excess(tau, limits)
    if not excess.max(initial=0) > 0:
        return
    largest = np.flatnonzero(excess >= (1 - _TIE) * excess.max())
    beyond = {mechanism.motor_names[i]: float(excess[i]) for i in largest}
    listed = ", ".join(f"{name} by {x:.4g}" for name, x in beyond.items())
    raise ActuationError(
        f"the motion needs torques that exceed the limits, at least {listed} (N m or N)",
        beyond,
    )
