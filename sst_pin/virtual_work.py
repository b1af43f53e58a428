# SPDX-License-Identifier: BSD-2-Clause
"""The dynamics of the SST by virtual work, as in [10, 11]: a referee with no L, K or T in it.

The coordinates are the star's: its orientation R and angular velocity omega. A leg has the fixed
axis e, the normal n of its arc, which turns with the star, and its passive axis u along e x n. In

    omega = gamma_dot e + mu_dot u + beta_dot n

the rates are omega's components along the reciprocal vectors g, u, b of e, u, n. Each body thus
turns with omega_i = G_i omega about O, and since delta omega is free, the work of inertia, weight,
load and friction on it equals that of the motors: J^T tau = A alpha + h, with rows g_k of J.

Only geometry and masses come in from the rest of the package: no formula is shared with it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import DOP853
from scipy.linalg import eigvals

from .batches import finite_array
from .errors import InputError, SimulationError, SingularConfigurationError, SSTError, WorkspaceError
from .parameters import Parameters

Array = NDArray[np.float64]

#: Numbers of the size of one below which a configuration counts as singular.
_SINGULAR = 1e-10
#: What rounding leaves of |w_2|^2 - |w_3|^2 and w_2 . w_3 once they vanish.
_ORTHONORMAL = 1e-13


class VirtualWork:
    """An SST whose motion is that of its star, by the principle of virtual work.

    Args:
        parameters: Geometry, masses, friction and gravity of the robot.
        branch: Sign of u . (e x n) for each leg, +1 for 0 < mu_k < pi, shape (3,).
    """

    def __init__(self, parameters: Parameters, branch: ArrayLike = (1, 1, 1)) -> None:
        self._v = parameters.base_directions
        e = np.cross(self._v, self._v[[1, 2, 0]])
        self._e = e / np.linalg.norm(e, axis=1)[:, None]
        _, alpha_2, alpha_3 = parameters.arc_angles
        self._delta = np.array((0.0, alpha_2, alpha_2 + alpha_3))  # from arc 1 to arc k about s
        self._branch = finite_array("branch", branch, (3,))
        if self._branch.shape != (3,) or not (np.abs(self._branch) == 1).all():
            raise InputError("branch", f"{np.asarray(branch).tolist()} is not three of +1 and -1")
        bodies = (*parameters.links, *parameters.passive_links, parameters.star)
        self._mass = np.array([body.mass for body in bodies])[:, None]
        self._center = np.array([body.center_of_mass for body in bodies])
        self._inertia = np.array([body.inertia for body in bodies])
        self._viscous, self._coulomb = parameters.viscous_friction, parameters.coulomb_friction
        self._gravity = parameters.gravity

    def inverse_dynamics(
        self,
        R: ArrayLike,
        omega: ArrayLike,
        alpha: ArrayLike,
        *,
        platform_moment: ArrayLike | None = None,
    ) -> Array:
        """Motor torques of a motion of the star.

        Args:
            R: {E} in the base, shape (..., 3, 3).
            omega: Angular velocity of the star, base axes, shape (..., 3), [rad/s].
            alpha: Its angular acceleration, base axes, shape (..., 3), [rad/s^2].
            platform_moment: Moment that the surroundings exert on the star, base axes, shape
                (..., 3), [N m].

        Returns:
            tau, shape (..., 3), [N m].

        Raises:
            InputError: For a wrong shape or a number that is not finite.
            SingularConfigurationError: When a leg lies flat on its arc, or the motors do not hold
                the star.
        """
        star = self._star(R, omega)
        alpha = finite_array("alpha", alpha, (3,))
        work = _times(star.A, alpha) + star.h - _moment(platform_moment)
        return _solve(np.swapaxes(star.J, -1, -2), work, "the motors do not hold the star")

    def direct_dynamics(
        self,
        R: ArrayLike,
        omega: ArrayLike,
        tau: ArrayLike,
        *,
        platform_moment: ArrayLike | None = None,
    ) -> Array:
        """Angular acceleration of the star under given motor torques.

        Args:
            R: {E} in the base, shape (..., 3, 3).
            omega: Angular velocity of the star, base axes, shape (..., 3), [rad/s].
            tau: Motor torques, shape (..., 3), [N m].
            platform_moment: As in `inverse_dynamics`.

        Returns:
            alpha, base axes, shape (..., 3), [rad/s^2].

        Raises:
            InputError, SingularConfigurationError: As `inverse_dynamics`.
        """
        star = self._star(R, omega)
        tau = finite_array("tau", tau, (3,))
        return star.acceleration(tau, _moment(platform_moment))

    def motor_motion(self, R: ArrayLike, omega: ArrayLike) -> tuple[Array, Array]:
        """Motor angles and rates at a motion of the star.

        Args:
            R: {E} in the base, shape (..., 3, 3).
            omega: Angular velocity of the star, base axes, shape (..., 3), [rad/s].

        Returns:
            gamma in (-pi, pi] and gamma_dot, shapes (..., 3), [rad], [rad/s].

        Raises:
            InputError, SingularConfigurationError: As `inverse_dynamics`.
        """
        star = self._star(R, omega)
        y = np.cross(self._e, self._v)
        return np.arctan2(_dot(star.u, y), _dot(star.u, self._v)), star.gamma_dot

    # --- direct kinematics ------------------------------------------------------------------

    def orientations(self, gamma: ArrayLike) -> Array:
        """Every real assembly for given motor angles, whatever the branches of its legs.

        The nine numbers n_k = w_3 cos(delta_k) - w_2 sin(delta_k), with w_2 and w_3 the second and
        third column of R, are held by u_k . n_k = 0 to a space of three dimensions. In it
        |w_2| = |w_3| and w_2 . w_3 = 0 are two conics; the pair of lines in their pencil cuts
        them in at most four points, each with two signs.

        Args:
            gamma: Motor angles, shape (3,), [rad].

        Returns:
            {E} in the base, shape (n, 3, 3), n <= 8, in no particular order.

        Raises:
            InputError: For a wrong shape or a number that is not finite.
            SingularConfigurationError: When the star moves while the motors stand.
        """
        gamma = finite_array("gamma", gamma, (3,))
        if gamma.ndim != 1:
            raise InputError("gamma", f"shape {gamma.shape}, expected (3,)")
        cos, sin = np.cos(gamma)[:, None], np.sin(gamma)[:, None]
        u = cos * self._v + sin * np.cross(self._e, self._v)
        legs = np.hstack([-np.sin(self._delta)[:, None] * u, np.cos(self._delta)[:, None] * u])
        _, size, axes = np.linalg.svd(legs)
        if size[-1] < _SINGULAR:
            raise SingularConfigurationError("the motor angles do not fix the star", _ratio(size))
        W_2, W_3 = axes[3:, :3].T, axes[3:, 3:].T  # w_2 = W_2 x, w_3 = W_3 x
        conics = np.array([W_2.T @ W_2 - W_3.T @ W_3, W_2.T @ W_3 + W_3.T @ W_2])
        found: list[Array] = []
        for x in _common_points(conics):
            x = _polished(conics, x)
            if x is not None and all(abs(x @ known) < 1 - 1e-12 for known in found):
                found += [x, -x]
        w_2, w_3 = (np.sqrt(2) * np.array(found).reshape(-1, 3) @ W.T for W in (W_2, W_3))
        return np.stack([np.cross(w_2, w_3), w_2, w_3], axis=-1)

    def admissible(self, gamma: ArrayLike, near_R: ArrayLike) -> Array:
        """The assembly that continues a known one.

        Of up to eight it is the nearest with every leg on its branch and det J, which vanishes
        where assemblies meet, of the sign it had.

        Args:
            gamma: Motor angles, shape (3,), [rad].
            near_R: {E} in the base shortly before, shape (3, 3).

        Returns:
            {E} in the base, shape (3, 3).

        Raises:
            InputError, SingularConfigurationError: As `orientations` and `inverse_dynamics`.
            WorkspaceError: When no assembly is left.
        """
        gamma, near_R = finite_array("gamma", gamma, (3,)), finite_array("near_R", near_R, (3, 3))
        R = self.orientations(gamma)
        u = np.cos(gamma)[:, None] * self._v + np.sin(gamma)[:, None] * np.cross(self._e, self._v)
        R = R[(self._branch * _dot(u, np.cross(self._e, self._normals(R))) > 0).all(axis=-1)]
        J, J_near = (self._star(pose, np.zeros(3)).J for pose in (R, near_R))
        R = R[np.linalg.det(J) * np.linalg.det(J_near) > 0]
        if not len(R):
            raise WorkspaceError(f"no admissible assembly at gamma = {gamma.tolist()} rad")
        return cast(Array, R[np.einsum("nij,ij->n", R, near_R).argmax()])

    # --- motion in time ---------------------------------------------------------------------

    def simulate(
        self,
        torque: Callable[[float, Array, Array], ArrayLike],
        R0: ArrayLike,
        omega0: ArrayLike,
        t: ArrayLike,
        *,
        tolerance: float = 1e-11,
        sign_width: float = 1e-3,
    ) -> tuple[Array, Array]:
        """Integrate the direct dynamics with the state (gamma, gamma_dot).

        At every evaluation the direct kinematics is solved for all assemblies and the admissible
        one is selected by continuity from the last accepted step.

        Args:
            torque: Callable (t, R, omega) -> motor torques, shape (3,), [N m].
            R0: {E} in the base at t[0], shape (3, 3).
            omega0: Angular velocity at t[0], base axes, shape (3,), [rad/s].
            t: Times at which the motion is wanted, increasing, shape (N,), [s].
            tolerance: Relative and absolute, of the integrator.
            sign_width: [rad/s]; in Coulomb friction sign(x) is taken as tanh(x / sign_width).

        Returns:
            R and omega of shapes (N, 3, 3) and (N, 3).

        Raises:
            InputError: For a wrong shape or a number that is not finite.
            SingularConfigurationError: When R0 is singular.
            SimulationError: When the integrator gives up, as before a singularity.
        """
        times = finite_array("t", t, ())
        R, omega = finite_array("R0", R0, (3, 3)), finite_array("omega0", omega0, (3,))
        failure = ""

        def pose(state: Array) -> tuple[Array, Array]:
            R_now = self.admissible(state[:3], R)
            J = self._star(R_now, np.zeros(3)).J
            return R_now, _solve(J, state[3:], "the motors do not fix the star")

        def rate(time: float, state: Array) -> Array:
            nonlocal failure
            try:
                R_now, omega_now = pose(state)
                star = self._star(R_now, omega_now, sign_width)
            except SSTError as error:  # a trial step went too far: NaN asks for a shorter one
                failure = f" ({error})"
                return np.full(6, np.nan)
            tau = finite_array("torque(t, R, omega)", torque(time, R_now, omega_now), (3,))
            gamma_ddot = _times(star.J, star.acceleration(tau, np.zeros(3))) + star.J_dot_omega
            return np.concatenate([state[3:], gamma_ddot])

        samples = [(R, omega)]
        start = np.concatenate(self.motor_motion(R, omega))
        solver = DOP853(rate, times[0], start, times[-1], rtol=tolerance, atol=tolerance)
        while solver.status == "running":
            message = solver.step()
            if solver.status == "failed":
                raise SimulationError(f"the integrator gave up: {message}{failure}", solver.t)
            state = solver.dense_output()
            passed = (times > solver.t_old) & (times <= solver.t)
            samples += [pose(state(time)) for time in times[passed]]
            R, _ = pose(solver.y)
        R_samples, omega_samples = zip(*samples, strict=True)
        return np.array(R_samples), np.array(omega_samples)

    # --- inside -----------------------------------------------------------------------------

    def _normals(self, R: Array) -> Array:
        """n_k in the base, shape (..., 3, 3), leg by leg."""
        w_2, w_3 = R[..., None, :, 1], R[..., None, :, 2]
        return np.cos(self._delta)[:, None] * w_3 - np.sin(self._delta)[:, None] * w_2

    def _star(self, R: ArrayLike, omega: ArrayLike, sign_width: float = 0.0) -> _Star:
        """The equations of motion at R and omega, and the kinematics that they stand on."""
        R, omega = finite_array("R", R, (3, 3)), finite_array("omega", omega, (3,))
        R = np.broadcast_to(R, (*np.broadcast_shapes(R.shape[:-2], omega.shape[:-1]), 3, 3))
        e, n, w = np.broadcast_to(self._e, R.shape), self._normals(R), omega[..., None, :]
        # e, u, n and their reciprocal vectors g, u, b, with rates; c is the cosine of e and n.
        c = _dot(e, n)[..., None]
        p = np.cross(e, n)
        s2 = _dot(p, p)[..., None]
        _require(s2.min(axis=(-1, -2)) > _SINGULAR**2, 1 / s2, "a leg lies flat on its arc")
        u = self._branch[:, None] * p / np.sqrt(s2)
        g, b = (e - c * n) / s2, (n - c * e) / s2
        n_dot = np.cross(w, n)
        c_dot = _dot(e, n_dot)[..., None]
        g_dot = (2 * c * c_dot * g - c_dot * n - c * n_dot) / s2
        b_dot = (2 * c * c_dot * b - c_dot * e + n_dot) / s2
        # Partial angular velocities G_i and what is left of the accelerations at alpha = 0, for
        # actuator links, passive links (the star less its sliding in the leg) and the star.
        beta_dot = _dot(b, w)[..., None]
        one = np.broadcast_to(np.eye(3), R.shape)
        G = _stack(_outer(e, g), one[..., None, :, :] - _outer(n, b), one)
        rest = _stack(
            _dot(g_dot, w)[..., None] * e,
            -beta_dot * n_dot - _dot(b_dot, w)[..., None] * n,
            np.zeros(R.shape[:-1]),
        )
        axes = _stack(*(np.stack([u, np.cross(z, u), z], axis=-1) for z in (e, n)), R)
        r = _times(axes, self._center)
        inertia = axes @ self._inertia @ np.swapaxes(axes, -1, -2)
        turn = _times(G, w)
        # Inertia forces with their sign changed, less weights.
        moment = _times(inertia, rest) + np.cross(turn, _times(inertia, turn))
        moment_of = np.cross(rest, r) + np.cross(turn, np.cross(turn, r)) - self._gravity
        moment = moment + np.cross(r, self._mass * moment_of)
        about_O = inertia + self._mass[..., None] * (
            _dot(r, r)[..., None, None] * np.eye(3) - _outer(r, r)
        )
        rates = np.stack([g, u, b], axis=-2).reshape(*R.shape[:-2], 9, 3)  # in the order of q
        q_dot = _times(rates, omega)
        sign = np.tanh(q_dot / sign_width) if sign_width else np.sign(q_dot)
        friction = self._viscous * q_dot + self._coulomb * sign
        h = np.einsum("...bij,...bi->...j", G, moment) + np.einsum("...ij,...i->...j", rates, friction)
        A = np.einsum("...bki,...bkl,...blj->...ij", G, about_O, G)
        return _Star(u, g, q_dot[..., ::3], _dot(g_dot, w), A, h)


class _Star(NamedTuple):
    """J^T tau = A alpha + h less the moment of the load, and gamma_dot = J omega."""

    u: Array  # along OR_k, leg by leg
    J: Array
    gamma_dot: Array
    J_dot_omega: Array
    A: Array
    h: Array

    def acceleration(self, tau: Array, load: Array) -> Array:
        work = _times(np.swapaxes(self.J, -1, -2), tau) + load - self.h
        return _solve(self.A, work, "some motion of the star moves no mass")
