# SPDX-License-Identifier: BSD-2-Clause
"""Chooses the coordinates that describe a simulated motion, and judges its steps in them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..model.mechanism import Mechanism
from ..model.thresholds import MARGIN, WELL_CONDITIONED
from ..states import StateSpace
from .integrator_step import IntegratorStep
from .singularity_crossing import EARLIER
from .state_equations import MotionState

#: Condition number above which better coordinates are searched.
_POOR = 50.0
#: On the way to a singular configuration, the limit of the condition number is higher by this
#: factor. The condition number grows as 1 / T, where T is the time that remains. The step over the
#: singular configuration starts at T / `EARLIER` at the latest, if it is noticed at T, so the
#: condition number grows by `EARLIER`. `MARGIN` is reserve.
_NEAR_SINGULARITY = EARLIER * MARGIN


class RegularPart(NamedTuple):
    """The part of a step that is regular, from its start on.

    Attributes:
        fraction: Its length, as a fraction of the step; 1 for a regular step.
        q: The configuration at its end, shape (nq,).
    """

    fraction: float
    q: Array


class CoordinateChange:
    """Keeps a motion in coordinates that determine its other joints well.

    Good coordinates have dependent columns of Phi with a small condition number. A motion keeps its
    coordinates while this number is below `limit`, and then changes to better ones.

    The limit changes as follows. `settle` chooses coordinates and sets the limit for them, at most
    to the largest one that a user allows. On the way to a singular configuration, `allow_nearer`
    raises it, also beyond the largest one; before the step over this configuration, `restore` puts
    it back to the largest one if it is beyond. Behind the configuration, `settle_behind` chooses
    coordinates and puts the limit above their condition number, which may be beyond the largest.

    Attributes:
        limit: Largest condition number of a regular configuration in the present coordinates.
    """

    def __init__(self, robot_space: StateSpace, mechanism: Mechanism, largest: float) -> None:
        self._robot_space = robot_space
        self._mechanism = mechanism
        #: The largest limit that a user allows.
        self._largest = largest
        self.limit = 0.0  # `settle` sets it

    @property
    def at_largest(self) -> bool:
        """Whether the limit is the largest one that a user allows, or beyond it."""
        return self.limit >= self._largest

    def settle(self, state: MotionState) -> MotionState:
        """The state in good coordinates; `limit` is set for these."""
        space, condition = self._robot_space.in_good_coordinates(state.q)
        self.limit = min(self._largest, max(_POOR, MARGIN * condition))
        return state.in_coordinates_of(space)

    def settle_behind(self, state: MotionState) -> MotionState:
        """The same as `settle` just behind a singular configuration."""
        settled = self.settle(state)
        # The condition number may be above the limit that `settle` sets; it falls from here on.
        condition = settled.space.condition_number(settled.q)
        self.limit = max(self.limit, MARGIN * condition)
        return settled

    def allow_nearer(self) -> None:
        """Raise the limit, for a motion that approaches a singular configuration."""
        self.limit *= _NEAR_SINGULARITY

    def restore(self) -> None:
        """Put a limit beyond the largest one that a user allows back to it, after an approach."""
        self.limit = min(self._largest, self.limit)

    def should_settle(self, state: MotionState, *, near_singularity: bool) -> bool:
        """Whether `settle` would change the coordinates, or lower the limit much.

        There are two reasons: the robot's own coordinates are good again, or the condition number
        has fallen by MARGIN since `settle` set the limit to MARGIN times it. Near a singularity,
        only the first one counts, because the limit is high on purpose.
        """
        space = state.space
        robot_space = self._robot_space
        if space is not robot_space and robot_space.condition_number(state.q) < WELL_CONDITIONED:
            return True
        if near_singularity or self.limit <= _POOR:
            return False
        return space.condition_number(state.q) * MARGIN**2 < self.limit

    def regular_part(self, before: MotionState, step: IntegratorStep) -> RegularPart:
        """The regular part of a step from the state `before`."""
        space = before.space

        # The configuration at a fraction `high` of the step, as `StateSpace.follow` needs it.
        def path(_q: Array, _low: float, high: float) -> Array:
            if high == 1:
                return space.closed(step.y)
            return space.closed(step.dense_output(step.start + high * step.length))

        # A step there and back may be long although its ends are close. So the part up to the
        # reversal is tried first, then the rest.
        first = self._reversal(before, step)
        fraction, q = space.follow(before.q, path, self.limit, first)
        return RegularPart(fraction, q)

    def _reversal(self, before: MotionState, step: IntegratorStep) -> float:
        """The fraction of a step after which its motion reverses; 1 if it does not.

        The rates vary from a to b about linearly, a + x (b - a). Their norm is least at
        x = a.(a - b) / |a - b|^2. The motion reverses there if this norm is less than half of |a|
        and of |b|.
        """
        scale = self._mechanism.rate_scale[before.space.coordinates]
        a = before.rates / scale
        b = step.y[len(before.q) :] / scale
        x = float(a.dot(a - b) / max((a - b).dot(a - b), 1e-300))
        least = np.linalg.norm(a + x * (b - a))
        if 0 < x < 1 and least < min(np.linalg.norm(a), np.linalg.norm(b)) / 2:
            return x
        return 1.0
