# SPDX-License-Identifier: BSD-2-Clause
# cython: annotation_typing=False, boundscheck=False, cdivision=True, cpow=True
# cython: initializedcheck=False, wraparound=False
"""Phi x = c for given rates of the coordinates, block by block.

A block consists of rows of Phi and of the dependent rates in them; no row of it contains a
dependent rate of another block. Loops that share no dependent joints are blocks apart, so the cost
is linear in their number. In each block Phi^u x^u = c - Phi^a x^a is solved by a QR decomposition
of Phi^u with column pivoting, in the least-squares sense: redundant rows stay in.

Cython compiles this module, with the types in `blocks.pxd`. Where it is not compiled, it computes
the same in more time.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
#: Rows one after the other.
Numbers: TypeAlias = "array[float]"


class Block:
    """Rows of Phi with their rates, and the decomposition of their dependent part.

    Args:
        rows: Indices of the rows, m of them.
        dependent: Indices in v of the d dependent rates.
        coordinates: Indices in v of the coordinates in the rows.
        numbers: Which coordinates these are, indices in va.
        row_scale: What makes the rows free of units, shape (m,).
        rate_scale: The dependent rates in multiples of these are free of units, shape (d,).

    Attributes:
        dependent: As given.
        largest, smallest: Of the pivots: the diagonal of R.
    """

    def __init__(
        self,
        rows: Indices,
        dependent: Indices,
        coordinates: Indices,
        numbers: Indices,
        row_scale: Array,
        rate_scale: Array,
    ) -> None:
        m, d, n = len(rows), len(dependent), len(coordinates)
        self.dependent = dependent
        self._rows, self._dependent = indices(rows), indices(dependent)
        self._coordinates, self._numbers = indices(coordinates), indices(numbers)
        self._row_scale, self._rate_scale = array("d", row_scale), array("d", rate_scale)
        self._L = zeros(d * n)
        self.largest = self.smallest = 0.0
        # R above the diagonal, the reflections I - factor u u^T on and below it.
        self._A, self._diagonal, self._factors = zeros(m * d), zeros(d), zeros(d)
        self._order, self._squares = indices(range(d)), zeros(d)
        self._products, self._B, self._b = zeros(max(d, n, 1)), zeros(m * n), zeros(m)

    def factorise(self, Phi: Array) -> None:
        """Decompose the dependent part of Phi, shape (rows, nv), and compute L, Eq. (17)."""
        A, B, squares, scale = self._A, self._B, self._squares, self._rate_scale
        m, d, n = len(self._rows), len(self._dependent), len(self._coordinates)
        for k in range(d):
            self._order[k], self._diagonal[k], squares[k] = k, 0.0, 0.0
        for i in range(m):
            row, factor = self._rows[i], self._row_scale[i]
            for k in range(d):
                x = Phi[row, self._dependent[k]] * factor * scale[k]
                A[i * d + k] = x
                squares[k] += x * x
            for k in range(n):
                B[i * n + k] = -Phi[row, self._coordinates[k]] * factor
        for k in range(min(m, d)):
            self._bring_largest_to(k)
            self._reflect(k)
        self.largest, self.smallest = abs(self._diagonal[0]), abs(self._diagonal[d - 1])
        if self.smallest == 0.0:
            return
        self._solve(B, n)
        for k in range(d):
            at = self._order[k]
            for j in range(n):
                self._L[at * n + j] = B[k * n + j] * scale[at]

    def _bring_largest_to(self, k: int) -> None:
        """Exchange column k of what is left with the longest one."""
        A, squares, order, d, p = self._A, self._squares, self._order, len(self._order), k
        for j in range(k + 1, d):
            if squares[j] > squares[p]:
                p = j
        if p != k:
            order[k], order[p] = order[p], order[k]
            squares[k], squares[p] = squares[p], squares[k]
            for i in range(len(self._rows)):
                at = i * d
                A[at + k], A[at + p] = A[at + p], A[at + k]

    def _reflect(self, k: int) -> None:
        """Turn column k onto the diagonal, the columns behind it with it."""
        A, w, squares = self._A, self._products, self._squares
        m, d = len(self._rows), len(self._dependent)
        row = k * d
        length, factor, pivot = squares[k] ** 0.5, 0.0, A[row + k]
        if length > 0.0:
            self._diagonal[k] = -length if pivot > 0 else length
            A[row + k] = pivot - self._diagonal[k]
            factor = -1.0 / (self._diagonal[k] * A[row + k])
        self._factors[k] = factor
        for j in range(k + 1, d):
            w[j] = 0.0
        for i in range(k, m):
            at = i * d
            u = A[at + k] * factor
            for j in range(k + 1, d):
                w[j] += u * A[at + j]
        for j in range(k + 1, d):
            squares[j] = 0.0
            A[row + j] -= A[row + k] * w[j]
        for i in range(k + 1, m):
            at = i * d
            u = A[at + k]
            for j in range(k + 1, d):
                x = A[at + j] - u * w[j]
                A[at + j] = x
                squares[j] += x * x

    def _solve(self, B: Numbers, n: int) -> None:
        """Put the solution for right sides B, shape (m, n), into its first d rows."""
        A, w, m, d = self._A, self._products, len(self._rows), len(self._dependent)
        for k in range(d):
            for j in range(n):
                w[j] = 0.0
            for i in range(k, m):
                u, row = A[i * d + k] * self._factors[k], i * n
                for j in range(n):
                    w[j] += u * B[row + j]
            for i in range(k, m):
                u, row = A[i * d + k], i * n
                for j in range(n):
                    B[row + j] -= u * w[j]
        for k in range(d - 1, -1, -1):
            row = k * n
            for i in range(k + 1, d):
                u, at = A[k * d + i], i * n
                for j in range(n):
                    B[row + j] -= u * B[at + j]
            for j in range(n):
                B[row + j] /= self._diagonal[k]

    def add_solution(self, c: Array, sign: float, x: Array) -> None:
        """Add to the dependent rates x, shape (nv,), what the rows need for c, shape (rows,)."""
        b = self._b
        for i in range(len(self._rows)):
            b[i] = sign * c[self._rows[i]] * self._row_scale[i]
        self._solve(b, 1)
        for k in range(len(self._dependent)):
            at = self._order[k]
            x[self._dependent[at]] += b[k] * self._rate_scale[at]

    def write_L(self, L: Array) -> None:
        """Put its part of L into the whole, shape (nv, n)."""
        n = len(self._numbers)
        for i in range(len(self._dependent)):
            for j in range(n):
                L[self._dependent[i], self._numbers[j]] = self._L[i * n + j]

    def follow(self, a: Array, x: Array) -> None:
        """Put L a into the dependent rates."""
        n = len(self._numbers)
        for i in range(len(self._dependent)):
            s = 0.0
            for j in range(n):
                s += self._L[i * n + j] * a[self._numbers[j]]
            x[self._dependent[i]] = s

    def reduce(self, x: Array, a: Array) -> None:
        """Add L^T x of the dependent rates to a, shape (n,)."""
        n = len(self._numbers)
        for i in range(len(self._dependent)):
            s = x[self._dependent[i]]
            for j in range(n):
                a[self._numbers[j]] += self._L[i * n + j] * s


def zeros(count: int) -> Numbers:
    """Memory that Python reads faster than NumPy's."""
    return array("d", bytes(8 * count))


