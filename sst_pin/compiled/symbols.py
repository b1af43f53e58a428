# SPDX-License-Identifier: BSD-2-Clause
"""Small helpers for CasADi's symbols: sparse vectors, symmetric factors, inverse trigonometry.

A number that CasADi knows to be zero takes no operation. So zeros are left out wherever possible.
"""

from collections.abc import Iterable, Mapping
from typing import Any

import casadi as ca
from casadi import SX

from ..arrays import Array
from .links import clean

#: Entries by index, zeros left out; each is a scalar symbol or a number.
Sparse = dict[int, Any]


def sx(a: Array) -> SX:
    """An array of numbers as a matrix of CasADi, zeros left out."""
    return ca.sparsify(SX(ca.DM(clean(a))))


def is_zero(x: Any) -> bool:
    """Whether a scalar is 0 for all values of its symbols."""
    return bool(x.is_zero()) if isinstance(x, SX) else x == 0


def add(a: Mapping[int, Any], b: Mapping[int, Any]) -> Sparse:
    """Sum of two sparse vectors."""
    return dict(a) | {i: a[i] + x if i in a else x for i, x in b.items()}


def sparse(indices: Iterable[int], column: SX) -> Sparse:
    """A sparse vector with the entries of a column at these indices."""
    values = zip(indices, ca.vertsplit(column), strict=True)
    return {i: x for i, x in values if not is_zero(x)}


def column(x: Mapping[int, Any], indices: Iterable[int]) -> SX:
    """The entries of a sparse vector at these indices, in a column."""
    return ca.vertcat(SX(0, 1), *(x.get(i, SX(1, 1)) for i in indices))


def symmetric(upper: Mapping[tuple[int, int], Any], size: int) -> SX:
    """A symmetric matrix from the entries of its upper triangle, by row and column."""
    matrix = SX(size, size)
    for (i, j), entry in upper.items():
        matrix[i, j] = matrix[j, i] = entry
    return matrix


def row_by_row(*matrices: SX) -> SX:
    """The entries of the matrix [A, B, ...] of matrices side by side, row by row, in a column."""
    return ca.vec(ca.horzcat(*matrices).T)


class SymmetricFactors:
    """A symmetric matrix A of full rank, factorised: P^T A P = L D L^T.

    P is a permutation that keeps L sparse: row i of P^T A P is row `order[i]` of A. L is lower
    triangular with ones on its diagonal, D is diagonal.

    Attributes:
        D: The diagonal of D.
        LT: L^T without its diagonal.
        order: The row of A for each row of L.
        diagonal: The entries A[k, k].
        inverses: One over the pivot, the entry of D, for row k of A.
    """

    def __init__(self, A: SX) -> None:
        self.D, self.LT, self.order = ca.ldl(ca.sparsify(A), True)
        self.diagonal = [A[k, k] for k in range(A.shape[0])]
        inverse_of_row = {}
        for row, pivot in zip(self.order, ca.vertsplit(self.D), strict=True):
            inverse_of_row[row] = 1 / pivot
        self.inverses = [inverse_of_row[k] for k in range(A.shape[0])]

    def solve(self, b: SX) -> SX:
        """x with A x = b."""
        return ca.ldl_solve(b, self.D, self.LT, self.order)


# --- inverse trigonometry -----------------------------------------------------------------------
#
# Kernels compute several samples in one vector. So these functions have no branches and no calls
# except the square root, and are exact to rounding everywhere, zero and pi included.


def rotation_vector(quaternion: SX) -> SX:
    """Rotation vector of a unit quaternion (x, y, z, w), at most half a turn long.

    The quaternion of the rotation vector 2 a u, with a unit vector u, is (sin(a) u, cos(a)). The
    opposite quaternion is the same rotation. The one of both with w >= 0 has a <= pi / 2.
    """
    vector = quaternion[:3]
    w = quaternion[3]
    sign = _sign(w)
    return 2 * sign * _angle_over_sine(sign * w) * vector


def angle(cosine: Any, sine: Any) -> Any:
    """The angle with this cosine and sine, from -pi to pi."""
    sign = _sign(cosine)
    # If the cosine is negative, the angle is pi or -pi minus the angle with the opposite cosine.
    half_turn = ca.pi / 2 * (1 - sign) * _sign(sine)
    return half_turn + sign * _angle_over_sine(sign * cosine) * sine


def _sign(x: Any) -> Any:
    """1, or -1 below 0."""
    return 2 * (x >= 0) - 1


#: Coefficients of asin(s) / s as a series of s^2. For s up to sin(pi / 16) the terms left out are
#: below rounding.
_ARCSINE = [1.0]
for _k in range(1, 11):
    _ARCSINE.append(_ARCSINE[-1] * (2 * _k - 1) ** 2 / (2 * _k * (2 * _k + 1)))


def _angle_over_sine(cosine: Any) -> Any:
    """x / sin(x) of an angle x from 0 to pi / 2 with this cosine.

    The angle is halved three times. As sin(x) = 2 cos(x / 2) sin(x / 2), and so on,

        x / sin(x) = y / (sin(y) cos(x / 2) cos(x / 4) cos(x / 8)),   y = x / 8 <= pi / 16,

    and y / sin(y) is the series of the arcsine at s = sin(y).
    """
    cosines = 1  # cos(x / 2) cos(x / 4) cos(x / 8)
    for _ in range(3):
        # Half the angle: sin^2(x / 2) = (1 - cos(x)) / 2, cos^2(x / 2) = (1 + cos(x)) / 2.
        sine_squared = (1 - cosine) / 2
        cosine = ca.sqrt((1 + cosine) / 2)
        cosines *= cosine
    series = 0
    for coefficient in reversed(_ARCSINE):
        series = series * sine_squared + coefficient  # of sin^2(x / 8)
    return series / cosines
