# SPDX-License-Identifier: BSD-2-Clause
"""The methods of docs/cost.md, written once for any kind of number: floats, or those that count."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import sst_pin
from sst_pin.sst import kinematics

Array = NDArray[Any]  # of numbers of any kind

# --- linear systems -------------------------------------------------------------------------------


class LU:
    """Gauss's elimination with row pivots.

    Args:
        matrix: Shape (n, n).
    """

    def __init__(self, matrix: Array) -> None:
        self._A, n = matrix.copy(), len(matrix)
        self._order = np.arange(n)
        A = self._A
        for k in range(n):
            pivot = k + int(np.argmax([abs(float(x)) for x in A[k:, k]]))
            A[[k, pivot]], self._order[[k, pivot]] = A[[pivot, k]], self._order[[pivot, k]]
            for i in range(k + 1, n):
                A[i, k] = A[i, k] / A[k, k]
                A[i, k + 1 :] = A[i, k + 1 :] - A[i, k] * A[k, k + 1 :]

    def solve(self, right: Array) -> Array:
        """x with A x = right, for a vector or for columns side by side."""
        A, x = self._A, right[self._order]
        for i in range(len(A)):
            for j in range(i):
                x[i] = x[i] - A[i, j] * x[j]
        return _back(A, x)

    def solve_transposed(self, right: Array) -> Array:
        """x with A^T x = right."""
        A, x, n = self._A, right.copy(), len(self._A)
        for i in range(n):
            for j in range(i):
                x[i] = x[i] - A[j, i] * x[j]
            x[i] = x[i] / A[i, i]
        for i in reversed(range(n)):
            for j in range(i + 1, n):
                x[i] = x[i] - A[j, i] * x[j]
        back = x.copy()
        back[self._order] = x
        return back


def solve_cholesky(matrix: Array, right: Array) -> Array:
    """x with A x = right for a positive definite A; right is a vector."""
    n, G, x = len(matrix), matrix.copy(), right.copy()
    for j in range(n):
        for k in range(j):
            G[j:, j] = G[j:, j] - G[j:, k] * G[j, k]
        G[j, j] = np.sqrt(G[j, j : j + 1])[0]
        G[j + 1 :, j] = G[j + 1 :, j] / G[j, j]
    for i in range(n):
        for j in range(i):
            x[i] = x[i] - G[i, j] * x[j]
        x[i] = x[i] / G[i, i]
    return _back(G.T, x)


def _back(upper: Array, x: Array) -> Array:
    for i in reversed(range(len(x))):
        for j in range(i + 1, len(x)):
            x[i] = x[i] - upper[i, j] * x[j]
        x[i] = x[i] / upper[i, i]
    return x


# --- the robot and its tree -----------------------------------------------------------------------

#: Columns of the passive joints. Legs 2 and 3 come first, so that elimination stays in their own
#: closures before it meets leg 1, which stands in both.
PASSIVE = np.array([4, 5, 7, 8, 1, 2])
ACTUATED = np.array([0, 3, 6])
#: Joints that move actuator links, passive links and star, which hangs on leg 1.
SUPPORTS = ([0], [3], [6], [0, 1], [3, 4], [6, 7], [0, 1, 2])


class Robot(NamedTuple):
    """What a method needs to know beforehand; bodies are three links, three passive links, star.

    Attributes:
        unit: The 3 x 3 unit matrix, source of structural zeros and ones.
        R_0: {0k} in the base.
        R_E: {E} in {3k}.
        mass: Shape (7, 1).
        center: Mass centres in the bodies, shape (7, 3).
        inertia: About the mass centres, shape (7, 3, 3).
        gravity: Shape (3,).
    """

    unit: Array
    R_0: Array
    R_E: Array
    mass: Array
    center: Array
    inertia: Array
    gravity: Array

    @classmethod
    def of(cls, p: sst_pin.Parameters) -> Robot:
        """The robot of some parameters, friction left out."""
        bodies = (*p.links, *p.passive_links, p.star)
        return cls(
            np.eye(3),
            *sst_pin.SST(p).geometry,
            np.array([[body.mass] for body in bodies]),
            np.array([body.center_of_mass for body in bodies]),
            np.array([body.inertia for body in bodies]),
            p.gravity,
        )

    @property
    def geometry(self) -> kinematics.Geometry:
        """What the package's kinematics asks for."""
        return kinematics.Geometry(self.R_0, self.R_E)

    def zeros(self, *shape: int) -> Array:
        """Structural zeros."""
        return np.full(shape, self.unit[0, 1])