def indices(numbers: Iterable[int]) -> array[int]:
    """Likewise, for indices."""
    return array("q", map(int, numbers))


class Blocks:
    """All blocks: x with Phi x = c and x^a = a, Eqs. (7) and (8) without sorting the joints.

    Args:
        blocks: They share no row and no dependent rate, and contain every dependent rate.
        coordinates: Indices in v of the coordinates, n of them.
        nv: Number of rates.

    Attributes:
        blocks: As given.
        least: What the pivots of the last Phi had to exceed.
    """

    def __init__(self, blocks: list[Block], coordinates: Indices, nv: int) -> None:
        self.blocks, self._coordinates, self._nv = blocks, indices(coordinates), nv

    def decompose(self, Phi: Array, tolerance: float) -> bool:
        """Take in Phi, shape (rows, nv).

        Args:
            Phi: Jacobian of the closures, shape (rows, nv).
            tolerance: A pivot counts that is larger than this times the largest one. Coordinates
                have pivots of 1.

        Returns:
            Whether all pivots count.
        """
        self.least, sound = tolerance, True
        for block in self.blocks:
            block.factorise(Phi)
            self.least = max(self.least, tolerance * block.largest)
        for block in self.blocks:
            if not block.smallest > self.least:
                sound = False
        return sound

    @property
    def L(self) -> Array:
        """L of Eq. (17), shape (nv, n): Phi L = 0, unit matrix in the coordinates' rows."""
        L = np.zeros((self._nv, len(self._coordinates)))
        self._write_L(L)
        return L

    def _write_L(self, L: Array) -> None:
        for k in range(len(self._coordinates)):
            L[self._coordinates[k], k] = 1.0
        for block in self.blocks:
            block.write_L(L)

    def rates(self, va: Array) -> Array:
        """v = L va, shape (nv,), Eq. (16)."""
        v = np.empty(self._nv)
        self._follow(va, v)
        return v

    def _follow(self, a: Array, x: Array) -> None:
        for k in range(len(self._coordinates)):
            x[self._coordinates[k]] = a[k]
        for block in self.blocks:
            block.follow(a, x)

    def accelerations(self, aa: Array, drift: Array) -> Array:
        """x with Phi x = -drift and x^a = aa, shape (nv,), Eqs. (8), (20)."""
        x = np.empty(self._nv)
        self._follow(aa, x)
        self._add_solution(drift, -1.0, x)
        return x

    def _add_solution(self, c: Array, sign: float, x: Array) -> None:
        for block in self.blocks:
            block.add_solution(c, sign, x)

    def solve(self, closures: Array) -> Array:
        """X with Phi X = closures, shape (rows, k), and X^a = 0, shape (nv, k)."""
        X = np.zeros((self._nv, closures.shape[1]))
        for k in range(closures.shape[1]):
            self._add_solution(closures[:, k], 1.0, X[:, k])
        return X

    def reduced(self, forces: Array) -> Array:
        """L^T times forces on the tree, shape (n,)."""
        f = np.empty(len(self._coordinates))
        self._reduce(forces, f)
        return f

    def _reduce(self, x: Array, a: Array) -> None:
        for k in range(len(self._coordinates)):
            a[k] = x[self._coordinates[k]]
        for block in self.blocks:
            block.reduce(x, a)
