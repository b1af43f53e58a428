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

#: Coordinates with a smaller condition number are good enough: the limit of the condition number is
#: at least this, unless a user sets a smaller one.
_POOR = 50.0
#: On the way to a singular configuration, the limit of the condition number is higher by this
#: factor. The condition number grows as the inverse of the time that remains until the singular
#: configuration. When a step shows this configuration, a time T remains. The step over it starts
#: when T / `EARLIER` remains, or before. Until then the condition number grows by the factor
#: `EARLIER` at most. `MARGIN` is a reserve.
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

    With good coordinates, the columns of Phi of the other joints have a small condition number. A
    motion keeps its coordinates while this number is below `limit`, and then changes to better
    ones. These methods change the limit:

    - `settle` chooses coordinates and sets the limit for them, at most to the largest limit that a
      user allows.
    - `allow_nearer` raises the limit on the way to a singular configuration, perhaps beyond the
      largest one.
    - `restore` lowers the limit to the largest one if no step leads over this configuration.
    - `settle_behind` chooses coordinates behind the configuration, and sets a limit above their
      condition number, perhaps beyond the largest one.

    Attributes:
        limit: Largest condition number of a regular configuration in the present coordinates.
    """

    def __init__(self, robot_space: StateSpace, mechanism: Mechanism, largest: float) -> None:
        self._robot_space = robot_space
        self._mechanism = mechanism
        #: The largest limit that a user allows, `max_condition_number`.
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
        """Lower the limit to the largest one that a user allows, after a failed crossing."""
        self.limit = min(self._largest, self.limit)

    def should_settle(self, state: MotionState, *, near_singularity: bool) -> bool:
        """Whether `settle` would change the coordinates, or lower the limit much.

        Near a singularity a high limit is no reason, because `allow_nearer` has raised it.
        """
        # The robot's own coordinates are good again.
        space = state.space
        robot_space = self._robot_space
        if space is not robot_space and robot_space.condition_number(state.q) < WELL_CONDITIONED:
            return True

        # The limit is much higher than the one that `settle` would set for the same coordinates,
        # `MARGIN` times their condition number. The second `MARGIN` keeps this from happening again
        # and again: after `settle`, the condition number must fall by this factor once more.
        if near_singularity or self.limit <= _POOR:
            return False
        new_limit = MARGIN * space.condition_number(state.q)  # `settle` sets at least `_POOR`
        return new_limit * MARGIN < self.limit

    def regular_part(self, before: MotionState, step: IntegratorStep) -> RegularPart:
        """The regular part of a step from the state `before`."""
        space = before.space

        def path(_q: Array, _previous_fraction: float, fraction: float) -> Array:
            """The configuration at a fraction of the step, as `StateSpace.follow` calls it."""
            if fraction == 1:
                return space.closed(step.y)
            return space.closed(step.dense_output(step.start + fraction * step.length))

        # A step there and back may be long although its ends are close. So `follow` first tries the
        # part up to the reversal.
        regular_fraction, q = space.follow(before.q, path, self.limit, self._reversal(before, step))
        return RegularPart(regular_fraction, q)

    def _reversal(self, before: MotionState, step: IntegratorStep) -> float:
        """The fraction of a step after which its motion reverses; 1 if it does not.

        The rates vary from a at the start to b at the end about linearly: at the fraction x they
        are a + x (b - a). Their norm is least at x = a.(a - b) / |a - b|^2. The motion reverses
        there if this least norm is less than half of |a| and less than half of |b|.
        """
        scale = self._mechanism.rate_scale[before.space.coordinates]  # to compare metres, radians
        a = before.rates / scale
        b = step.y[len(before.q) :] / scale
        x = float(a.dot(a - b) / max((a - b).dot(a - b), 1e-300))
        least_norm = np.linalg.norm(a + x * (b - a))
        if 0 < x < 1 and least_norm < min(np.linalg.norm(a), np.linalg.norm(b)) / 2:
            return x
        return 1.0