def joint_motion(robot: Robot, R: Array, omega: Array, alpha: Array) -> tuple[Array, Array, Array]:
    """The inverse kinematics, `SST.joint_motion`."""
    legs = kinematics.legs_of_orientation(robot.geometry, R, (1, 1, 1))
    q = kinematics.joints_of_legs(robot.geometry, legs)
    q_dot = kinematics.joint_rates(legs, omega)
    q_ddot = kinematics.joint_accelerations(robot.geometry, legs, q_dot, alpha)
    return q, q_dot[ACTUATED], q_ddot[ACTUATED]


class Tree(NamedTuple):
    """Placements: joint axes (9, 3), body frames (7, 3, 3) and mass centres (7, 3)."""

    axes: Array
    frames: Array
    centers: Array


def tree_at(robot: Robot, q: Array) -> Tree:
    legs = kinematics.legs_of_joints(robot.geometry, q)
    e, u, n = robot.geometry.e, legs.u, legs.n
    links, passive = np.stack([u, legs.y_1, e], axis=-1), np.stack([u, legs.y_2, n], axis=-1)
    star = np.stack([legs.s[0], np.cross(n[0], legs.s[0]), n[0]], axis=-1) @ robot.R_E[0]
    frames = np.concatenate([links, passive, star[None]])
    axes = np.stack([e, u, n], axis=1).reshape(9, 3)
    return Tree(axes, frames, _times(frames, robot.center))


def axis_rates(robot: Robot, tree: Tree, q_dot: Array) -> tuple[Array, Array]:
    """Rates of the joint axes (9, 3) and angular velocities of links and passive links (6, 3)."""
    (e, u, n), (gamma_dot, mu_dot, _) = _by_kind(tree.axes), _by_kind(q_dot[:, None])
    link = gamma_dot * e
    passive = link + mu_dot * u
    rates = np.stack([robot.zeros(3, 3), np.cross(link, u), np.cross(passive, n)], axis=1)
    return rates.reshape(9, 3), np.concatenate([link, passive])


def closures(robot: Robot, columns: Array) -> Array:
    """Phi from the axes, or its rate from theirs: the star turns alike on all legs, (6, 9)."""
    Phi, (leg_1, leg_2, leg_3) = robot.zeros(6, 9), columns.reshape(3, 3, 3)
    Phi[:3, :3] = Phi[3:, :3] = leg_1.T
    Phi[:3, 3:6], Phi[3:, 6:] = -leg_2.T, -leg_3.T
    return Phi


def _by_kind(joints: Array) -> Array:
    """Rows for all gamma, all mu and all beta."""
    return joints.reshape(3, 3, -1).swapaxes(0, 1)


def _times(matrices: Array, vectors: Array) -> Array:
    return (matrices @ vectors[..., None])[..., 0]


def _dot(a: Array, b: Array) -> Array:
    return (a * b).sum(axis=-1, keepdims=True)


def skew(unit: Array, a: Array) -> Array:
    """Cross-product matrix, its zeros those of the unit matrix."""
    zero = unit[0, 1]
    return np.array([[zero, -a[2], a[1]], [a[2], zero, -a[0]], [-a[1], a[0], zero]])


# --- natural orthogonal complement, long form: Eqs. (17)-(25), (66)-(70), (91)-(95) ---------------


def complement(robot: Robot, factors: LU, right: Array, actuated: Array) -> Array:
    """[x^a; x^u] with Phi^u x^u = right, joints in the order of the tree."""
    x = robot.zeros(9, *right.shape[1:])
    x[ACTUATED], x[PASSIVE] = actuated, factors.solve(right)
    return x


