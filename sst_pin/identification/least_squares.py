# SPDX-License-Identifier: BSD-2-Clause
"""Linear least squares with the covariance of the solution."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..errors import InputError

#: Unknowns with a smaller part in the equations, in units of their columns, are not shown by them.
_UNSHOWN = 1e-9


def solved(A: Array, z: Array) -> tuple[Array, Array]:
    """The least-squares solution of A x = z, and R^-1 of A = Q R, shapes (b,) and (b, b).

    R^-1 R^-T is the covariance of x for noise of z with the covariance 1. Leading axes of A, shape
    (..., b), and z, shape (...), are rows of one system.

    Raises:
        InputError: If the columns of A are not independent.
    """
    from scipy.linalg import solve_triangular

    b = A.shape[-1]
    # The columns of A and z are triangularised together, in units of their sizes: the first b rows
    # of the result are [R, Q^T z].
    rows = np.concatenate([A, z[..., None]], axis=-1).reshape(-1, b + 1)
    sizes = np.linalg.norm(rows[:, :b], axis=0)
    sizes[sizes == 0] = 1
    rows[:, :b] /= sizes
    triangle = np.asarray(np.linalg.qr(rows, mode="r"), float)[:b]
    R = triangle[:, :b]
    if np.abs(np.diag(R)).min(initial=1.0) < _UNSHOWN:
        problem = "it does not show all base parameters; base_parameters(motion=) finds those"
        raise InputError("motion", problem)
    inverse = solve_triangular(R, np.eye(b)) / sizes[:, None]
    return inverse @ triangle[:, b], inverse
