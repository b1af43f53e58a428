# SPDX-License-Identifier: BSD-2-Clause
"""A controller that learns the dynamic parameters of its robot."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, positive_number
from ..closed_chain import ClosedChain
from ..dynamics.regressor import OF_BODY
from ..simulation.trajectories import Trajectory
from .controllers import Controller


class Adaptive(Controller):
    """Slotine and Li's controller: it learns the dynamic parameters while it follows a motion.

    With the sliding rate s = (va_d - va) + stiffness (x_d - x) the torques are Y theta + damping s,
    and theta grows by Y^T s. Y theta is the robot's equation with rates and accelerations that lead
    to the motion; its Coriolis matrix C makes M_dot - 2 C skew. J.-J. Slotine and W. Li, On the
    adaptive control of robot manipulators, Int. J. Robotics Research 6(3), 1987.

    It learns from call to call, so it is for loops in which time goes on: `simulate` takes it as a
    `SampledTorque` only. It does not learn while its torques pass the limits. The other arguments
    are those of `Controller`; the chain is the model to begin with.

    Args:
        stiffness: How fast errors die out where s is 0, () or shape (n,), [1/s].
        damping: Torques by s, () or shape (n,), [N m s/rad] or [N s/m].
        learning: How fast it learns, without unit; 0 for never.

    Attributes:
        theta: The parameters learned so far, in the order of `chain.dynamic_parameters`.
    """

    sampled_only = True

    def __init__(
        self,
        chain: ClosedChain,
        motion: Trajectory,
        *,
        stiffness: ArrayLike,
        damping: ArrayLike,
        learning: float,
        limits: ArrayLike | None = None,
    ) -> None:
        super().__init__(chain, motion, limits=limits)
        self.stiffness = self._gains("stiffness", stiffness)
        self.damping = self._gains("damping", damping)
        mechanism, parameters = chain.mechanism, chain.dynamic_parameters
        mass = sum(body.mass for body in mechanism.model.inertias) / len(chain.joint_names)
        length, inertia = mechanism.length, mass * mechanism.length**2
        sizes = dict(zip(OF_BODY, [mass, *[mass * length] * 3, *[inertia] * 6], strict=True))
        sizes |= {"viscous": inertia, "coulomb": inertia}
        words = [name.rpartition(".")[2] for name in parameters.names]
        rate = positive_number("learning", learning, or_zero=True)
        self._learning = rate * np.array([sizes.get(word, 0.0) ** 2 for word in words]) / inertia
        self._odd = np.array([word in ("viscous", "coulomb", "damping") for word in words])
        self.theta, self._last = np.array(parameters.values), float(motion.t[0])

    def _torque(self, t: float, q: Array, va: Array) -> Array:
        error, rate_error, accelerations = self._errors(t, q, va)
        s = rate_error + self.stiffness * error
        Y = self._regressor(q, va, va + s, accelerations + self.stiffness * rate_error)
        tau = self._shared(q, self._motors(q, Y @ self.theta + self.damping * s))
        if self._within(tau):
            self.theta += max(0.0, t - self._last) * self._learning * (Y.T @ s)
        self._last = t
        return tau

    def _regressor(self, q: Array, va: Array, wanted: Array, aa: Array) -> Array:
        """Y of M aa + C(va) wanted and of the other forces at va, shape (n, p).

        C is that of Christoffel's symbols, a form that is symmetric in both rates, so the regressor
        of forces, which is square in the rates, gives it by differences. Friction is that at va.
        """
        none = np.zeros_like(va)
        at = np.array([va + wanted, va, wanted, none, none])
        both, first, second, rest, still = self.chain.torque_regressor(
            np.tile(q, (5, 1)), at, np.array([none, none, none, none, aa])
        )
        Y = still + (both - first - second + rest) / 2
        return np.where(self._odd, first, Y)
