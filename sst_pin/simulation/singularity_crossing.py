# SPDX-License-Identifier: BSD-2-Clause
"""Carries a simulated motion through the singular configurations that are ahead of it.

At a singular configuration of the mechanism, the whole Phi loses rank. At other configurations only
the dependent columns of Phi lose rank: there other coordinates help, and `CoordinateChange` chooses
them. This module is about singular configurations of the mechanism.

An integrator cannot step over such a configuration, and the accelerations are noisy next to it. So
`begin_approach` sends the motion back, and it is integrated until some time before the
configuration. From there `cross` makes one step, by the functions of `crossings`, to a state as
long after the configuration.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..errors import SSTError
from ..model.mechanism import Mechanism
from .crossings import (
    Branch,
    BranchError,
    Crossing,
    crossing_of,
    gauss_step,
    mismatch,
    singular_values,
)
from .settings import Settings
from .state_equations import MotionState, StateEquations

#: The most states from which a motion is extrapolated through a singular configuration.
_EXTRAPOLATED = 6
#: The time from each of these states to the singular configuration is longer than the time from the
#: next later state to it, by more than this factor.
_SPREAD = 1.5
#: When an irregular step shows a singular configuration, a time T remains until the motion reaches
#: it. The motion goes back, and the step over the configuration starts `EARLIER` T before it. If
#: the motion ends soon, the step starts later, T / `EARLIER` before it at the latest.
EARLIER = 4.0
#: The step is repeated until its middle is at the singular configuration. The middle may differ by
#: this part of half the step. After `_STEPS` tries the last step is taken.
_CENTRED = 0.01
_STEPS = 3
#: The step is accepted if the `mismatch` of its end and of the branch, relative to the motion in
#: the step, is less than max(_EXACT, _TOLERANCES * rtol).
_EXACT = 1e-7
_TOLERANCES = 100.0


class Approach(NamedTuple):
    """A singular configuration that a motion approaches.

    Attributes:
        start: When the step over it starts, [s].
        singular: When the motion is expected to reach it, [s].
    """

    start: float
    singular: float

    @property
    def remaining(self) -> float:
        """Time from the start of the step to the singular configuration, [s]."""
        return self.singular - self.start


class _StepOver(NamedTuple):
    """A step over a singular configuration.

    Attributes:
        crossing: The singular configuration.
        branch: The motion through it.
        behind: The state at the end of the step.
    """

    crossing: Crossing
    branch: Branch
    behind: MotionState


class SingularityCrossing:
    """Notices singular configurations ahead of a motion, and steps over them.

    Attributes:
        approach: The singular configuration that the motion approaches, or None.
        crossings: The singular configurations that the motion went through.
        problem: Why the motion did not go through the last one, as the end of a sentence.
    """

    def __init__(self, mechanism: Mechanism, settings: Settings, end: float) -> None:
        self._mechanism = mechanism
        self._active = settings.through_singularities
        self._largest_mismatch = max(_EXACT, _TOLERANCES * settings.rtol)
        self._end = end
        #: States at the ends of the last steps. They are three times as many as are used, because
        #: `begin_approach` removes the latest ones.
        self._past = deque[MotionState](maxlen=3 * _EXTRAPOLATED)
        #: The end of the regular part of the step that showed the last singular configuration, [s].
        self._noticed = -np.inf
        self.approach: Approach | None = None
        self.crossings = list[Crossing]()
        self.problem = ""

    def remember(self, state: MotionState) -> None:
        """Add a state to those from which the motion is extrapolated.

        The state added last may be added again: `_last_states` uses it once.
        """
        self._past.append(state)

    def give_up(self) -> None:
        """End an approach without a step."""
        self.approach = None

    def begin_approach(self, state: MotionState, t: float, q: Array) -> MotionState | None:
        """Begin to approach a singular configuration that is ahead of q at time t.

        Args:
            state: The last state before t.
            t: Time, [s].
            q: The configuration at this time.

        Returns:
            An earlier state, from which the motion is integrated again until `approach.start`. It
            is None, and nothing is changed, if no singular configuration of the mechanism is ahead,
            or if no step can lead over it.
        """
        if not self._active or self.approach is not None:
            return None
        approach = self._approach_of(state, t, q)
        if approach is None:
            return None
        self._noticed = t
        # The last state before the start of the step; the oldest state if all are later.
        while len(self._past) > 1 and self._past[-1].t > approach.start:
            self._past.pop()
        earlier = self._past[-1].in_coordinates_of(state.space)
        start = max(approach.start, earlier.t)
        self.approach = Approach(start, approach.singular)
        return earlier

    def _approach_of(self, state: MotionState, t: float, q: Array) -> Approach | None:
        """The singular configuration ahead of q at time t; None if no step can lead over it.

        The smallest singular value of Phi, redundant rows left out, falls from a at `state` to b at
        q. A line through both is zero at the time (t - state.t) b / (a - b) after t.
        """
        space = state.space
        good_space, _ = space.in_good_coordinates(q)
        if good_space is not space:
            return None  # only the dependent columns of Phi are singular
        a = float(singular_values(space, state.q)[-1])
        b = float(singular_values(space, q)[-1])
        if not b < a:
            return None  # the motion does not come nearer to a singular configuration
        if t <= self._noticed:
            return None  # it was noticed before, and no step led over it
        remaining = (t - state.t) * b / (a - b)  # the time T in the comment at `EARLIER`
        singular = t + remaining
        # The step ends as long after the singular configuration as it starts before it, and it must
        # end before the motion does. As `singular` is an estimate, the step takes at most half of
        # the time from there to the end of the motion.
        half_step = min(EARLIER * remaining, (self._end - singular) / 2)
        if half_step < remaining / EARLIER:
            return None  # too near to the end of the motion for a step over it
        return Approach(singular - half_step, singular)

    def cross(
        self, equations: StateEquations, state: MotionState
    ) -> tuple[MotionState, Branch] | None:
        """Step over the singular configuration that is approached.

        Args:
            equations: The equations of the motion.
            state: The state at `approach.start`, the last one that `remember` got.

        Returns:
            The state behind the singular configuration, and the motion to there. It is None if no
            such motion is found. Then `approach` has a later start for another try, or is None.
        """
        approach = self.approach
        assert approach is not None
        self.approach = None
        self.problem = ""
        try:
            step = self._step_over(equations, state, approach)
        except BranchError as error:
            self.problem = f"; {error}"
        except SSTError as error:
            self.problem = f"; the motion behind it is not found ({error})"
        else:
            self.crossings.append(step.crossing)
            self._past.clear()
            return step.behind, step.branch
        # Another try starts after half of the remaining time; the caller integrates until then. It
        # must not start after the time at which the singular configuration was noticed, because
        # accelerations are noisy from then on. (Only the first try may, if the motion ends soon.)
        later_start = approach.start + approach.remaining / 2
        if later_start <= self._noticed:
            self.approach = Approach(later_start, approach.singular)
        return None

    def _step_over(
        self, equations: StateEquations, state: MotionState, approach: Approach
    ) -> _StepOver:
        """The step from a state over the singular configuration that is approached.

        The step is repeated until its middle is at the singular configuration, because each step
        shows more exactly where the singular configuration is.

        Raises:
            BranchError: If the branch is not determined, or does not continue the motion.
        """
        space = state.space
        remaining = approach.remaining  # the first estimate of half the step, kept in all tries
        # The first branch extrapolates the past states. Each further branch goes through the start
        # and the stages of the last step.
        branch = self._branch(equations, self._last_states(approach), remaining)
        crossing = crossing_of(space, branch, state.t, remaining)
        for _ in range(_STEPS):
            middle = crossing.time
            end = 2 * middle - state.t
            times, ys = gauss_step(space, equations.rate, state.t, state.y, end, branch)
            stages = []
            for time, y in zip(times[1:-1], ys[1:-1], strict=True):
                stages.append(MotionState(time, space, y[: len(state.q)], y))
            branch = self._branch(equations, [state, *stages], remaining)
            crossing = crossing_of(space, branch, state.t, remaining)
            if abs(crossing.time - middle) < _CENTRED * remaining:
                break
        # `mismatch` decides whether the last step is exact, even if it is not quite centred.
        y_end = ys[-1]
        q, v, _ = equations.joint_motion(end, y_end)
        error = mismatch(self._mechanism, branch, end, q, v, end - state.t)
        if not error < self._largest_mismatch:
            raise BranchError(f"the motion behind it does not continue this one (by {error:.1g})")
        return _StepOver(crossing, branch, MotionState(end, space, q, y_end))

    def _last_states(self, approach: Approach) -> list[MotionState]:
        """Past states before a singular configuration, the last one first, spread over the time."""
        chosen = [self._past[-1]]
        for state in reversed(self._past):
            farthest = approach.singular - chosen[-1].t
            if approach.singular - state.t > _SPREAD * farthest:
                chosen.append(state)
            if len(chosen) == _EXTRAPOLATED:
                break
        return chosen

    def _branch(
        self, equations: StateEquations, states: Sequence[MotionState], unit: float
    ) -> Branch:
        """The smooth motion through some states; `unit` is a unit of time, see `Branch`."""
        motions = []
        for state in states:
            in_coordinates = equations.in_coordinates_of(state.space)
            motions.append(in_coordinates.joint_motion(state.t, state.y))
        q, v, v_dot = (np.array(arrays) for arrays in zip(*motions, strict=True))
        times = np.array([state.t for state in states])
        return Branch(self._mechanism, times, q, v, v_dot, unit)