def equations_of_motion(robot: Robot, q: Array, va: Array) -> tuple[Array, Array, Array]:
    """Inertia, Coriolis matrix and gravity of Eq. (92), from K, T, M and Omega."""
    tree = tree_at(robot, q)
    Phi = closures(robot, tree.axes)
    factors = LU(Phi[:, PASSIVE])
    L = complement(robot, factors, -Phi[:, ACTUATED], robot.unit)  # Eq. (17)
    q_dot = L @ va  # Eq. (16)
    axes_dot, _ = axis_rates(robot, tree, q_dot)
    Phi_dot = closures(robot, axes_dot)
    L_dot = complement(robot, factors, -(Phi_dot @ L), robot.zeros(3, 3))

    K, K_dot = robot.zeros(7, 6, 9), robot.zeros(7, 6, 9)
    for i, joints in enumerate(SUPPORTS):  # Eqs. (56)-(62)
        K[i, :3, joints] = tree.axes[joints]
        K[i, 3:, joints] = np.cross(tree.axes[joints], tree.centers[i])
    t = K @ q_dot  # Eq. (12)
    for i, joints in enumerate(SUPPORTS):  # Eq. (15)
        K_dot[i, :3, joints] = axes_dot[joints]
        turning = np.cross(axes_dot[joints], tree.centers[i])
        K_dot[i, 3:, joints] = turning + np.cross(tree.axes[joints], t[i, 3:])

    M, Omega, w_g = robot.zeros(7, 6, 7, 6), robot.zeros(7, 6, 7, 6), robot.zeros(7, 6)
    for i, (frame, inertia, mass) in enumerate(
        zip(tree.frames, robot.inertia, robot.mass[:, 0], strict=True)
    ):  # Eq. (67)
        M[i, :3, i, :3] = frame @ inertia @ frame.T
        M[i, range(3, 6), i, range(3, 6)] = mass
        Omega[i, :3, i, :3] = skew(robot.unit, t[i, :3])
        w_g[i, 3:] = mass * robot.gravity
    K, K_dot, w_g = K.reshape(42, 9), K_dot.reshape(42, 9), w_g.reshape(42)
    M, Omega = M.reshape(42, 42), Omega.reshape(42, 42)

    T = K @ L  # Eq. (22)
    T_dot = K_dot @ L + K @ L_dot  # Eq. (25)
    inertia = T.T @ M @ T  # Eq. (93)
    coriolis = T.T @ M @ T_dot + T.T @ Omega @ M @ T  # Eq. (94)
    return inertia, coriolis, T.T @ w_g  # Eq. (95)


def torques_long(robot: Robot, q: Array, va: Array, aa: Array) -> Array:
    inertia, coriolis, gravity = equations_of_motion(robot, q, va)
    return inertia @ aa + coriolis @ va - gravity


def accelerations_long(robot: Robot, q: Array, va: Array, tau: Array) -> Array:
    inertia, coriolis, gravity = equations_of_motion(robot, q, va)
    return solve_cholesky(inertia, tau - coriolis @ va + gravity)


# --- natural orthogonal complement, short form: L^T RNEA ------------------------------------------


class Motion(NamedTuple):
    """A motion of the tree's joints."""

    L: Array
    q_dot: Array
    q_ddot: Array
    axes_dot: Array
    omega: Array


def motion_of_tree(robot: Robot, tree: Tree, va: Array, aa: Array | None) -> Motion:
    """`dynamics.motion_of_tree`; no accelerations of the motors are none."""
    Phi = closures(robot, tree.axes)
    factors = LU(Phi[:, PASSIVE])
    L = complement(robot, factors, -Phi[:, ACTUATED], robot.unit)
    q_dot = L @ va
    axes_dot, omega = axis_rates(robot, tree, q_dot)
    right = -(closures(robot, axes_dot) @ q_dot)
    if aa is None:
        aa = robot.zeros(3)
    else:
        right = right - Phi[:, ACTUATED] @ aa
    q_ddot = complement(robot, factors, right, aa)  # Eq. (8)
    return Motion(L, q_dot, q_ddot, axes_dot, omega)


def rnea(
    robot: Robot, tree: Tree, q_dot: Array, q_ddot: Array, axes_dot: Array, omega: Array
) -> Array:
    """Newton and Euler's recursion, moments about O: the torques (9,) of the tree."""
    (e, u, n), (_, u_dot, n_dot) = _by_kind(tree.axes), _by_kind(axes_dot)
    _, mu_dot, beta_dot = _by_kind(q_dot[:, None])
    gamma_ddot, mu_ddot, beta_ddot = _by_kind(q_ddot[:, None])
    link = gamma_ddot * e
    passive = link + mu_ddot * u + mu_dot * u_dot
    star = passive[0] + beta_ddot[0] * n[0] + beta_dot[0] * n_dot[0]
    star_omega = omega[3] + beta_dot[0] * n[0]
    moment = moments(
        robot,
        tree,
        np.concatenate([omega, star_omega[None]]),
        np.concatenate([link, passive, star[None]]),
    )
    tau = robot.zeros(3, 3)
    on_mu = moment[3:6].copy()
    on_mu[0] = on_mu[0] + moment[6]
    tau[:, 0] = _dot(e, moment[:3] + on_mu)[:, 0]
    tau[:, 1] = _dot(u, on_mu)[:, 0]
    tau[0, 2] = _dot(n[0], moment[6])[0]
    return tau.reshape(9)


