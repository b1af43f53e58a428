# SPDX-License-Identifier: BSD-2-Clause
"""What an integrator asks of a robot, on the reference path and by the kernels."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import dynamics
from .closures import CLOSURE_TOLERANCE

if TYPE_CHECKING:
    from .closed_chain import ClosedChain

Array = NDArray[np.float64]


#: Of Newton's method, which squares a gap that is small at all.
_STEPS = 6


class Mechanics:
    """Closures and direct dynamics of a chain with a friction of its own: the reference path.

    Args:
        chain: The robot.
        friction: In the place of the robot's.
    """

    def __init__(self, chain: ClosedChain, friction: dynamics.Friction) -> None:
        self._chain, self._friction = chain, friction

    def closed(self, q: Array) -> Array:
        """q with the passive joints moved onto the closures, shape (m,) or (N, m).

        Raises:
            ClosureError: When they are out of reach.
        """
        if q.ndim == 1:
            return self._chain.assemble(q)
        return np.array([self._chain.assemble(one) for one in q])

    def accelerations(
        self,
        q: Array,
        va: Array,
        tau: Array,
        load: Array | None,
        tolerance: float = CLOSURE_TOLERANCE,
    ) -> tuple[Array, Array]:
        """Accelerations of the motors and rates of all joints, one sample or N of them.

        Args:
            q: On the closures, shape (m,) or (N, m).
            va: Shape (n,) or (N, n).
            tau: Shape (n,) or (N, n).
            load: External wrenches, shape (r, 6) or (N, r, 6), or None.
            tolerance: How far the loops may be open, [m] or [rad].

        Raises:
            ClosureError, SingularConfigurationError: As `ClosedChain.compute_accelerations`.
        """
        if q.ndim == 1:
            workspace = self._chain.workspace_at(q, tolerance)
            return dynamics.direct_dynamics(*workspace, self._friction, q, va, tau, load)
        loads = [None] * len(q) if load is None else load
        samples = zip(q, va, tau, loads, strict=True)
        each = [self.accelerations(*sample, tolerance) for sample in samples]
        aa, q_dot = zip(*each, strict=True)
        return np.array(aa), np.array(q_dot)


class FastMechanics(Mechanics):
    """The same by compiled kernels; the reference path does what they do not vouch for.

    Args:
        chain: The robot.
        friction: In the place of the robot's.
        kernels: Made with that friction.
    """

    def __init__(self, chain: ClosedChain, friction: dynamics.Friction, kernels: Any) -> None:
        super().__init__(chain, friction)
        self._kernels = kernels

    def closed(self, q: Array) -> Array:
        """As `Mechanics.closed`, by Newton's method."""
        near = q
        for _ in range(_STEPS):
            flags, near = self._kernels.close(near, None, 1)
            if flags is None:  # it was closed to 1e-6 before this step: the next one is the last
                return self._kernels.close(near, None, 1)[1]
        return super().closed(q)

    def accelerations(
        self,
        q: Array,
        va: Array,
        tau: Array,
        load: Array | None,
        tolerance: float = CLOSURE_TOLERANCE,
    ) -> tuple[Array, Array]:
        """As `Mechanics.accelerations`."""
        if load is None:
            answer = self._kernels.direct_dynamics(q, va, tau, None, None, None, 1)
            if answer is not None and answer[0] is None:
                return answer[2], answer[1]
        return super().accelerations(q, va, tau, load, tolerance)
