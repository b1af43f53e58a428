# SPDX-License-Identifier: BSD-2-Clause
"""What an integrator asks of a robot, on the reference path and by the kernels."""

from __future__ import annotations

from math import copysign, log
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..chain import dynamics

if TYPE_CHECKING:
    from ..chain.closed_chain import ClosedChain
    from ..sst.star_dynamics import StarDynamics

Array = NDArray[np.float64]


class Mechanics:
    """Closures and direct dynamics of a chain with a friction of its own: the reference path.

    States are y = (q, q_dot^a), shape (m + n,) or (N, m + n); their passive joints need only be
    near the closures.

    Args:
        chain: The robot.
        friction: In the place of the robot's.
    """

    def __init__(self, chain: ClosedChain, friction: dynamics.Friction) -> None:
        self._chain, self._friction = chain, friction
        self._m = len(chain.joint_names)
        self._unactuated = np.setdiff1d(np.arange(self._m), chain.actuated)
        self._before: Array | None = None

    def closed(self, states: Array) -> Array:
        """q with the passive joints moved onto the closures, shape (m,) or (N, m).

        Raises:
            ClosureError: When they are out of reach.
        """
        if states.ndim == 1:
            return self._chain.assemble(states[: self._m])
        return np.array([self.closed(state) for state in states])

    def rate(self, states: Array, tau: Array, load: Array | None) -> Array:
        """Eqs. (7) and (92): the rates of states, where the loops are closed.

        Args:
            states: Shape (m + n,) or (N, m + n).
            tau: Motor torques, shape (n,) or (N, n).
            load: External wrenches, shape (r, 6) or (N, r, 6), or None.

        Raises:
            ClosureError, SingularConfigurationError: As `ClosedChain.compute_accelerations`.
        """
        if states.ndim == 2:
            loads = [None] * len(states) if load is None else load
            samples = zip(states, tau, loads, strict=True)
            return np.array([self.rate(*sample) for sample in samples])
        q, va = self.closed(states), states[self._m :]
        workspace = self._chain.workspace_at(q)
        aa, q_dot = dynamics.direct_dynamics(*workspace, self._friction, q, va, tau, load)
        return np.concatenate([q_dot, aa])

    def margin(self, state: Array, limit: float) -> float:
        """How far a motion is from a singularity; to be asked from state to state along it.

        Returns:
            log(limit / condition number of Phi^u), or a number above 0 that is less than this;
            below 0 also when a singularity lies between the state and the last one above.
        """
        Phi_u = self._chain.Phi(self.closed(state))[:, self._unactuated]
        distance = log(limit / np.linalg.cond(Phi_u))
        # On the way through a singularity the smallest singular value changes its sign.
        if self._before is not None and np.linalg.slogdet(self._before.T @ Phi_u)[0] < 0:
            return -abs(distance)
        self._before = Phi_u
        return distance


class FastMechanics(Mechanics):
    """The same by compiled kernels; the reference path does what they do not vouch for.

    Args:
        robot: An SST.
        friction: In the place of its own.
        kernels: Made with that friction.
    """

    def __init__(self, robot: StarDynamics, friction: dynamics.Friction, kernels: Any) -> None:
        super().__init__(robot, friction)
        self._robot, self._kernels = robot, kernels
        self._side = 0.0

    def closed(self, states: Array) -> Array:
        """As `Mechanics.closed`, by Newton's method."""
        q = states[..., : self._m]
        for _ in range(4):
            flags, q = self._kernels.close(q)
            if flags is None:  # it was closed to 1e-6 before this step: the next one is the last
                return self._kernels.close(q)[1]
        return super().closed(states)

    def rate(self, states: Array, tau: Array, load: Array | None) -> Array:
        """As `Mechanics.rate`."""
        moment = None if load is None else self._robot.moment_of(load)
        if load is None or moment is not None:
            answer = self._kernels.rate(states, tau, moment)
            if answer is not None and answer[0] is None:
                return answer[1]
        return super().rate(states, tau, load)

    def margin(self, state: Array, limit: float) -> float:
        """As `Mechanics.margin`, from det A."""
        # |det A| = |det Phi^u|; the squares of the six singular values sum to 8, the largest is
        # at most 3. So the five largest have a product of at most (8/5)^(5/2), the smallest is at
        # least |det A| / 3.24, and the condition number at most 3.24 sqrt(3) / |det A|.
        flags, check = self._kernels.determinant(state[: self._m])
        det = float(check[0])
        self._side = self._side or copysign(1, det)
        distance = log(limit * abs(det) / 5.62) if flags is None and det else -1.0
        if distance <= 0:
            distance = log(limit / self._chain.condition_number(self.closed(state)))
        return distance if det * self._side > 0 else -abs(distance)