def moments(robot: Robot, tree: Tree, omega: Array, alpha: Array) -> Array:
    """About O, of what inertia and weight ask for, shape (7, 3), inertia in the body's axes."""
    back, r = np.swapaxes(tree.frames, -1, -2), tree.centers
    turn = _times(back, omega)
    spin = np.cross(turn, _times(robot.inertia, turn))
    moment = _times(tree.frames, _times(robot.inertia, _times(back, alpha)) + spin)
    acceleration = np.cross(alpha, r) + np.cross(omega, np.cross(omega, r))
    return moment + np.cross(r, robot.mass * (acceleration - robot.gravity))


def inertias_about_O(robot: Robot, turned: Array, r: Array) -> Array:
    """Inertias about O from those about the mass centres r, base axes, shape (7, 3, 3)."""
    parallel = _dot(r, r)[..., None] * robot.unit - r[:, :, None] * r[:, None, :]
    return turned + robot.mass[..., None] * parallel


def crba(robot: Robot, tree: Tree) -> Array:
    """Inertia matrix (9, 9) of the tree by composite bodies."""
    turned = tree.frames @ robot.inertia @ np.swapaxes(tree.frames, -1, -2)
    body = inertias_about_O(robot, turned, tree.centers)
    H = robot.zeros(9, 9)
    for k in range(3):
        carried = body[3 + k] + body[6] if k == 0 else body[3 + k]
        composites = [body[k] + carried, carried, *([body[6]] if k == 0 else [])]
        for j, composite in enumerate(composites):
            momentum = composite @ tree.axes[3 * k + j]
            row = tree.axes[3 * k : 3 * k + j + 1] @ momentum
            H[3 * k + j, 3 * k : 3 * k + j + 1] = H[3 * k : 3 * k + j + 1, 3 * k + j] = row
    return H


def torques_short(robot: Robot, q: Array, va: Array, aa: Array) -> Array:
    """`dynamics.inverse_dynamics`."""
    tree = tree_at(robot, q)
    motion = motion_of_tree(robot, tree, va, aa)
    return rnea(robot, tree, *motion[1:]) @ motion.L


def accelerations_short(robot: Robot, q: Array, va: Array, tau: Array) -> Array:
    """`dynamics.direct_dynamics`."""
    tree = tree_at(robot, q)
    motion = motion_of_tree(robot, tree, va, None)
    force = tau - rnea(robot, tree, *motion[1:]) @ motion.L
    return solve_cholesky(motion.L.T @ crba(robot, tree) @ motion.L, force)


# --- Lagrange multipliers -------------------------------------------------------------------------


def torques_multipliers(robot: Robot, q: Array, va: Array, aa: Array) -> Array:
    """Motor torques and multipliers together, as `lagrange.torques`."""
    tree = tree_at(robot, q)
    Phi, system = closures(robot, tree.axes), robot.zeros(9, 9)
    order = np.concatenate([PASSIVE, ACTUATED])
    system[:6], system[6:, 6:] = Phi[:, order], robot.unit
    factors = LU(system)

    def joints(right: Array, actuated: Array) -> Array:
        x = robot.zeros(9)
        x[order] = factors.solve(np.concatenate([right, actuated]))
        return x

    q_dot = joints(robot.zeros(6), va)
    axes_dot, omega = axis_rates(robot, tree, q_dot)
    q_ddot = joints(-(closures(robot, axes_dot) @ q_dot), aa)
    need = rnea(robot, tree, q_dot, q_ddot, axes_dot, omega)
    return factors.solve_transposed(need[order])[6:]


def accelerations_multipliers(robot: Robot, q: Array, q_dot: Array, tau: Array) -> Array:
    """Accelerations and multipliers together, as `lagrange.accelerations_by_multipliers`."""
    tree = tree_at(robot, q)
    axes_dot, omega = axis_rates(robot, tree, q_dot)
    Phi = closures(robot, tree.axes)
    force = -rnea(robot, tree, q_dot, robot.zeros(9), axes_dot, omega)
    force[ACTUATED] = force[ACTUATED] + tau
    system = robot.zeros(15, 15)
    system[:9, :9], system[:9, 9:], system[9:, :9] = crba(robot, tree), Phi.T, Phi
    right = np.concatenate([force, -(closures(robot, axes_dot) @ q_dot)])
    return LU(system).solve(right)[ACTUATED]


