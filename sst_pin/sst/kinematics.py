# SPDX-License-Identifier: BSD-2-Clause
"""Closed-form kinematics of the SST, vectorised over leading axes: Sects. 2 and 4.

Leg k is Rot(z, gamma_k) Rot(x, mu_k) Rot(z, beta_k) from {0k} to {3k}, Eqs. (26)-(29). The leg
depends only on the normal n_k = e_{k+6} of its arc's plane, the z axis of {3k}. The passive axis
e_{k+3} is normal to e_k and n_k, so R_k is one of two antipodal points: the sign of sin(mu_k) is
the branch of the leg.
"""

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, of_samples
from ..errors import InputError, SingularConfigurationError

#: The eight combinations of leg branches, shape (8, 3): +1 for 0 < mu_k < pi, the paper's robot.
BRANCHES = np.array(list(itertools.product((1, -1), repeat=3)))
BRANCHES.setflags(write=False)

#: |sin(mu_k)| below which a leg is in the plane of its arc and gamma_k is undetermined.
_FLAT = 1e-8


class Geometry(NamedTuple):
    """Geometry of an SST: orientations of the frames fixed to its base and to its star."""

    #: {0k} in the base, shape (3, 3, 3), Eqs. (32), (36).
    R_0: Array
    #: {E} in {3k}, shape (3, 3, 3), Eqs. (30), (31), (35).
    R_E: Array

    @property
    def e(self) -> Array:
        """Actuated axes e_k in the base, rows."""
        return self.R_0[:, :, 2]

    @property
    def arc_normals(self) -> Array:
        """n_k in {E}, rows: the last row of each R_E."""
        return self.R_E[:, 2, :]


class Legs(NamedTuple):
    """Axes of the three legs in the base, each shape (..., 3, 3): leg, then component."""

    #: e_{k+3}, along OR_k.
    u: Array
    #: e_{k+6}, normal of arc k.
    n: Array
    #: y axis of {1k}, e_k x u.
    y_1: Array
    #: y axis of {2k}, n x u.
    y_2: Array
    #: OE, the x axis of {3k}.
    s: Array
    #: Shape (..., 3), as cos_mu.
    sin_mu: Array
    cos_mu: Array


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("...i,...i->...", a, b)


def legs_of_orientation(geometry: Geometry, R: Array, branch: ArrayLike) -> Legs:
    """Axes of the legs that carry the star at R, shape (..., 3, 3), with signs of sin(mu_k)."""
    u = np.cross(geometry.e, geometry.arc_normals @ R.mT)
    length = np.linalg.norm(u, axis=-1)
    if (flat := length < _FLAT).any():
        k = int(np.argwhere(flat)[0, -1]) + 1
        problem = (
            f"leg {k} is in the plane of its arc (sin mu_{k} = 0), gamma_{k} is not determined"
        )
        error = SingularConfigurationError(problem, 1 / max(float(length.min()), 1e-300))
        raise of_samples(error, flat.any(axis=-1))
    return _legs(geometry, u * (np.asarray(branch, dtype=float) / length)[..., None], R)


def legs_of_joints(geometry: Geometry, q: Array) -> Legs:
    """Axes of the legs at joint coordinates of shape (..., 9)."""
    angles = q.reshape(*q.shape[:-1], 3, 3)
    (c, c_mu, c_beta), (s, s_mu, s_beta) = (
        np.moveaxis(f(angles), -1, 0)[..., None] for f in (np.cos, np.sin)
    )
    x_0, y_0, e = np.moveaxis(geometry.R_0, -1, 0)
    u = c * x_0 + s * y_0
    y_1 = c * y_0 - s * x_0
    n = c_mu * e - s_mu * y_1
    y_2 = c_mu * y_1 + s_mu * e
    return Legs(u, n, y_1, y_2, c_beta * u + s_beta * y_2, s_mu[..., 0], c_mu[..., 0])


def _legs(geometry: Geometry, u: Array, R: Array) -> Legs:
    """Axes of the legs that carry the star at R, with passive axes u."""
    R_3 = R[..., None, :, :] @ geometry.R_E.mT
    y_1 = np.cross(geometry.e, u)
    s, n = R_3[..., 0], R_3[..., 2]
    return Legs(u, n, y_1, np.cross(n, u), s, -_dot(n, y_1), _dot(n, geometry.e))


