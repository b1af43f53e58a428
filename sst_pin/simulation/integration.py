# SPDX-License-Identifier: BSD-2-Clause
"""Integrates a motion with closed loops: the main loop of `simulate`.

The state of an integrator has q and the rates of the coordinates, which are joints whose rates
determine those of all others. Where they do not determine them well, the motion goes on in other
coordinates. At a singular configuration of the mechanism there are no better ones.

Four objects do the work: `StepControl` makes the steps, `CoordinateChange` judges them and chooses
the coordinates, `MotionOutput` collects the results, and `SingularityCrossing` steps over singular
configurations.

A step is *regular* if all of these conditions hold:

- The joints move continuously along it, without a jump to another assembly mode.
- The condition number of the dependent joints stays below a *limit*. The dependent joints are all
  joints but the coordinates, and their condition number is that of their columns of Phi.
  `CoordinateChange` sets the limit for each choice of coordinates, and may raise it later.
- The loops can be closed at the output times within the step.

Each other step is *irregular*. Its *regular part* is the longest part from its start on for which
the first two conditions hold.

`Integration.integrate` is the main loop. It calls one of two methods, again and again:

- `_advance` integrates to a target: the end of the motion, the next change of sampled torques, or
  the start of a step over a singular configuration. Each integrator of SciPy stays in one choice of
  coordinates, and `_make_steps` makes its steps.
- `_cross` makes a step over a singular configuration.

A step that misses a change of a torque or load is made again with a shorter length, and with the
same target. After an irregular step, `_before_irregular` chooses one of two ways to go on:

- If a singular configuration is ahead that can be stepped over, the motion begins to approach it.
  It returns to an earlier state, and is integrated from there until the start of the step over this
  configuration.
- Otherwise the irregular step is *repeated*, with an earlier target: just before the end of its
  regular part. There `_leave_irregular` changes the coordinates, or ends the motion.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..errors import SimulationError
from ..model.mechanism import Mechanism
from .coordinate_change import CoordinateChange, RegularPart
from .crossings import Crossing
from .integrator_step import IntegratorStep
from .motion_output import MotionOutput
from .settings import Settings
from .singularity_crossing import SingularityCrossing
from .state_equations import MotionState, Samples, StateEquations
from .step_control import StepControl

#: An irregular step is repeated with a target that is earlier than the end of its regular part, by
#: this fraction of the length of this part. The fraction is larger than the error of the regular
#: part, which `Continuity.follow` finds to 1e-12 of the step.
_MARGIN_OF_REPEAT = 1e-10


class _Target(NamedTuple):
    """The time until which steps are made.

    Attributes:
        time: Time, [s].
        torques_change: Whether sampled torques change at this time.
        repeats: How many irregular steps have set the time back, one after the other. The time is
            just before the irregular part of the last one. It is 0 if none has; a step that is
            made again because it missed a change of a torque or load does not count.
    """

    time: float
    torques_change: bool = False
    repeats: int = 0


class _Continuation(NamedTuple):
    """How a motion goes on after the steps of one integrator.

    Attributes:
        state: The state from which it goes on.
        target: The target of the next integrator in the same coordinates. It is the same target if
            the last step missed a change of a torque or load, and an earlier one if the last step
            was irregular. It is None if `_advance` is finished: the target is reached, the
            coordinates have changed, or the motion has begun to approach a singular configuration.
    """

    state: MotionState
    target: _Target | None


class Integration:
    """Integrates equations of motion step by step, in coordinates that suit each state.

    Args:
        equations: The equations in the robot's coordinates.
        mechanism: The robot.
        times: Output times, shape (N,), [s].
        settings: How to integrate.
        exact: Whether the derivatives of the equations are exact.

    Attributes:
        stopped: Why the motion ended before the last time; empty if it did not.
    """

    def __init__(
        self,
        equations: StateEquations,
        mechanism: Mechanism,
        times: Array,
        settings: Settings,
        *,
        exact: bool,
    ) -> None:
        self._equations = equations
        self._times = times
        self._end = float(times[-1])
        self._nq = mechanism.model.nq
        self._progress = settings.progress or (lambda time: None)
        self._steps = StepControl(equations, times, settings, exact=exact)
        self._coordinate_change = CoordinateChange(
            equations.robot_space, mechanism, settings.max_condition_number
        )
        self._output = MotionOutput(times)
        self._crossing = SingularityCrossing(mechanism, settings, self._end)
        self.stopped = ""

    @property
    def missed(self) -> str:
        """Where no step was short enough for a torque or load; empty if there is no such place."""
        return self._steps.missed

    @property
    def crossings(self) -> list[Crossing]:
        """The singular configurations that the motion went through."""
        return self._crossing.crossings

    # Numbers overflow in a motion that diverges. The motion ends there, without NumPy's warnings.
    @np.errstate(over="ignore", invalid="ignore")
    def integrate(self, start: Array) -> Samples:
        """The motion from a state in the robot's coordinates, at the output times it reaches."""
        state = self._first_state(start)
        self._call_controller(state)
        self._output.add_start(self._equations_at(state), state)
        self._progress(state.t)
        while state.t < self._end and not self.stopped:
            approach = self._crossing.approach
            if approach is not None and approach.start <= state.t:
                # If no step leads over the singular configuration from here, `_cross` returns the
                # same state. Then the approach has a later start, from which a step is tried again,
                # or it is given up. In both cases the next call is one of `_advance`, so this loop
                # cannot stop here.
                state = self._cross(state)
            else:
                state = self._advance(state)
        return self._output.samples

    def _first_state(self, start: Array) -> MotionState:
        """The start in good coordinates.

        Raises:
            SimulationError: If the motion cannot start.
        """
        t = float(self._times[0])
        space = self._equations.robot_space
        q, rates = np.split(start, [self._nq])
        if not rates.any():
            # At rest the rates of any coordinates are zero. So the start is the same state in other
            # coordinates, even if those of the robot are singular there.
            space, _ = space.in_good_coordinates(q)
        equations = self._equations.in_coordinates_of(space)
        if not np.isfinite(equations.rate(t, start)).all():
            why = equations.failure or "its rates are not finite"
            raise SimulationError(f"the motion cannot start ({why})", t)
        state = MotionState(t, space, space.closed(start), start)
        return self._coordinate_change.settle(state)

    def _equations_at(self, state: MotionState) -> StateEquations:
        """The equations in the coordinates of a state."""
        # Near a singular configuration they close the loops of each state first, because small
        # errors of q change the accelerations too much there.
        near_singularity = self._crossing.approach is not None
        return self._equations.in_coordinates_of(state.space, close_first=near_singularity)

    def _call_controller(self, state: MotionState) -> float:
        """Call a sampled controller if its period begins, and change the torques if it is time.

        The controller is called once in each of its periods, so a second call of this method at the
        same time does nothing.

        Returns:
            The time until which torques are smooth, [s]; infinite without a sampled controller.
        """
        sampling = self._equations.torque.sampling
        if sampling is None:
            return np.inf
        robot_state = partial(self._equations_at(state).robot_state, state.y)
        sampling.go_on(state.t, robot_state)
        # A change that differs from an output time by rounding only is moved to this time.
        return sampling.next_change(self._times)

    def _advance(self, state: MotionState) -> MotionState:
        """Integrate until torques change, a step over a singular configuration starts, or the end.

        It returns before that if the coordinates change, or if the motion begins to approach a
        singular configuration. In the second case it returns an earlier state.
        """
        smooth_until = self._call_controller(state)
        time = min(self._end, smooth_until)
        if self._crossing.approach is not None:
            time = min(time, self._crossing.approach.start)
        target: _Target | None = _Target(time, torques_change=time == smooth_until)

        self._crossing.remember(state)
        equations = self._equations_at(state)
        while target is not None:
            state, target = self._make_steps(equations, state, target)
        return state

    def _make_steps(
        self, equations: StateEquations, state: MotionState, target: _Target
    ) -> _Continuation:
        """Make steps with one integrator until a target, or until a step has to be repeated."""
        solver = self._steps.solver(equations, state, target.time)
        # The solver runs until the target; `step` raises an error if it fails.
        while solver.status == "running":
            step = self._steps.step(solver, equations)
            if self._steps.shorten_if_input_missed(step):
                return _Continuation(state, target)  # make it again, to the same target
            at_change = target.torques_change and step.end == target.time
            self._steps.remember_length(step, torques_change_at_end=at_change)
            self._progress(step.end)

            part = self._coordinate_change.regular_part(state, step)
            if part.fraction < 1:
                return self._before_irregular(state, step, part, target)
            added = self._output.add_step(step, torques_change_at_end=at_change)
            if not added:  # the loops cannot be closed at an output time within the step
                return self._before_irregular(state, step, part, target)

            state = MotionState(step.end, state.space, part.q, step.y)
            self._crossing.remember(state)
            if target.repeats > 0 and step.end == target.time:
                # `_before_irregular` has set the target to this time, just before the irregular
                # part of an earlier step.
                return _Continuation(self._leave_irregular(state), None)
            settled = self._improve_coordinates(state)
            if settled.space is not state.space:
                return _Continuation(settled, None)
        return _Continuation(state, None)

    def _before_irregular(
        self,
        state: MotionState,
        step: IntegratorStep,
        part: RegularPart,
        target: _Target,
    ) -> _Continuation:
        """How a motion goes on after an irregular step; the next step is shorter in any case.

        - If a singular configuration is ahead that can be stepped over, the motion returns to an
          earlier state and approaches this configuration.
        - Otherwise the motion is integrated again from `state` until just before the irregular part
          of the step, because the interpolated states within a step are less exact than the states
          at the ends of steps. At the new target, `_make_steps` changes the coordinates or ends the
          motion.
        - If no part of the step is regular, the coordinates are changed, or the motion ends, at
          once.

        Args:
            state: The state at the start of the step.
            step: The step.
            part: Its regular part. It is the whole step if the step is irregular only because the
                loops cannot be closed at an output time within it.
            target: The target of the step.
        """
        # If `part` is the whole step, the loops cannot be closed from an unknown time on, before
        # one of the output times. Then the target is set back to about the middle of the step.
        is_whole_step = part.fraction == 1
        fraction_to_target = 0.5 if is_whole_step else part.fraction
        self._steps.shorten(fraction_to_target)

        part_end = step.start + part.fraction * step.length  # the time at which q is `part.q`
        earlier = self._crossing.begin_approach(state, part_end, part.q)
        if earlier is not None:
            # The condition number grows on the way to the singular configuration.
            self._coordinate_change.allow_nearer()
            return _Continuation(earlier, None)

        length_to_target = fraction_to_target * step.length
        time = step.start + length_to_target * (1 - _margin_of_repeat(target.repeats))
        if time <= step.start:  # no part of the step is regular
            return _Continuation(self._leave_irregular(state), None)
        return _Continuation(state, _Target(time, repeats=target.repeats + 1))

    def _improve_coordinates(self, state: MotionState) -> MotionState:
        """The state after a regular step, in better coordinates if there are any.

        If there are none, the state is the same, and perhaps the condition number has a new limit.
        """
        near_singularity = self._crossing.approach is not None
        if not self._coordinate_change.should_settle(state, near_singularity=near_singularity):
            return state
        # `should_settle` is true for one of two reasons: the robot's own coordinates are good
        # again, or the limit is too high. During an approach, when `near_singularity` is true, it
        # ignores the second reason. So here the robot's own coordinates are good, no singular
        # configuration of the mechanism is near any more, and an approach ends.
        self._crossing.give_up()
        return self._coordinate_change.settle(state)

    def _leave_irregular(self, state: MotionState) -> MotionState:
        """The state before the irregular part of a step, in better coordinates if there are any.

        Better coordinates, or a higher limit of the condition number in the same coordinates, can
        make the next steps regular. So the motion ends if `settle` keeps the coordinates, and the
        limit is the largest one both before and after `settle`. A limit that was lower before may
        have been raised by `settle`. A limit that is lower after may be raised by a later call. The
        motion also ends if its steps become too short.

        An approach of a singular configuration is given up, because the way to it is irregular.
        """
        coordinate_change = self._coordinate_change
        limit_was_largest = coordinate_change.at_largest
        self._crossing.give_up()
        settled = coordinate_change.settle(state)  # sets a new limit
        limit_stays_largest = limit_was_largest and coordinate_change.at_largest
        nothing_changes = settled.space is state.space and limit_stays_largest
        if nothing_changes or self._steps.stuck:
            where = "before a singularity"
            if not nothing_changes:
                where = "because the steps become too short"
            condition = settled.space.condition_number(settled.q)
            self.stopped = (
                f"stopped at t = {state.t:.9g} s {where}: "
                f"condition number {condition:.5g}{self._crossing.problem}"
            )
        return settled

    def _cross(self, state: MotionState) -> MotionState:
        """The state behind the singular configuration; the same state if no step leads there."""
        equations = self._equations_at(state)
        crossed = self._crossing.cross(equations, state)
        if crossed is None:
            # `allow_nearer` has raised the limit for the approach, perhaps beyond the largest one
            # that a user allows. The motion goes on to another try, or to an irregular step, and
            # from here on its limit is at most the user's.
            self._coordinate_change.restore()
            return state
        behind, branch = crossed
        self._output.add_branch(equations, branch, behind.t)
        # The condition number is still large just behind the singular configuration.
        # `settle_behind` sets a limit above it.
        return self._coordinate_change.settle_behind(behind)


def _margin_of_repeat(repeats: int) -> float:
    """The margin before the irregular part of a step, as a fraction of the regular part's length.

    `repeats` is the number of repeats before this one. The margin grows tenfold with each of them,
    to half of the length.
    """
    tens = min(repeats, 10)  # 10 tens are enough for half of the length; many would overflow
    return min(0.5, _MARGIN_OF_REPEAT * 10.0**tens)
