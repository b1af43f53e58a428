# SPDX-License-Identifier: BSD-2-Clause
"""Ranks, null space and condition numbers of Phi, free of units.

Rows of Phi are multiplied by `row_scale` and its columns by `rate_scale`, so that verdicts do not
depend on metres or millimetres.
"""

from collections.abc import Iterable

import numpy as np

from ..arrays import Array, Indices
from ..model.mechanism import Mechanism
from ..model.thresholds import RANK_TOLERANCE
from .loops import Loops


def scaled_Phi(mechanism: Mechanism, loops: Loops, q: Array) -> Array:
    """Phi at one configuration, free of units, shape (rows, nv)."""
    loops.evaluate(q)
    return loops.Phi * mechanism.row_scale[:, None] * mechanism.rate_scale


def rank_of(sizes: Array) -> int:
    """Rank of a matrix, free of units, from its singular values or pivots.

    Values above `RANK_TOLERANCE` times the largest count. If the largest is below one, they are
    compared with one, which is the natural size of a row that holds a motion: if the rows hold
    nothing, all values are rounding.
    """
    return int(np.count_nonzero(sizes > RANK_TOLERANCE * sizes.max(initial=1.0)))


def independent_rows(Phi: Array) -> Indices:
    """Indices of independent rows, as many as the rank of Phi, by a pivoted QR of Phi^T.

    Phi is free of units.
    """
    if not Phi.size:
        return np.empty(0, dtype=np.intp)
    from scipy.linalg import qr

    R, order = qr(Phi.T, pivoting=True, mode="r")
    return np.sort(order[: rank_of(np.abs(np.diag(R)))])


def free_motions(Phi: Array) -> Array:
    """Orthonormal motions with Phi v = 0, shape (nv, degrees of freedom); Phi free of units."""
    if not Phi.size:
        return np.eye(Phi.shape[1])
    _, sizes, Vt = np.linalg.svd(Phi)
    return np.asarray(Vt[rank_of(sizes) :].T)


def condition_number(
    mechanism: Mechanism, Phi: Array, parts: Iterable[tuple[Indices, Indices]]
) -> float:
    """Condition number of the columns of Phi for the dependent rates; infinite if singular.

    It is the largest condition number of the parts, so that loops of different sizes do not make it
    larger. Phi is free of units. `parts` are those of `Loops.parts`.
    """
    blocks = list[tuple[Array, Array]]()
    for rows, rates in parts:
        block = Phi[np.ix_(rows, rates)]
        blocks.append((block[None], np.array([mechanism.usual_size(rows, rates)])))
    return largest_condition(blocks)


def largest_condition(blocks: Iterable[tuple[Array, Array]]) -> float:
    """The largest condition number of matrices, in arrays of shape (count, rows, rates).

    Each array comes with the usual sizes of its matrices, shape (count,); see
    `Mechanism.usual_size`. A matrix of one column has one singular value, so that its condition
    number would be 1 everywhere. If this value is smaller than the usual size, it is compared with
    the usual size. The usual size of other matrices is 0.
    """
    worst = 1.0
    for matrices, usual_sizes in blocks:
        if not np.isfinite(matrices).all():
            return np.inf
        s = np.linalg.svd(matrices, compute_uv=False)
        has_full_rank = s.shape[1] == matrices.shape[2] and s[:, -1].all()
        if not has_full_rank:
            return np.inf
        conditions = np.maximum(s[:, 0], usual_sizes) / s[:, -1]
        worst = max(worst, float(conditions.max()))
    return worst
