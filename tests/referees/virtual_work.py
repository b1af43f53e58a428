# SPDX-License-Identifier: BSD-2-Clause
"""The dynamics of the SST by virtual work, as in [10, 11]: a referee without L, K or T.

The coordinates are the star's: its orientation R and angular velocity omega. Leg k has the fixed
axis e, the normal n of its arc, which turns with the star, and its passive axis u along e x n. In

    omega = gamma_dot e + mu_dot u + beta_dot n

the rates are the components of omega along g, u, b, the reciprocal vectors of e, u, n. Each body
turns about O with omega_i = G_i omega, and the work of inertia, weight, load and friction on any
delta omega equals that of the motors: J^T tau = A alpha + h, the rows of J being g_k.

Only geometry and masses come in from the rest of the package: no formula is shared with it.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp

from sst_pin.arrays import Array
from sst_pin.description.parameters import Parameters


class _Star(NamedTuple):
    """J^T tau = A alpha + h, with gamma_dot = J omega."""

    J: Array
    A: Array
    h: Array

    def acceleration(self, tau: Array) -> Array:
        work = _times(self.J.mT, tau) - self.h
        return _solve(self.A, work)


class VirtualWork:
    """An SST described by the motion of its star; `branch` is the sign of sin(mu_k) of each leg."""

    name = "virtual work"

    def __init__(self, parameters: Parameters, branch: ArrayLike = (1, 1, 1)) -> None:
        v = parameters.base_directions
        e = np.cross(v, v[[1, 2, 0]])
        self._e = e / np.linalg.norm(e, axis=1)[:, None]
        _, alpha_2, alpha_3 = parameters.arc_angles
        delta = np.array((0.0, alpha_2, alpha_2 + alpha_3))  # from arc 1 to arc k about s
        self._n_E = np.stack([0 * delta, -np.sin(delta), np.cos(delta)], axis=-1)
        self._branch = np.asarray(branch, dtype=float)
        bodies = (*parameters.links, *parameters.passive_links, parameters.star)
        self._mass = np.array([body.mass for body in bodies])[:, None]
        self._center = np.array([body.center_of_mass for body in bodies])
        self._inertia = np.array([body.inertia for body in bodies])
        self._viscous, self._coulomb = parameters.viscous_friction, parameters.coulomb_friction
        self._gravity = parameters.gravity

    def torques(
        self,
        R: ArrayLike,
        omega: ArrayLike,
        alpha: ArrayLike,
        platform_moment: ArrayLike | None = None,
    ) -> Array:
        """Motor torques of motions of the star with leading axes."""
        star = self._star(R, omega, platform_moment)
        work = _times(star.A, np.asarray(alpha, dtype=float)) + star.h
        return _solve(star.J.mT, work)

    def accelerations(
        self,
        R: ArrayLike,
        omega: ArrayLike,
        tau: ArrayLike,
        platform_moment: ArrayLike | None = None,
    ) -> Array:
        """Angular accelerations of the star under motor torques, base axes, shape (..., 3)."""
        return self._star(R, omega, platform_moment).acceleration(np.asarray(tau, dtype=float))

    def simulate(
        self,
        torque: Callable[[float, Array, Array], ArrayLike],
        R0: ArrayLike,
        omega0: ArrayLike,
        t: ArrayLike,
    ) -> tuple[Array, Array]:
        """R, (N, 3, 3), and omega, (N, 3), of the star at times t by direct dynamics.

        `torque(t, R, omega)` gives motor torques, [N m]; R0 and omega0 are the state at t[0]. In
        Coulomb friction sign(x) is taken as tanh(x / 0.001 rad/s).
        """
        times = np.asarray(t, dtype=float)

        def rate(time: float, state: Array) -> Array:
            R, omega = _pose(state)
            star = self._star(R, omega, sign_width=1e-3)
            alpha = star.acceleration(np.asarray(torque(time, R, omega), dtype=float))
            return np.concatenate([np.cross(omega, R.T).T.ravel(), alpha])

        start, span = np.concatenate([np.ravel(R0), omega0]), (times[0], times[-1])
        found = solve_ivp(rate, span, start, "DOP853", times, rtol=1e-11, atol=1e-11)
        assert found.success, found.message
        poses = [_pose(state) for state in found.y.T]
        return np.array([R for R, _ in poses]), np.array([omega for _, omega in poses])

    def _star(
        self,
        R: ArrayLike,
        omega: ArrayLike,
        platform_moment: ArrayLike | None = None,
        sign_width: float = 0.0,
    ) -> _Star:
        """The equations of motion at R and omega."""
        R, omega = np.asarray(R, dtype=float), np.asarray(omega, dtype=float)
        load = np.zeros(3) if platform_moment is None else platform_moment
        R = np.broadcast_to(R, (*np.broadcast_shapes(R.shape[:-2], omega.shape[:-1]), 3, 3))
        e, n, w = np.broadcast_to(self._e, R.shape), self._n_E @ R.mT, omega[..., None, :]
        p = np.cross(e, n)
        # Cosine and sine^2 of their angle.
        c, s2 = np.vecdot(e, n)[..., None], np.vecdot(p, p)[..., None]
        u = self._branch[:, None] * p / np.sqrt(s2)
        g, b = (e - c * n) / s2, (n - c * e) / s2
        rates = np.stack([g, u, b], axis=-2).reshape(*R.shape[:-2], 9, 3)
        q_dot = _times(rates, omega)
        gamma_dot, beta_dot = q_dot[..., ::3, None], q_dot[..., 2::3, None]
        # What is left of gamma_ddot and beta_ddot at alpha = 0: g_dot . omega and b_dot . omega,
        # in which n_dot is at right angles to omega.
        n_dot = np.cross(w, n)
        c_dot = np.vecdot(e, n_dot)[..., None]
        gamma_rest = c_dot * (2 * c * gamma_dot - np.vecdot(n, w)[..., None]) / s2
        beta_rest = c_dot * (2 * c * beta_dot - np.vecdot(e, w)[..., None]) / s2
        # G_i, and the angular accelerations at alpha = 0, of actuator links, passive links (the
        # star's less its sliding along the leg) and star: seven bodies.
        one = np.broadcast_to(np.eye(3), (*R.shape[:-2], 1, 3, 3))
        G = np.concatenate([_outer(e, g), one - _outer(n, b), one], axis=-3)
        sliding = beta_dot * n_dot + beta_rest * n
        rest = np.concatenate([gamma_rest * e, -sliding, 0 * one[..., 0]], axis=-2)
        frames = (np.stack([u, np.cross(z, u), z], axis=-1) for z in (e, n))
        axes = np.concatenate([*frames, R[..., None, :, :]], axis=-3)
        turn, r = _times(G, w), _times(axes, self._center)
        inertia = axes @ self._inertia @ axes.mT
        # Moments of inertia forces and weight about O: all bodies turn about it.
        force = self._mass * (np.cross(rest, r) + np.cross(turn, np.cross(turn, r)) - self._gravity)
        moment = _times(inertia, rest) + np.cross(turn, _times(inertia, turn)) + np.cross(r, force)
        parallel_axis = np.vecdot(r, r)[..., None, None] * np.eye(3) - _outer(r, r)
        about_O = inertia + self._mass[..., None] * parallel_axis
        sign = np.tanh(q_dot / sign_width) if sign_width else np.sign(q_dot)
        friction = self._viscous * q_dot + self._coulomb * sign
        h = _times(G.mT, moment).sum(axis=-2) + _times(rates.mT, friction)
        h = h - np.asarray(load, dtype=float)
        return _Star(g, (G.mT @ about_O @ G).sum(axis=-3), h)


def _pose(state: Array) -> tuple[Array, Array]:
    """R and omega of a state; R is the rotation nearest to its first nine numbers."""
    left, _, right = np.linalg.svd(state[:9].reshape(3, 3))
    return left @ right, state[9:]


def _outer(a: Array, b: Array) -> Array:
    return np.asarray(a[..., :, None] * b[..., None, :])


def _times(matrix: Array, vector: Array) -> Array:
    return np.asarray((matrix @ vector[..., None])[..., 0])


def _solve(matrix: Array, vector: Array) -> Array:
    return np.asarray(np.linalg.solve(matrix, vector[..., None])[..., 0])