def joints_of_legs(geometry: Geometry, legs: Legs) -> Array:
    """gamma_k, mu_k, beta_k in (-pi, pi], shape (..., 9)."""
    x_0, y_0 = geometry.R_0[:, :, 0], geometry.R_0[:, :, 1]
    gamma = np.arctan2(_dot(legs.u, y_0), _dot(legs.u, x_0))
    mu = np.arctan2(legs.sin_mu, legs.cos_mu)
    beta = np.arctan2(_dot(legs.s, legs.y_2), _dot(legs.s, legs.u))
    return np.stack([gamma, mu, beta], axis=-1).reshape(*gamma.shape[:-1], 9)


def passive_axes(geometry: Geometry, gamma: Array) -> Array:
    """e_{k+3} in the base, rows, for motor angles, shape (..., 3)."""
    x_0, y_0 = geometry.R_0[:, :, 0], geometry.R_0[:, :, 1]
    return np.cos(gamma)[..., None] * x_0 + np.sin(gamma)[..., None] * y_0


def joints_of_actuated(geometry: Geometry, gamma: Array, R: Array) -> Array:
    """q, shape (..., 9), for motor angles and orientations that fit them, in any branch."""
    u = np.broadcast_to(passive_axes(geometry, gamma), R.shape)
    q = joints_of_legs(geometry, _legs(geometry, u, R))
    q[..., ::3] = gamma
    return q


def orientation_of_joints(geometry: Geometry, q: Array) -> Array:
    """{E} in the base by leg 1, shape (..., 3, 3), Eqs. (26), (30)."""
    legs = legs_of_joints(geometry, q)
    return _orientation(geometry, legs.s[..., 0, :], legs.n[..., 0, :])


def home_orientation(geometry: Geometry) -> Array:
    """{E} in the base, shape (3, 3): s in the middle of the base triangle, R_1 in that of P1P2."""
    v = geometry.R_0[:, :, 0]
    e_1 = geometry.e[0]
    s = v.sum(axis=0)
    s /= np.linalg.norm(s)
    middle = v[0] / np.linalg.norm(v[0]) + v[1] / np.linalg.norm(v[1])
    n = np.cross(middle, s)
    n /= np.linalg.norm(n)
    if n @ np.cross(e_1, middle) > 0:  # sin(mu_1) = -n . y_1 must be positive
        n = -n
    return _orientation(geometry, s, n)


def home_configuration(geometry: Geometry) -> Array:
    """The joints at `home_orientation`, shape (9,)."""
    legs = legs_of_orientation(geometry, home_orientation(geometry), (1, 1, 1))
    return joints_of_legs(geometry, legs)


def _orientation(geometry: Geometry, s: Array, n: Array) -> Array:
    """{E} in the base by the x and z axes of {3, 1}."""
    return np.stack([s, np.cross(n, s), n], axis=-1) @ geometry.R_E[0]


def joint_rates(legs: Legs, omega: Array) -> Array:
    """Rates of all joints from the star's angular velocity in base axes, shape (..., 9).

    In the axes of {2k}, omega = (mu_dot, gamma_dot sin(mu), gamma_dot cos(mu) + beta_dot), where
    sin(mu) must not be zero. omega may differ between the legs, shape (..., 3, 3).
    """
    w = omega[..., None, :] if omega.ndim < legs.u.ndim else omega
    gamma_dot = _dot(w, legs.y_2) / legs.sin_mu
    mu_dot = _dot(w, legs.u)
    beta_dot = _dot(w, legs.n) - gamma_dot * legs.cos_mu
    return np.stack([gamma_dot, mu_dot, beta_dot], axis=-1).reshape(*gamma_dot.shape[:-1], 9)


def joint_accelerations(geometry: Geometry, legs: Legs, q_dot: Array, alpha: Array) -> Array:
    """Accelerations of all joints, shape (..., 9), from the star's, alpha in base axes."""
    rates = q_dot.reshape(*q_dot.shape[:-1], 3, 3)
    gamma_dot, mu_dot, beta_dot = (rates[..., i, None] for i in range(3))
    # The axes e_{k+3} and e_{k+6} turn with the links that carry them.
    turning = gamma_dot * mu_dot * legs.y_1 + beta_dot * np.cross(
        gamma_dot * geometry.e + mu_dot * legs.u, legs.n
    )
    return joint_rates(legs, alpha[..., None, :] - turning)


def require_rotation(R: Array, name: str = "R") -> None:
    """Check that matrices are rotations; the error names the samples of a batch."""
    error = np.abs(R @ np.swapaxes(R, -1, -2) - np.eye(3)).max(axis=(-1, -2))
    wrong = (error > 1e-8) | (np.linalg.det(R) < 0)
    if wrong.any():
        size = float(error.max())
        det = float(np.linalg.det(R).min())
        words = f"not a rotation matrix (|R R^T - 1| = {size:.3g}, det R = {det:.3g})"
        raise of_samples(InputError(name, words), wrong)
