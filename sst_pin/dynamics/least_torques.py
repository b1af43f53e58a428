# SPDX-License-Identifier: BSD-2-Clause
"""The least torques that bring forces about, and where no motor acts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..arrays import Array
from ..model.mechanism import Mechanism
from ..model.thresholds import MAX_CONDITION_NUMBER

#: Torques that are a smaller part of the largest are as fine as any.
_FINE = 1e-12


def without_rounding(mechanism: Mechanism, L: Array, B: Array) -> Array:
    """A = L^T B, shape (..., n, motors), zero where a motor moves with a coordinate by rounding.

    Rates of dependent joints and directions of lines are rounded, motors on coordinates are not.
    """
    scale, own = mechanism.rate_scale[:, None], mechanism.coordinates
    A, rounded = np.swapaxes(L, -1, -2) @ B, np.array(B)
    rounded[..., own, :] -= mechanism.motors[own]
    moved = np.swapaxes(L != 0, -1, -2)[..., None]  # (..., n, nv, 1)
    gears = (moved * np.abs(rounded * scale)[..., None, :, :]).max(axis=-2)
    ways = np.abs(L / scale).max(axis=-2)[..., None]
    return np.where(np.abs(A) * MAX_CONDITION_NUMBER >= ways * gears, A, 0.0)


def smallest_torques(
    A: Array, units: Array, gears: Array, weights: Array | None
) -> tuple[Callable[[Array], Array], Array]:
    """The least torques tau with A tau = f as a function of f, and where no motor acts.

    f is met as far as the motors act: the second result are directions c with c^T A = 0 in columns,
    shape (n, k). `units` times A by `gears` is free of units, but each freedom counts alike,
    whatever the weights of the squared torques.
    """
    from scipy.linalg import qr, solve_triangular

    gears = np.where(gears > 0, gears, 1)
    free_of_units = A * units[:, None] / gears
    rows = np.abs(free_of_units).max(axis=1, initial=0)
    rows = np.where(rows > 0, rows, 1) / units
    U, s, Vt = np.linalg.svd(A / gears / rows[:, None])
    rank = int(np.count_nonzero(s * MAX_CONDITION_NUMBER > s.max(initial=0)))
    half = np.ones(len(gears)) if weights is None else 1 / np.sqrt(weights)
    # Sorted rows and pivots keep the digits of motors that differ much (Cox and Higham 1998).
    order = np.argsort(-half * gears)
    own = (half * gears)[order, None] * Vt[:rank, order].T
    Q, R, pivots = qr(own, mode="economic", pivoting=True)

    def smallest(f: Array) -> Array:
        tau, along = np.empty(len(gears)), U[:, :rank].T.dot(f / rows) / s[:rank]
        tau[order] = Q.dot(solve_triangular(R, along[pivots], trans=1)) if rank else 0
        return half * tau

    return smallest, U[:, rank:] / rows[:, None]


def finest(tau: Array) -> Array:
    """Weights by which the motors of small torques, whose rounding is fine, correct the others."""
    size = np.abs(tau).max(initial=0)
    return (np.abs(tau) / (size or 1) + _FINE) ** 2
