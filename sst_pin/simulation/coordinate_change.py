# SPDX-License-Identifier: BSD-2-Clause
"""Chooses the coordinates that describe a simulated motion, and judges its steps in them."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..model.mechanism import Mechanism
from ..model.thresholds import MARGIN, WELL_CONDITIONED
from ..states import StateSpace
from .integrator_step import IntegratorStep
from .state_equations import MotionState

#: Condition number above which better coordinates are searched.
_POOR = 50.0
#: On the way to a singular configuration, the limit of the condition number is higher by this
#: factor: a motion that starts to step over it at four times the remaining time needs four.
_NEAR_SINGULARITY = 4.0 * MARGIN


class CoordinateChange:
    """Keeps a motion in coordinates that determine its other joints well.

    Good coordinates have dependent columns of Phi with a small condition number. A motion keeps its
    coordinates while this number is below `limit`, and then changes to better ones.

    Attributes:
        limit: Largest condition number of a regular configuration in the present coordinates.
    """

    def __init__(self, robot_space: StateSpace, mechanism: Mechanism, largest: float) -> None:
        self._robot_space = robot_space
        self._mechanism = mechanism
        self._largest = largest
        self.limit = 0.0

    @property
    def at_largest(self) -> bool:
        """Whether the limit is the largest one that a user allows, or more."""
        return self.limit >= self._largest

    def settle(self, state: MotionState) -> MotionState:
        """The state in good coordinates; `limit` is set for these."""
        space, condition = self._robot_space.suited(state.q)
        self.limit = min(self._largest, max(_POOR, MARGIN * condition))
        return state.in_coordinates_of(space)

    def settle_behind(self, state: MotionState) -> MotionState:
        """The same as `settle` just behind a singular configuration."""
        settled = self.settle(state)
        # The condition number falls from here on.
        condition = settled.space.condition_number(settled.q)
        self.limit = max(self.limit, MARGIN * condition)
        return settled

    def allow_nearer(self) -> None:
        """Raise the limit, for a motion that approaches a singular configuration."""
        self.limit *= _NEAR_SINGULARITY

    def restore(self) -> None:
        """Lower the limit to the largest one that a user allows, after an approach."""
        self.limit = min(self._largest, self.limit)

    def better_exist(self, state: MotionState, *, near_singularity: bool) -> bool:
        """Whether the robot's coordinates are good again, or the condition far below its limit.

        Near a singularity, the limit is high on purpose, so that only the first reason counts.
        """
        space = state.space
        robot_space = self._robot_space
        if space is not robot_space and robot_space.condition_number(state.q) < WELL_CONDITIONED:
            return True
        if near_singularity or self.limit <= _POOR:
            return False
        return space.condition_number(state.q) * MARGIN**2 < self.limit

    def regular_part(self, before: MotionState, step: IntegratorStep) -> tuple[float, Array]:
        """The fraction of a step from a state that is regular, and the configuration at its end."""
        space = before.space

        def path(q: Array, low: float, high: float) -> Array:
            if high == 1:
                return space.closed(step.y)
            return space.closed(step.dense_output(step.start + high * step.length))

        # A step there and back may be long although its ends are close, so the way back is tried
        # separately.
        first = self._reversal(before, step)
        return space.follow(before.q, path, self.limit, first)

    def _reversal(self, before: MotionState, step: IntegratorStep) -> float:
        """The fraction of a step after which its motion reverses; 1 if it does not.

        The rates vary from a to b about linearly, a + x (b - a). Their norm is least at
        x = a.(a - b) / |a - b|^2. If it is less than half of that at both ends, they reverse.
        """
        scale = self._mechanism.rate_scale[before.space.coordinates]
        a = before.rates / scale
        b = step.y[len(before.q) :] / scale
        x = float(a.dot(a - b) / max((a - b).dot(a - b), 1e-300))
        least = np.linalg.norm(a + x * (b - a))
        if 0 < x < 1 and least < min(np.linalg.norm(a), np.linalg.norm(b)) / 2:
            return x
        return 1.0
