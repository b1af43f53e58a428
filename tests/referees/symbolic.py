# SPDX-License-Identifier: BSD-2-Clause
"""Lagrange's equations in three coordinates, differentiated by CasADi.

The coordinates x are those of Cayley's map, R(x) = (1 - [x])^-1 (1 + [x]) R, about the pose asked
for: there x = 0, omega = 2 x_dot and alpha = 2 x_ddot, so that no pose is singular. Positions of
all bodies follow in closed form from R(x); velocities, energies and the equations of motion
are derivatives of them that nobody wrote down.
"""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sst_pin.arrays import Array
from sst_pin.description.parameters import Parameters

from . import Moment, engine


class SymbolicLagrange:
    """Lagrange's equations along closed-form kinematics, by automatic differentiation."""

    name = "Lagrange, symbolic (CasADi)"
    package = "casadi"

    def __init__(self, parameters: Parameters) -> None:
        self._equations = _equations(engine("casadi"))
        p = parameters
        bodies = [*p.links, *p.passive_links, p.star]
        self._robot = (
            p.base_directions.T,
            p.arc_angles,
            np.array([body.mass for body in bodies]),
            np.stack([body.center_of_mass for body in bodies], axis=-1),
            np.hstack([body.inertia for body in bodies]),
            p.viscous_friction,
            p.coulomb_friction,
            p.gravity,
        )

    def torques(
        self, R: ArrayLike, omega: ArrayLike, alpha: ArrayLike, platform_moment: Moment = None
    ) -> Array:
        """Motor torques; see `Referee.torques`."""
        inertia, bias, G = self._terms(R, omega, platform_moment)
        x_ddot = np.asarray(alpha, dtype=float) / 2
        tau: Array = np.linalg.solve(G.T, inertia @ x_ddot + bias)
        return tau

    def accelerations(
        self, R: ArrayLike, omega: ArrayLike, tau: ArrayLike, platform_moment: Moment = None
    ) -> Array:
        """Angular acceleration of the star; see `DirectReferee.accelerations`."""
        inertia, bias, G = self._terms(R, omega, platform_moment)
        force = G.T @ np.asarray(tau, dtype=float) - bias
        alpha: Array = 2 * np.linalg.solve(inertia, force)
        return alpha

    def _terms(
        self, R: ArrayLike, omega: ArrayLike, platform_moment: Moment
    ) -> tuple[Array, Array, Array]:
        """Inertia, bias and Jacobian G of gamma: inertia x_ddot + bias = G^T tau."""
        moment = np.zeros(3) if platform_moment is None else platform_moment
        state = (np.asarray(value, dtype=float) for value in (R, omega, moment))
        inertia, bias, G = self._equations(*state, *self._robot)
        return inertia.full(), bias.full().ravel(), G.full()


@cache
def _equations(ca: Any) -> Any:
    """The equations of motion of every SST at x = 0, as one CasADi function."""
    sym = ca.SX.sym
    R, omega, moment = sym("R", 3, 3), sym("omega", 3), sym("moment", 3)
    v, arcs, gravity = sym("v", 3, 3), sym("arcs", 3), sym("gravity", 3)
    mass, center, inertia = sym("mass", 7), sym("center", 3, 7), sym("inertia", 3, 21)
    viscous, coulomb = sym("viscous", 9), sym("coulomb", 9)
    x, x_dot = sym("x", 3), sym("x_dot", 3)

    def rate(value: Any) -> Any:
        return ca.jtimes(value, x, x_dot)

    def spin(rotation: Any) -> Any:
        """Angular velocity in the axes of the body."""
        skew = rotation.T @ ca.reshape(rate(ca.vec(rotation)), 3, 3)
        return ca.vertcat(skew[2, 1], skew[0, 2], skew[1, 0])

    cross = ca.skew(x)
    star = (ca.SX.eye(3) + 2 / (1 + ca.sumsqr(x)) * (cross + cross @ cross)) @ R
    frames, angles = _legs(ca, star, v, arcs)

    kinetic, potential = 0, 0
    for i, frame in enumerate(frames):
        c, w = frame @ center[:, i], spin(frame)
        turning = w.T @ inertia[:, 3 * i : 3 * i + 3] @ w
        kinetic += (mass[i] * ca.sumsqr(rate(c)) + turning) / 2
        potential -= mass[i] * ca.dot(gravity, c)

    q_dot = rate(angles)
    friction = -(viscous * q_dot + coulomb * ca.sign(q_dot))
    force = ca.jtimes(angles, x, friction, True)
    force += ca.jtimes(star @ spin(star), x_dot, moment, True)  # virtual work of the moment
    momentum = ca.gradient(kinetic, x_dot)
    bias = rate(momentum) - ca.gradient(kinetic - potential, x) - force
    terms = [ca.jacobian(momentum, x_dot), bias, ca.jacobian(angles[::3], x)]
    here = ca.substitute(terms, [x, x_dot], [ca.SX.zeros(3), omega / 2])
    inputs = [R, omega, moment, v, arcs, mass, center, inertia, viscous, coulomb, gravity]
    return ca.Function("sst", inputs, here)


def _legs(ca: Any, star: Any, v: Any, arcs: Any) -> tuple[list[Any], Any]:
    """Frames {1k}, then {2k}, then {E}; and gamma_1, mu_1, beta_1, gamma_2, ..."""
    links, passive, angles = [], [], []
    s, turn = star[:, 0], 0
    for k in range(3):
        start = v[:, k]
        e = ca.cross(start, v[:, (k + 1) % 3])
        e /= ca.norm_2(e)
        n = ca.cos(turn) * star[:, 2] - ca.sin(turn) * star[:, 1]
        turn += arcs[(k + 1) % 3]
        u = ca.cross(e, n)
        u /= ca.norm_2(u)
        y_1, y_2 = ca.cross(e, u), ca.cross(n, u)
        links.append(ca.horzcat(u, y_1, e))
        passive.append(ca.horzcat(u, y_2, n))
        angles += [
            ca.atan2(ca.dot(u, ca.cross(e, start)), ca.dot(u, start)),
            ca.atan2(ca.dot(n, -y_1), ca.dot(n, e)),
            ca.atan2(ca.dot(s, y_2), ca.dot(s, u)),
        ]
    return [*links, *passive, star], ca.vertcat(*angles)
