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
    """Rank of a matrix from its singular values or pivots; its rows are free of units.

    A row that holds a motion has the natural size one. A smaller largest value is compared with
    one: where the rows hold nothing, all values are rounding.
    """
    return int(np.count_nonzero(sizes > RANK_TOLERANCE * sizes.max(initial=1.0)))


def independent_rows(Phi: Array) -> Indices:
    """Indices of independent rows, as many as the rank of Phi, by a pivoted QR of Phi^T."""
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

    It is the largest of the condition numbers of `parts`, which share no rows and no rates, so
    loops of different sizes do not make it larger.
    """
    return largest_condition(
        (Phi[np.ix_(*part)][None], np.array([mechanism.usual_size(*part)])) for part in parts
    )


def largest_condition(blocks: Iterable[tuple[Array, Array]]) -> float:
    """The largest condition number of matrices, in arrays of shape (count, rows, rates).

    Each array comes with the usual sizes of its matrices, shape (count,). They replace smaller
    norms.
    """
    worst = 1.0
    for block, sizes in blocks:
        if not np.isfinite(block).all():
            return np.inf
        s = np.linalg.svd(block, compute_uv=False)
        if s.shape[1] < block.shape[2] or not s[:, -1].all():
            return np.inf
        worst = max(worst, float((np.maximum(s[:, 0], sizes) / s[:, -1]).max()))
    return worst
