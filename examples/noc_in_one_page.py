# SPDX-License-Identifier: BSD-2-Clause
"""The natural orthogonal complement on one page: Pinocchio, NumPy and the letters of the paper.

The method is that of A. Akbarzadeh, J. Enferadi and M. Sharifnia (2012); it holds for any tree with
closures. A closure is (frame, frame, 3) where two points coincide, (frame, frame, 6) for a weld.
"""

import numpy as np
import pinocchio as pin

AXES = pin.LOCAL_WORLD_ALIGNED  # vectors in base axes


def closure_jacobian(model, closures, q):
    """Phi, Eq. (4): the loops stay closed if Phi q_dot = 0."""
    data, rows = model.createData(), []
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    for a, b, size in closures:
        J_a, J_b = (pin.getFrameJacobian(model, data, model.getFrameId(f), AXES) for f in (a, b))
        rows.append((J_b - J_a)[:size])
    return np.vstack(rows)


def complement(model, closures, actuated, q):
    """L, Eq. (17): q_dot = L va, where va are the rates of the actuated joints."""
    Phi, n = closure_jacobian(model, closures, q), len(actuated)
    passive = np.setdiff1d(np.arange(model.nv), actuated)
    L = np.zeros((model.nv, n))
    L[actuated] = np.eye(n)
    L[passive] = -np.linalg.pinv(Phi[:, passive], 1e-5) @ Phi[:, actuated]  # redundant rows too
    return L


def body_jacobians(model, q):
    """K, Eqs. (9)-(14): twists t = K q_dot, [omega; v] of each mass centre; and M, Eq. (69)."""
    data, K, M = model.createData(), [], np.zeros((6 * (model.njoints - 1),) * 2)
    pin.computeJointJacobians(model, data, q)
    for i in range(1, model.njoints):
        body, R = model.inertias[i], data.oMi[i].rotation
        J_v, J_w = np.split(pin.getJointJacobian(model, data, i, AXES), 2)
        K += [J_w, J_v - pin.skew(R @ body.lever) @ J_w]
        M[6 * i - 6 : 6 * i - 3, 6 * i - 6 : 6 * i - 3] = R @ body.inertia @ R.T
        M[6 * i - 3 : 6 * i, 6 * i - 3 : 6 * i] = body.mass * np.eye(3)
    return np.vstack(K), M


def torques(model, closures, actuated, q, va, aa, h=1e-4):
    """Eq. (92): tau = I aa + C va - tau^g - tau^f; T_dot, Eq. (25), by differences."""
    L, (K, M) = complement(model, closures, actuated, q), body_jacobians(model, q)
    T, q_dot, Omega, w_g = K @ L, L @ va, np.zeros_like(M), np.zeros(len(M))  # Eqs. (22), (16)
    near = [pin.integrate(model, q, k * h * q_dot) for k in (-2, -1, 1, 2)]
    T_near = [body_jacobians(model, x)[0] @ complement(model, closures, actuated, x) for x in near]
    T_dot = (T_near[0] - 8 * T_near[1] + 8 * T_near[2] - T_near[3]) / (12 * h)
    for i, omega in zip(range(0, len(M), 6), (T @ va).reshape(-1, 6)[:, :3], strict=True):
        Omega[i : i + 3, i : i + 3] = pin.skew(omega)  # Eqs. (66), (67)
        w_g[i + 3 : i + 6] = M[i + 3, i + 3] * model.gravity.linear
    inertia, C = T.T @ M @ T, T.T @ (M @ T_dot + Omega @ M @ T)  # Eqs. (93), (94)
    tau_f = -L.T @ (model.damping * q_dot + model.friction * np.sign(q_dot))  # Eqs. (87), (96)
    return inertia @ aa + C @ va - T.T @ w_g - tau_f  # tau^g = T^T w^g, Eq. (95)
