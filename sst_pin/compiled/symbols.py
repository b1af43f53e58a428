# SPDX-License-Identifier: BSD-2-Clause
"""Small helpers for CasADi's symbols: sparse vectors, symmetric factors, angles up to half a turn.

An arc over its sine depends on its cosine c alone: with the arc halved three times, by cos(x / 2) =
sqrt((1 + c) / 2), the series of the arcsine converges to rounding within a few terms.
"""

from collections.abc import Iterable, Mapping
from typing import Any

import casadi as ca
from casadi import SX

from ..arrays import Array
from .links import clean

#: Entries by index, zeros left out; each is a scalar symbol or a number.
Sparse = dict[int, Any]
#: Coefficients of asin(x) / x by x^2; x is at most sin(pi / 16).
_SERIES = [1.0]
for _k in range(1, 11):
    _SERIES.append(_SERIES[-1] * (2 * _k - 1) ** 2 / (2 * _k * (2 * _k + 1)))


def sx(a: Array) -> SX:
    """Numbers as symbols, zeros left out."""
    return ca.sparsify(SX(ca.DM(clean(a))))


def is_zero(x: Any) -> bool:
    """Whether a scalar is 0 for all values of its symbols."""
    return bool(x.is_zero()) if isinstance(x, SX) else x == 0


def add(a: Mapping[int, Any], b: Mapping[int, Any]) -> Sparse:
    """Sum of two sparse vectors."""
    return dict(a) | {i: a[i] + x if i in a else x for i, x in b.items()}


def sparse(places: Iterable[int], column: SX) -> Sparse:
    """Entries of a column by their places."""
    values = zip(places, ca.vertsplit(column), strict=True)
    return {i: x for i, x in values if not is_zero(x)}


def column(x: Mapping[int, Any], places: Iterable[int]) -> SX:
    """Entries at some places in a column."""
    return ca.vertcat(SX(0, 1), *(x.get(i, SX(1, 1)) for i in places))


def symmetric(upper: Mapping[tuple[int, int], Any], size: int) -> SX:
    """A matrix by its upper triangle."""
    matrix = SX(size, size)
    for (i, j), entry in upper.items():
        matrix[i, j] = matrix[j, i] = entry
    return matrix


def row_by_row(*matrices: SX) -> SX:
    """Entries of matrices side by side, in a column."""
    return ca.vec(ca.horzcat(*matrices).T)


class SymmetricFactors:
    """A symmetric matrix A of full rank, factorised: P^T A P = L D L^T."""

    def __init__(self, A: SX) -> None:
        #: The vector D, L^T above its unit diagonal, and the row of A for each row of L.
        self.D, self.LT, self.order = ca.ldl(ca.sparsify(A), True)
        #: Entries A[k, k], and the reciprocals of the entries of D that belong to them.
        self.diagonal = [A[k, k] for k in range(A.shape[0])]
        pairs = zip(self.order, ca.vertsplit(self.D), strict=True)
        inverses = {i: 1 / pivot for i, pivot in pairs}
        self.inverses = [inverses[i] for i in range(A.shape[0])]

    def solve(self, b: SX) -> SX:
        """x with A x = b."""
        return ca.ldl_solve(b, self.D, self.LT, self.order)


def rotation_vector(quaternion: SX) -> SX:
    """Rotation vector of a unit quaternion (x, y, z, w), at most half a turn long."""
    vector, w = quaternion[:3], quaternion[3]
    side = _side(w)
    return 2 * side * _arc_over_sine(side * w) * vector


def angle(cosine: Any, sine: Any) -> Any:
    """The angle with this cosine and sine, from -pi to pi."""
    side = _side(cosine)
    beyond = ca.pi / 2 * (1 - side) * _side(sine)  # half a turn beyond a right angle, else 0
    return beyond + side * _arc_over_sine(side * cosine) * sine


def _side(x: Any) -> Any:
    """1, or -1 below 0."""
    return 2 * (x >= 0) - 1


def _arc_over_sine(cosine: Any) -> Any:
    """An arc up to a right angle over its sine."""
    halved = 1
    for _ in range(3):
        square = (1 - cosine) / 2
        cosine = ca.sqrt((1 + cosine) / 2)
        halved *= cosine
    series = 0
    for coefficient in reversed(_SERIES):
        series = series * square + coefficient
    return series / halved
