# SPDX-License-Identifier: BSD-2-Clause
"""Integrates a motion with closed loops: the main loop of `simulate`.

Four objects do the work: `StepControl` makes the steps, `CoordinateChange` judges them and chooses
the coordinates, `MotionOutput` collects the results, and `SingularityCrossing` steps over singular
configurations.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from ..arrays import Array
from ..errors import SimulationError
from ..model.mechanism import Mechanism
from .coordinate_change import CoordinateChange
from .crossings import Crossing
from .motion_output import MotionOutput, Samples
from .settings import Settings
from .singularity_crossing import SingularityCrossing
from .state_equations import MotionState, StateEquations
from .step_control import StepControl

#: A repeated step is shorter than the regular part of the last one by this fraction, so that it
#: ends before the singular configuration; ten times more at each repeat.
_MARGIN_OF_REPEAT = 1e-10


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
        self._coordinates = CoordinateChange(
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

    @np.errstate(over="ignore", invalid="ignore")  # a motion that diverges ends
    def integrate(self, start: Array) -> Samples:
        """The motion from a state in the robot's coordinates, at the output times it reaches."""
        state = self._first_state(start)
        self._call_controller(state)
        self._output.add_start(self._equations_at(state), state)
        self._progress(state.t)
        while state.t < self._end and not self.stopped:
            approach = self._crossing.approach
            if approach is not None and approach.start <= state.t:
                state = self._cross(state)
                continue
            torques_change = self._call_controller(state)
            bound = min(self._end, torques_change)
            if approach is not None:
                bound = min(bound, approach.start)
            state = self._advance(state, bound, torques_change=bound == torques_change)
        return self._output.samples

    def _first_state(self, start: Array) -> MotionState:
        """The start in good coordinates.

        Raises:
            SimulationError: If the motion cannot start.
        """
        t = float(self._times[0])
        space = self._equations.robot_space
        q, rates = np.split(start, [self._nq])
        if not rates.any():  # at rest the rates of all coordinates are 0
            space, _ = space.suited(q)
        equations = self._equations.in_coordinates_of(space)
        if not np.isfinite(equations.rate(t, start)).all():
            why = equations.failure or "its rates are not finite"
            raise SimulationError(f"the motion cannot start ({why})", t)
        state = MotionState(t, space, space.closed(start), start)
        return self._coordinates.settle(state)

    def _equations_at(self, state: MotionState) -> StateEquations:
        """The equations in the coordinates of a state."""
        near_singularity = self._crossing.approach is not None
        return self._equations.in_coordinates_of(state.space, close_first=near_singularity)

    def _call_controller(self, state: MotionState) -> float:
        """Call a sampled controller if it is due; the time until which torques are smooth."""
        sampling = self._equations.torque.sampling
        if sampling is None:
            return np.inf
        sampling.reach(state.t, partial(self._equations_at(state).robot_state, state.y))
        return sampling.until(self._times)

    def _advance(self, state: MotionState, bound: float, *, torques_change: bool) -> MotionState:
        """Integrate until a time, or until other coordinates or an earlier state are needed."""
        self._crossing.remember(state)
        equations = self._equations_at(state)
        repeats = 0
        until = bound  # later the end of the regular part of a step
        solver = self._steps.solver(equations, state, until)
        while solver.status == "running":
            step = self._steps.step(solver, equations)
            if self._steps.misses_input(step):
                solver = self._steps.solver(equations, state, until)
                continue
            ends_at_change = torques_change and step.end == bound
            self._steps.go_on_after(step, torques_change=ends_at_change)
            self._progress(step.end)
            fraction, q = self._coordinates.regular_part(state, step)
            if fraction == 1 and not self._output.add_step(step, torques_change=ends_at_change):
                fraction = 0.5

            if fraction == 1:
                state = MotionState(step.end, state.space, q, step.y)
                self._crossing.remember(state)
                if until < bound and solver.status == "finished":
                    return self._leave_irregular(state)
                settled = self._improve_coordinates(state)
                if settled.space is not state.space:
                    return settled
                continue

            self._steps.shorten(fraction)
            t = step.start + fraction * step.length
            earlier = self._crossing.begin_approach(state, t, q)
            if earlier is not None:
                self._coordinates.allow_nearer()
                return earlier
            # A part of a step is less exact than a step: integrate again until there.
            until = t - (t - state.t) * min(0.5, _MARGIN_OF_REPEAT * 10**repeats)
            repeats += 1
            if until <= state.t:
                return self._leave_irregular(state)
            solver = self._steps.solver(equations, state, until)
        return state

    def _improve_coordinates(self, state: MotionState) -> MotionState:
        """The state after a regular step, in better coordinates if there are any."""
        near_singularity = self._crossing.approach is not None
        if not self._coordinates.better_exist(state, near_singularity=near_singularity):
            return state
        self._crossing.approach = None
        return self._coordinates.settle(state)

    def _leave_irregular(self, state: MotionState) -> MotionState:
        """The state before an irregular step, in better coordinates; without any, the motion ends.

        It also ends where its steps become too short.
        """
        coordinates = self._coordinates
        limit_was_largest = coordinates.at_largest
        self._crossing.approach = None
        settled = coordinates.settle(state)
        same_space = settled.space is state.space
        no_better = same_space and limit_was_largest and coordinates.at_largest
        if no_better or self._steps.stuck:
            self.stopped = (
                f"stopped at t = {state.t:.9g} s before a singularity: "
                f"condition number {coordinates.limit:g}{self._crossing.problem}"
            )
        return settled

    def _cross(self, state: MotionState) -> MotionState:
        """The state behind the singular configuration that is near; the same state without one."""
        self._coordinates.restore()
        equations = self._equations_at(state)
        crossed = self._crossing.cross(equations, state)
        if crossed is None:
            return state
        behind, branch = crossed
        self._output.add_branch(equations, branch, behind.t)
        return self._coordinates.settle_behind(behind)
