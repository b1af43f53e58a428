# SPDX-License-Identifier: BSD-2-Clause
"""Formulas of vectors, twists and placements, for arrays with any leading axes.

Twists are t = [v; omega], where v is the velocity of the point of the body that is at the origin.
Placements are homogeneous matrices M = [R p; 0 1]. Numbers may be complex, so that derivatives can
be computed by complex steps: norms are sqrt(a . a), not sqrt(|a|^2).
"""

import numpy as np
import pinocchio as pin

from ..arrays import Array

# Matrices that are linear in a vector or twist a: the sum of a_k times the matrices of unit vectors
# or unit twists e_k, which stand in [:, k]. `a.dot` sums over this index k.
_SKEW = np.stack([pin.skew(e) for e in np.eye(3)], axis=1)
_HAT = np.stack([pin.Motion(e).homogeneous for e in np.eye(6)], axis=1)
_BRACKET = np.stack([pin.Motion(e).action for e in np.eye(6)], axis=1)


def skew(a: Array) -> Array:
    """Cross-product matrices [a x], shape (..., 3, 3), of vectors, shape (..., 3)."""
    return a.dot(_SKEW)


def cross(a: Array, b: Array) -> Array:
    """Cross products a x b, shape (..., 3); `np.cross` takes several times as long."""
    product = np.empty(np.broadcast_shapes(a.shape, b.shape), dtype=np.result_type(a, b))
    product[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    product[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    product[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


def inner(a: Array, b: Array) -> Array:
    """a . b with an axis of length 1 in place of the components, shape (..., 1)."""
    return (a * b).sum(axis=-1, keepdims=True)


def unit(d: Array) -> Array:
    """d / |d|, shape (..., 3); zero stays zero."""
    return d / _length(d)


def unit_rate(d: Array, d_dot: Array) -> Array:
    """The rate of `unit(d)` where d has the rate d_dot: the part of d_dot normal to d, over |d|."""
    u = unit(d)
    return (d_dot - inner(u, d_dot) * u) / _length(d)


def _length(d: Array) -> Array:
    """|d|, shape (..., 1); 1 for zero."""
    length = np.sqrt(inner(d, d))
    return length + (length == 0)


def hat(t: Array) -> Array:
    """Matrices, shape (..., 4, 4), of twists, shape (..., 6).

    A placement M of a body with the twist t, both in the same frame, has the rate hat(t) M.
    """
    return t.dot(_HAT)


def bracket_matrix(t: Array) -> Array:
    """Matrices [t x], shape (..., 6, 6), of twists t: their product with s is the Lie bracket."""
    return t.dot(_BRACKET)


def brackets(a: Array, b: Array) -> Array:
    """Lie brackets a x b of twists [v; omega] in columns, shape (6, k)."""
    v_a, omega_a = np.split(a.T, 2, axis=1)
    v_b, omega_b = np.split(b.T, 2, axis=1)
    linear = cross(omega_a, v_b) + cross(v_a, omega_b)
    angular = cross(omega_a, omega_b)
    return np.concatenate((linear, angular), axis=1).T


def inverse(M: Array) -> Array:
    """Inverse placements [R^T, -R^T p; 0 1], shape (..., 4, 4)."""
    result = np.zeros_like(M)
    R_T = M[..., :3, :3].swapaxes(-1, -2)
    result[..., :3, :3] = R_T
    result[..., :3, 3:] = -R_T @ M[..., :3, 3:]
    result[..., 3, 3] = 1.0
    return result


def action(M: Array) -> Array:
    """Matrices, shape (..., 6, 6), that take twists of the inner frame of M to its outer frame.

    They are [R, skew(p) R; 0, R].
    """
    result = np.zeros((*M.shape[:-2], 6, 6), dtype=M.dtype)
    R = M[..., :3, :3]
    result[..., :3, :3] = R
    result[..., 3:, 3:] = R
    result[..., :3, 3:] = skew(M[..., :3, 3]) @ R
    return result
