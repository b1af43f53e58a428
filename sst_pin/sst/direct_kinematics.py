# SPDX-License-Identifier: BSD-2-Clause
"""Every real assembly of an SST for given motor angles.

Motor angles fix the passive axes u_k = e_{k+3}. The normal of arc k is perpendicular to u_k:
u_k . R m_k = 0 with m_k the normal in {E}. For k = 1 this holds if R is a turn a about u_1 after a
turn b about m_1. The other two equations are linear in (1, cos b, sin b); without b they are one
equation of degree four in cos a and sin a, of degree eight in exp(i a). Newton's method polishes
the solutions.
"""

import numpy as np

from ..arrays import Array
from ..errors import SingularConfigurationError

#: |log |exp(i a)|| above which a solution is complex, and the largest residual before Newton's
#: method. Solutions that are close to one another are less exact than others.
_COMPLEX, _NEAR = 1e-3, 1e-2
#: Largest residual of a polished solution.
_POLISHED = 1e-13
#: Orientations whose entries differ by less are one solution.
_APART = 2e-6
#: Equations with smaller coefficients hold for all a, or for all b.
_ZERO = 1e-12


def orientations(u: Array, m: Array) -> Array:
    """All rotations R with u_k . R m_k = 0 for k = 1, 2, 3, shape (n, 3, 3), n <= 8, in any order.

    u are unit vectors in the base, m in the star, rows of (3, 3) arrays. If orientations are not
    isolated, the star can move while the motors are fixed: a SingularConfigurationError.
    """
    from scipy.spatial.transform import Rotation

    # Axes in which u_1 is x and m_1 is y.
    of_u, of_m = _axes(u[0]), np.roll(_axes(m[0]), 1, axis=1)
    a = _first_turns(u[1:] @ of_u, m[1:] @ of_m)
    c = _coefficients(u[1:] @ of_u, m[1:] @ of_m, a)
    # b by the equation that depends more on it: two solutions, of which the other rejects some.
    sizes = np.hypot(c[..., 1], c[..., 2])
    order, each = np.argsort(-sizes, axis=0), np.arange(len(a))
    (first, second), size = c[order, each], sizes[order[0], each]
    half = np.arccos(np.clip(-first[:, 0] / np.maximum(size, _ZERO), -1, 1))
    b = np.arctan2(first[:, 2], first[:, 1]) + np.array([half, -half])
    left = second[:, 0] + second[:, 1] * np.cos(b) + second[:, 2] * np.sin(b)
    turns = np.stack(np.broadcast_arrays(a, b), axis=-1)[np.abs(left) < _NEAR]
    R = of_u @ Rotation.from_euler("XY", turns).as_matrix() @ of_m.T
    solutions: list[Array] = []
    for candidate in _polished(u, m, R):
        if all(np.abs(candidate - known).max() > _APART for known in solutions):
            solutions.append(candidate)
    return np.array(solutions).reshape(-1, 3, 3)


def _axes(direction: Array) -> Array:
    """Right-handed axes in columns, the first along a direction, forwards or backwards."""
    _, _, axes = np.linalg.svd(direction[None])
    axes[2] *= np.linalg.det(axes)
    return np.asarray(axes.T)


def _coefficients(u: Array, m: Array, a: Array) -> Array:
    """Factors of (1, cos b, sin b) in u_k . Rot(x, a) Rot(y, b) m_k, shape (k, len(a), 3)."""
    c, s, (u_x, u_y, u_z), (m_x, m_y, m_z) = np.cos(a), np.sin(a), u.T[..., None], m.T[..., None]
    y, z = c * u_y + s * u_z, c * u_z - s * u_y
    return np.stack([y * m_y, u_x * m_x + z * m_z, u_x * m_z - z * m_x], axis=-1)


def _first_turns(u: Array, m: Array) -> Array:
    """Angles a for which both equations have one b, from the Fourier series of their resultant."""
    w = np.cross(*_coefficients(u, m, np.linspace(0, 2 * np.pi, 9, endpoint=False)))
    size = float(np.abs(w).max())
    w /= max(size, 1e-300)
    series = np.fft.fftshift(np.fft.fft(w[:, 1] ** 2 + w[:, 2] ** 2 - w[:, 0] ** 2))
    least = min(size, float(np.abs(series).max()))
    if least < _ZERO:
        problem = "the motor angles do not determine the star"
        cause = "it can move while the motors are fixed"
        raise SingularConfigurationError(f"{problem}: {cause}", 1 / max(least, 1e-300))
    roots = np.roots(series[::-1])
    with np.errstate(divide="ignore"):
        return np.angle(roots[np.abs(np.log(np.abs(roots))) < _COMPLEX])


def _polished(u: Array, m: Array, R: Array) -> Array:
    """Solutions by Newton's method from orientations, shape (n, 3, 3), without those that fail."""
    from scipy.spatial.transform import Rotation

    for _ in range(30):
        n = m @ R.mT
        residual = (u * n).sum(axis=-1)
        if np.abs(residual).max(initial=0.0) < _POLISHED / 10:
            break
        turn = np.linalg.pinv(np.cross(n, u), rcond=1e-12) @ residual[..., None]
        R = Rotation.from_rotvec(-turn[..., 0]).as_matrix() @ R
    return R[np.abs((u * (m @ R.mT)).sum(axis=-1)).max(axis=-1, initial=0.0) < _POLISHED]
