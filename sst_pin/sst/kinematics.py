# SPDX-License-Identifier: BSD-2-Clause
"""Closed-form kinematics of the SST, vectorised over leading axes: Sects. 2 and 4.

Leg k is Rot(z, gamma_k) Rot(x, mu_k) Rot(z, beta_k) from {0k} to {3k}, Eqs. (26)-(29). The leg
depends only on the normal n_k = e_{k+6} of its arc's plane, the z axis of {3k}. The passive axis
e_{k+3} goes from O to R_k, the point of leg k on the base triangle. It is normal to e_k and n_k, so
R_k is one of two antipodal points: the sign of sin(mu_k) is the branch of the leg.
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
#: Largest entry of |R R^T - 1| of a rotation that is written with eight digits.
_ROUNDED_ROTATION = 1e-8


class Geometry(NamedTuple):
    """Geometry of an SST: orientations of the frames fixed to its base and to its star.

    Both arrays have an orientation for each leg k. "A in B" has the axes of A in the axes of B as
    columns.
    """

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
    #: sin(mu_k), shape (..., 3).
    sin_mu: Array
    #: cos(mu_k), shape (..., 3).
    cos_mu: Array


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("...i,...i->...", a, b)


def legs_of_orientation(geometry: Geometry, R: Array, branch: ArrayLike) -> Legs:
    """Axes of the legs that carry the star at R, shape (..., 3, 3).

    `branch` has the signs of sin(mu_k), shape (..., 3).
    """
    # The passive axis is normal to e_k and to the arc's normal n_k, which the star carries.
    u = np.cross(geometry.e, geometry.arc_normals @ R.mT)
    length = np.linalg.norm(u, axis=-1)
    is_flat = length < _FLAT
    if is_flat.any():
        k = int(np.argwhere(is_flat)[0, -1]) + 1
        problem = (
            f"leg {k} is in the plane of its arc (sin mu_{k} = 0), gamma_{k} is not determined"
        )
        error = SingularConfigurationError(problem, 1 / max(float(length.min()), 1e-300))
        raise of_samples(error, is_flat.any(axis=-1))
    signs = np.asarray(branch, dtype=float)
    return _legs_of_passive_axes(geometry, u * (signs / length)[..., None], R)


def legs_of_joints(geometry: Geometry, q: Array) -> Legs:
    """Axes of the legs at joint coordinates of shape (..., 9)."""
    angles = q.reshape(*q.shape[:-1], 3, 3)  # leg, joint
    cosines = np.cos(angles)[..., None]
    sines = np.sin(angles)[..., None]
    cos_gamma = cosines[..., 0, :]
    cos_mu = cosines[..., 1, :]
    cos_beta = cosines[..., 2, :]
    sin_gamma = sines[..., 0, :]
    sin_mu = sines[..., 1, :]
    sin_beta = sines[..., 2, :]
    x_0 = geometry.R_0[:, :, 0]
    y_0 = geometry.R_0[:, :, 1]
    # Rot(z, gamma_k), Rot(x, mu_k), Rot(z, beta_k) one after the other, Eqs. (26)-(29).
    u = cos_gamma * x_0 + sin_gamma * y_0
    y_1 = cos_gamma * y_0 - sin_gamma * x_0
    n = cos_mu * geometry.e - sin_mu * y_1
    y_2 = cos_mu * y_1 + sin_mu * geometry.e
    return Legs(
        u=u,
        n=n,
        y_1=y_1,
        y_2=y_2,
        s=cos_beta * u + sin_beta * y_2,
        sin_mu=sin_mu[..., 0],
        cos_mu=cos_mu[..., 0],
    )


def _legs_of_passive_axes(geometry: Geometry, u: Array, R: Array) -> Legs:
    """Axes of the legs that carry the star at R, with passive axes u, shape (..., 3, 3)."""
    R_3 = R[..., None, :, :] @ geometry.R_E.mT  # {3k} in the base
    s = R_3[..., 0]
    n = R_3[..., 2]
    y_1 = np.cross(geometry.e, u)
    return Legs(
        u=u,
        n=n,
        y_1=y_1,
        y_2=np.cross(n, u),
        s=s,
        sin_mu=-_dot(n, y_1),
        cos_mu=_dot(n, geometry.e),
    )


def joints_of_legs(geometry: Geometry, legs: Legs) -> Array:
    """gamma_k, mu_k, beta_k in (-pi, pi], shape (..., 9)."""
    x_0 = geometry.R_0[:, :, 0]
    y_0 = geometry.R_0[:, :, 1]
    gamma = np.arctan2(_dot(legs.u, y_0), _dot(legs.u, x_0))
    mu = np.arctan2(legs.sin_mu, legs.cos_mu)
    beta = np.arctan2(_dot(legs.s, legs.y_2), _dot(legs.s, legs.u))
    return np.stack([gamma, mu, beta], axis=-1).reshape(*gamma.shape[:-1], 9)


def passive_axes(geometry: Geometry, gamma: Array) -> Array:
    """e_{k+3} in the base, rows, for motor angles, shape (..., 3)."""
    x_0 = geometry.R_0[:, :, 0]
    y_0 = geometry.R_0[:, :, 1]
    return np.cos(gamma)[..., None] * x_0 + np.sin(gamma)[..., None] * y_0


def joints_of_actuated(geometry: Geometry, gamma: Array, R: Array) -> Array:
    """q, shape (..., 9), for motor angles and orientations that fit them, in any branch."""
    u = np.broadcast_to(passive_axes(geometry, gamma), R.shape)
    q = joints_of_legs(geometry, _legs_of_passive_axes(geometry, u, R))
    q[..., ::3] = gamma
    return q


def orientation_of_joints(geometry: Geometry, q: Array) -> Array:
    """{E} in the base by leg 1, shape (..., 3, 3), Eqs. (26), (30)."""
    legs = legs_of_joints(geometry, q)
    return _orientation(geometry, legs.s[..., 0, :], legs.n[..., 0, :])


def home_orientation(geometry: Geometry) -> Array:
    """{E} in the base at home, shape (3, 3).

    s points to the middle of the base triangle, and the point R_1 of leg 1 is in the middle of the
    side P_1 P_2 of this triangle.
    """
    v = geometry.R_0[:, :, 0]  # from O to P_k, rows
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
    """{E} in the base by the axes s and n of leg 1, the x and z axes of its frame {3k}."""
    return np.stack([s, np.cross(n, s), n], axis=-1) @ geometry.R_E[0]


def joint_rates(legs: Legs, omega: Array) -> Array:
    """Rates of all joints, shape (..., 9), from the star's angular velocity in base axes, (..., 3).

    sin(mu_k) must not be zero.
    """
    return _along_joint_axes(legs, omega[..., None, :])


def joint_accelerations(geometry: Geometry, legs: Legs, q_dot: Array, alpha: Array) -> Array:
    """Accelerations of all joints, shape (..., 9), from the star's angular acceleration alpha.

    alpha is in base axes, shape (..., 3); q_dot are the rates of all joints, shape (..., 9).
    """
    rates = q_dot.reshape(*q_dot.shape[:-1], 3, 3)  # leg, joint
    gamma_dot = rates[..., 0, None]
    mu_dot = rates[..., 1, None]
    beta_dot = rates[..., 2, None]
    # omega = gamma_dot e_k + mu_dot u + beta_dot n. The axes u and n turn with the links that carry
    # them, so alpha = gamma_ddot e_k + mu_ddot u + beta_ddot n + mu_dot u_dot + beta_dot n_dot.
    u_dot = gamma_dot * legs.y_1
    n_dot = np.cross(gamma_dot * geometry.e + mu_dot * legs.u, legs.n)
    without_accelerations = mu_dot * u_dot + beta_dot * n_dot
    return _along_joint_axes(legs, alpha[..., None, :] - without_accelerations)


def _along_joint_axes(legs: Legs, vectors: Array) -> Array:
    """Factors a, b, c with vector = a e_k + b u + c n for each leg, shape (..., 9).

    The vectors are in base axes, shape (..., 3, 3) with one for each leg, or (..., 1, 3) with one
    for all. In the axes of {2k} such a vector is (b, a sin(mu_k), a cos(mu_k) + c).
    """
    a = _dot(vectors, legs.y_2) / legs.sin_mu
    b = _dot(vectors, legs.u)
    c = _dot(vectors, legs.n) - a * legs.cos_mu
    return np.stack([a, b, c], axis=-1).reshape(*a.shape[:-1], 9)


def require_rotation(R: Array, name: str = "R") -> None:
    """Check that matrices are rotations; the error names the samples of a batch."""
    error = np.abs(R @ R.mT - np.eye(3)).max(axis=(-1, -2))
    wrong = (error > _ROUNDED_ROTATION) | (np.linalg.det(R) < 0)
    if wrong.any():
        size = float(error.max())
        det = float(np.linalg.det(R).min())
        words = f"not a rotation matrix (|R R^T - 1| = {size:.3g}, det R = {det:.3g})"
        raise of_samples(InputError(name, words), wrong)
