# SPDX-License-Identifier: BSD-2-Clause
"""Vectors that move with the tree, with their rate and the derivatives of both by q, all exact.

A formula written for jets gives its value, its rate and the derivatives of both by Leibniz' rule.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .vectors import skew

Array = NDArray[np.float64]
#: The matrix of a product with a vector.
Factor = Callable[[Array], Array]
_AXES = np.eye(3)


class Jet:
    """A vector of k entries, or with k = 1 a number, that moves with the tree.

    Args:
        parts: [x x_q; t t_q]: its value and its rate, each with its derivatives by q, v held, shape
            (2 k, 1 + nv).
    """

    def __init__(self, parts: Array) -> None:
        self.parts, self._k = parts, len(parts) // 2

    @classmethod
    def of(cls, x: Array, t: Array, x_q: Array, t_q: Array) -> Jet:
        """From its parts, of shapes (k,) and (k, nv)."""
        parts = np.empty((2 * len(x), 1 + x_q.shape[1]))
        parts[: len(x), 0], parts[len(x) :, 0] = x, t
        parts[: len(x), 1:], parts[len(x) :, 1:] = x_q, t_q
        return cls(parts)

    @classmethod
    def constant(cls, x: Array, nv: int) -> Jet:
        """A vector that does not move."""
        parts = np.zeros((2 * len(x), 1 + nv))
        parts[: len(x), 0] = x
        return cls(parts)

    @property
    def x(self) -> Array:
        """Its value, shape (k,)."""
        return self.parts[: self._k, 0]

    @property
    def t(self) -> Array:
        """Its rate, shape (k,)."""
        return self.parts[self._k :, 0]

    @property
    def x_q(self) -> Array:
        """Derivatives of the value by q, shape (k, nv)."""
        return self.parts[: self._k, 1:]

    @property
    def t_q(self) -> Array:
        """Derivatives of the rate by q, v held, shape (k, nv)."""
        return self.parts[self._k :, 1:]

    def __sub__(self, other: Jet) -> Jet:
        return Jet(self.parts - other.parts)

    def __rmul__(self, number: float) -> Jet:
        return Jet(number * self.parts)

    def cross(self, other: Jet) -> Jet:
        """The vector product."""
        return _product(self, other, skew, lambda b: -skew(b))

    def dot(self, other: Jet) -> Jet:
        """The scalar product."""
        return _product(self, other, lambda a: a[None], lambda b: b[None])

    def along(self, number: Jet) -> Jet:
        """The vector times a number."""
        return _product(self, number, lambda a: a[:, None], lambda s: s * _AXES)

    def unit(self) -> Jet:
        """The vector over its length."""
        square = self.dot(self)
        s, s_t = square.x, square.t
        f = s**-0.5  # 1 / length, as a function of the square, with its derivatives
        f_1, f_2 = -f / (2 * s), 3 * f / (4 * s**2)
        f_q, f_tq = f_1 * square.x_q, f_1 * square.t_q + f_2 * s_t * square.x_q
        return self.along(Jet.of(f, f_1 * s_t, f_q, f_tq))

    def at(self, point: Jet) -> Jet:
        """The wrench [force; moment] at the origin of this force at a point."""
        return _stacked(self, point.cross(self))

    def alone(self) -> Jet:
        """The wrench [0; moment] of this moment."""
        return _stacked(0.0 * self, self)


def _product(a: Jet, b: Jet, left: Factor, right: Factor) -> Jet:
    """A bilinear product left(a) b = right(b) a, by Leibniz' rule."""
    parts = _lifted(left, a).dot(b.parts) + _lifted(right, b).dot(a.parts)
    parts[:, 0] /= 2  # it has no derivatives, so that the two terms are the same
    return Jet(parts)


def _lifted(factor: Factor, jet: Jet) -> Array:
    """What takes [y; y_t] to the product and its rate."""
    matrix, rate = factor(jet.x), factor(jet.t)
    rows, columns = matrix.shape
    lifted = np.zeros((2 * rows, 2 * columns))
    lifted[:rows, :columns] = lifted[rows:, columns:] = matrix
    lifted[rows:, :columns] = rate
    return lifted


def _stacked(upper: Jet, lower: Jet) -> Jet:
    a, b = upper.parts, lower.parts
    return Jet(np.concatenate((a[:3], b[:3], a[3:], b[3:])))
