# SPDX-License-Identifier: BSD-2-Clause
"""Arguments and results of rollouts with a fixed step."""

from __future__ import annotations

from typing import NamedTuple

from ..arrays import Array


class RolloutArrays(NamedTuple):
    """Arrays of N rollouts with a fixed step.

    Attributes:
        dt: Length of a step, [s].
        q0: Starts, shape (N, nq).
        va0: Rates at the starts, shape (N, n).
        tau: Torques that are constant in each step, shape (N, steps, motors), or those at the
            start, the middle and the end of each step, shape (N, 2 steps + 1, motors).
        load: Constant external wrenches [force; moment] on all r bodies at their mass centres, base
            axes, shape (N, 6 r), or None.
        q: Configurations to fill, shape (N, steps + 1, nq); NaN after the end of a motion.
        va: Rates to fill, shape (N, steps + 1, n).
    """

    dt: float
    q0: Array
    va0: Array
    tau: Array
    load: Array | None
    q: Array
    va: Array

    @property
    def steps(self) -> int:
        """Number of steps."""
        return self.q.shape[1] - 1

    @property
    def constant_torques(self) -> bool:
        """Whether torques are constant in each step."""
        return self.tau.shape[1] == self.steps

    def torques(self, i: int, s: int) -> Array:
        """Torques of rollout i at the start, middle and end of step s, shape (3, motors)."""
        if self.constant_torques:
            return self.tau[i, [s, s, s]]
        return self.tau[i, 2 * s : 2 * s + 3]

    def rest(self, i: int, first: int) -> RolloutArrays:
        """The rest of rollout i alone: from its state number `first` on.

        q and va of the result are views of those of this object.
        """
        motion = slice(i, i + 1)
        q0 = self.q0[motion]
        va0 = self.va0[motion]
        if first > 0:
            q0 = self.q[motion, first].copy()
            va0 = self.va[motion, first].copy()
        first_torque = first if self.constant_torques else 2 * first
        return RolloutArrays(
            dt=self.dt,
            q0=q0,
            va0=va0,
            tau=self.tau[motion, first_torque:],
            load=None if self.load is None else self.load[motion],
            q=self.q[motion, first:],
            va=self.va[motion, first:],
        )
