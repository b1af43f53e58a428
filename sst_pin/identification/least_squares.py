# SPDX-License-Identifier: BSD-2-Clause
"""Linear least squares with the covariance of the solution."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..errors import InputError

#: Columns of A, scaled to size 1, are dependent if a diagonal entry of R is smaller: the part of a
#: column outside the span of the columns before it.
_DEPENDENT = 1e-9


def solved(A: Array, z: Array) -> tuple[Array, Array]:
    """The least-squares solution x of A x = z, shape (b,), and R^-1 of A = Q R, shape (b, b).

    If the noise of z has the covariance 1, then x has the covariance R^-1 R^-T. A has the shape
    (..., b) and z the shape (...): all their leading axes together count the equations.

    Raises:
        InputError: If the columns of A are not independent.
    """
    from scipy.linalg import solve_triangular

    b = A.shape[-1]
    # The decomposition of [A, z] has R and Q^T z in its first b rows. Columns of A are divided by
    # their sizes.
    rows = np.concatenate([A, z[..., None]], axis=-1).reshape(-1, b + 1)
    sizes = np.linalg.norm(rows[:, :b], axis=0)
    sizes[sizes == 0] = 1
    rows[:, :b] /= sizes
    triangle = np.asarray(np.linalg.qr(rows, mode="r"), float)[:b]
    R = triangle[:, :b]
    if np.abs(np.diag(R)).min(initial=1.0) < _DEPENDENT:
        problem = "it does not show all base parameters; base_parameters(motion=) finds those"
        raise InputError("motion", problem)
    inverse = solve_triangular(R, np.eye(b)) / sizes[:, None]
    return inverse @ triangle[:, b], inverse
