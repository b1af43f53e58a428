# SPDX-License-Identifier: BSD-2-Clause
"""Equations of motion in the actuated coordinates, Eqs. (63)-(96), one configuration.

The long form assembles every term of Eq. (92) from K, T, M and Omega, to be seen and tested. The
short form is the same equation with q_dot = L q_dot^a and q_ddot = L q_ddot^a + L_dot q_dot^a put
into the tree's inverse dynamics: tau^a = L^T (RNEA(q, q_dot, q_ddot) - tau^f - K^T w).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.linalg.lapack import dposv

from ..errors import SingularConfigurationError
from .closures import LoopKinematics
from .noc import JointComplement, bodies, body_jacobians, independent_rows

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Terms:
    """Every matrix of Eq. (92): tau = inertia aa + coriolis va - gravity - friction.

    m joints, n of them actuated, r bodies; SI units, base axes, twists [omega; v] at mass centres.

    Attributes:
        Phi: Independent rows of the closures' Jacobian, shape (m - n, m), Eqs. (3), (5).
        L: Joint orthogonal complement, shape (m, n), Eq. (17).
        L_dot: Its rate, shape (m, n), Eq. (20).
        K: Body Jacobians, shape (6 r, m), Eq. (12).
        K_dot: Their rate, shape (6 r, m), Eq. (15).
        T: Natural orthogonal complement, shape (6 r, n), Eqs. (22), (23).
        T_dot: Its rate, shape (6 r, n), Eq. (25).
        M: Stacked mass matrix, shape (6 r, 6 r), Eq. (69).
        Omega: Stacked angular velocities, shape (6 r, 6 r), Eq. (70).
        inertia: Generalised inertia matrix, shape (n, n), Eq. (93).
        coriolis: Matrix of Coriolis and centrifugal terms, shape (n, n), Eq. (94).
        gravity: Generalised weight tau^g, shape (n,), Eq. (95).
        friction: Generalised friction L^T tau^f, opposing the rates, shape (n,), Eq. (96).
    """

    Phi: Array
    L: Array
    L_dot: Array
    K: Array
    K_dot: Array
    T: Array
    T_dot: Array
    M: Array
    Omega: Array
    inertia: Array
    coriolis: Array
    gravity: Array
    friction: Array


class ReducedTerms(NamedTuple):
    """tau = inertia aa + coriolis va - gravity - friction, Eq. (92), for a batch.

    Attributes:
        inertia: Shape (..., n, n), Eq. (93).
        coriolis: Shape (..., n, n), Eq. (94).
        gravity: Shape (..., n), Eq. (95).
        friction: Shape (..., n), Eq. (96).
    """

    inertia: Array
    coriolis: Array
    gravity: Array
    friction: Array

    @classmethod
    def of_rows(cls, rows: Array, n: int) -> ReducedTerms:
        """From all numbers of a sample in a row, shape (..., 2 n (n + 1))."""
        inertia, coriolis, gravity, friction = np.split(
            rows, [n * n, 2 * n * n, 2 * n * n + n], axis=-1
        )
        square = (*rows.shape[:-1], n, n)
        return cls(inertia.reshape(square), coriolis.reshape(square), gravity, friction)


@dataclass(frozen=True)
class Friction:
    """Viscous and Coulomb friction of all joints.

    Attributes:
        viscous: D, shape (m,), [N m s/rad] or [N s/m].
        coulomb: F_c, shape (m,), [N m] or [N].
        sign_width: Rate at which the Coulomb term has risen to 76 %: sign(x) becomes
            tanh(x / sign_width); 0 keeps the sign.
    """

    viscous: Array
    coulomb: Array
    sign_width: float = 0.0

    @cached_property
    def none(self) -> bool:
        """Whether no joint has any."""
        return not (self.viscous.any() or self.coulomb.any())

    def forces(self, q_dot: Array) -> Array:
        """tau^f = -(D q_dot + F_c sign q_dot), Eqs. (87)-(89), with the sign that dissipates."""
        sign = np.tanh(q_dot / self.sign_width) if self.sign_width else np.sign(q_dot)
        return -(self.viscous * q_dot + self.coulomb * sign)


def motion_of_tree(
    kinematics: LoopKinematics, complement: JointComplement, q: Array, va: Array, aa: Array
) -> tuple[Array, Array, Array]:
    """L, q_dot and q_ddot of a motion of the motors, for kinematics whose position is set."""
    L = complement.factorise(kinematics.Phi())
    q_dot = L.dot(va)  # Eq. (16)
    kinematics.set_velocity(q, q_dot)
    # The rate of Phi q_dot = 0, Eqs. (8), (20): Phi q_ddot = -Phi_dot q_dot.
    q_ddot = complement.solve(-kinematics.Phi_dot(q_dot).dot(q_dot), aa)
    return L, q_dot, q_ddot


def inverse_dynamics(
    kinematics: LoopKinematics,
    complement: JointComplement,
    friction: Friction,
    q: Array,
    va: Array,
    aa: Array,
    wrenches: Array | None,
) -> Array:
    """Motor torques tau^a of Eq. (92), short form, shape (n,).

    Args:
        kinematics: With its position set to q.
        complement: Workspace of the constraints.
        friction: Of all joints.
        q: Joint coordinates, shape (m,).
        va: Actuated rates, shape (n,).
        aa: Actuated accelerations, shape (n,).
        wrenches: External [moment; force] on each body at its mass centre, base axes, shape
            (r, 6), or None.
    """
    L, q_dot, q_ddot = motion_of_tree(kinematics, complement, q, va, aa)
    tau_tree = pin.rnea(kinematics.model, kinematics.data, q, q_dot, q_ddot)
    if not friction.none:
        tau_tree = tau_tree - friction.forces(q_dot)
    if wrenches is not None:
        K = body_jacobians(kinematics.model, kinematics.data)
        tau_tree = tau_tree - wrenches.ravel().dot(K)
    return tau_tree.dot(L)


def direct_dynamics(
    kinematics: LoopKinematics,
    complement: JointComplement,
    friction: Friction,
    q: Array,
    va: Array,
    tau: Array,
    wrenches: Array | None,
) -> tuple[Array, Array]:
    """Actuated accelerations from Eq. (92), and q_dot = L va; arguments as `inverse_dynamics`.

    Raises:
        SingularConfigurationError: When the inertia matrix is not positive definite.
    """
    L, q_dot, bias = motion_of_tree(kinematics, complement, q, va, np.zeros_like(va))
    model, data = kinematics.model, kinematics.data
    force = -pin.rnea(model, data, q, q_dot, bias)
    if not friction.none:
        force += friction.forces(q_dot)
    if wrenches is not None:
        force += wrenches.ravel().dot(body_jacobians(model, data))
    inertia = L.T.dot(pin.crba(model, data, q)).dot(L)  # Eq. (93)
    _, aa, info = dposv(inertia, tau + force.dot(L))
    if info:
        raise SingularConfigurationError(
            "the generalised inertia matrix is not positive definite: "
            "some motor moves no mass at this configuration",
            float(np.linalg.cond(inertia)),
        )
    return aa, q_dot


def terms(
    kinematics: LoopKinematics, complement: JointComplement, friction: Friction, q: Array, va: Array
) -> Terms:
    """All matrices of Eq. (92), long form; arguments as `inverse_dynamics`."""
    Phi = kinematics.Phi()
    L = complement.factorise(Phi)
    q_dot = L @ va  # Eq. (16)
    kinematics.set_velocity(q, q_dot)
    L_dot = complement.solve(-kinematics.Phi_dot(q_dot) @ L, np.zeros((len(va), len(va))))
    K, K_dot, M, Omega, w_g = bodies(kinematics.model, kinematics.data, q_dot)
    T = K @ L  # Eq. (22)
    T_dot = K_dot @ L + K @ L_dot  # Eq. (25)
    # Rotors geared to a joint (model.armature) are no bodies of the paper; RNEA counts them too.
    rotors = L.T * kinematics.model.armature
    return Terms(
        Phi=Phi[independent_rows(Phi)],
        L=L,
        L_dot=L_dot,
        K=K,
        K_dot=K_dot,
        T=T,
        T_dot=T_dot,
        M=M,
        Omega=Omega,
        inertia=T.T @ M @ T + rotors @ L,  # Eq. (93)
        coriolis=T.T @ M @ T_dot + T.T @ Omega @ M @ T + rotors @ L_dot,  # Eq. (94)
        gravity=T.T @ w_g,  # Eq. (95)
        friction=L.T @ friction.forces(q_dot),  # Eq. (96)
    )