# --- virtual work: `VirtualWork` ------------------------------------------------------------------


class Legs(NamedTuple):
    """e, n, u and the reciprocal vectors g, b, (3, 3) each; cosine and sine^2 of e to n, (3, 1)."""

    e: Array
    n: Array
    u: Array
    g: Array
    b: Array
    c: Array
    s2: Array


def legs_at(robot: Robot, R: Array) -> Legs:
    e, n = robot.geometry.e, robot.geometry.arc_normals @ R.T
    p = np.cross(e, n)
    c, s2 = _dot(e, n), _dot(p, p)
    return Legs(e, n, p / np.sqrt(s2), (e - c * n) / s2, (n - c * e) / s2, c, s2)


class Bodies(NamedTuple):
    """omega_i = G_i omega, alpha_i = G_i alpha + rest_i; gamma_ddot = g . alpha + gamma_rest."""

    tree: Tree
    G: Array
    omega: Array
    rest: Array
    gamma_rest: Array


def bodies_at(robot: Robot, R: Array, omega: Array, legs: Legs) -> Bodies:
    e, n, u, g, b, c, s2 = legs
    gamma_dot, beta_dot = _dot(g, omega), _dot(b, omega)
    n_dot = np.cross(omega, n)
    c_dot = _dot(e, n_dot)
    gamma_rest = c_dot * (2 * c * gamma_dot - _dot(n, omega)) / s2
    beta_rest = c_dot * (2 * c * beta_dot - _dot(e, omega)) / s2
    links, sliding = e[:, :, None] * g[:, None, :], n[:, :, None] * b[:, None, :]
    G = np.concatenate([links, robot.unit - sliding, robot.unit[None]])
    passive = -(beta_dot * n_dot + beta_rest * n)
    rest = np.concatenate([gamma_rest * e, passive, robot.zeros(1, 3)])
    frames = [np.stack([u, np.cross(z, u), z], axis=-1) for z in (e, n)]
    frames = np.concatenate([*frames, R[None]])
    tree = Tree(robot.zeros(0), frames, _times(frames, robot.center))
    return Bodies(tree, G, _times(G, omega), rest, gamma_rest[:, 0])


def star_equations(robot: Robot, bodies: Bodies) -> tuple[Array, Array]:
    """A and h of J^T tau = A alpha + h."""
    frames, r, turn, rest = bodies.tree.frames, bodies.tree.centers, bodies.omega, bodies.rest
    inertia = frames @ robot.inertia @ np.swapaxes(frames, -1, -2)
    acceleration = np.cross(rest, r) + np.cross(turn, np.cross(turn, r))
    moment = _times(inertia, rest) + np.cross(turn, _times(inertia, turn))
    moment = moment + np.cross(r, robot.mass * (acceleration - robot.gravity))
    about_O = inertias_about_O(robot, inertia, r)
    G_T = np.swapaxes(bodies.G, -1, -2)
    return (G_T @ about_O @ bodies.G).sum(axis=0), _times(G_T, moment).sum(axis=0)


def torques_virtual_work(robot: Robot, R: Array, omega: Array, alpha: Array) -> Array:
    """`VirtualWork.torques`, by way of A and h."""
    legs = legs_at(robot, R)
    A, h = star_equations(robot, bodies_at(robot, R, omega, legs))
    return LU(legs.g.T).solve(A @ alpha + h)


def torques_body_by_body(robot: Robot, R: Array, omega: Array, alpha: Array) -> Array:
    """The same sum without A: each body's wrench at its own acceleration."""
    legs = legs_at(robot, R)
    bodies = bodies_at(robot, R, omega, legs)
    moment = moments(robot, bodies.tree, bodies.omega, _times(bodies.G, alpha) + bodies.rest)
    return LU(legs.g.T).solve(_times(np.swapaxes(bodies.G, -1, -2), moment).sum(axis=0))


def accelerations_virtual_work(robot: Robot, R: Array, va: Array, tau: Array) -> Array:
    """`VirtualWork.accelerations` between motor rates and motor accelerations."""
    legs = legs_at(robot, R)
    omega = LU(legs.g).solve(va)
    bodies = bodies_at(robot, R, omega, legs)
    A, h = star_equations(robot, bodies)
    return legs.g @ LU(A).solve(legs.g.T @ tau - h) + bodies.gamma_rest
