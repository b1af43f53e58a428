# SPDX-License-Identifier: BSD-2-Clause
"""Steps of SciPy's integrators: how long they may be, and how exact they have to be."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array
from ..errors import SimulationError
from ..model.thresholds import MARGIN
from .input_watch import InputWatch
from .integrator_step import IntegratorStep
from .settings import IMPLICIT, Settings
from .state_equations import MotionState, StateEquations

if TYPE_CHECKING:
    from scipy.integrate import OdeSolver

#: After an irregular step, the next one has the length of its regular part, but at least this part
#: of its whole length.
_SHORTER = 0.25
#: A motion is stuck when its steps are shorter than this part of its duration.
_STUCK = 1e-12
#: rtol and atol are not tightened below this: SciPy does not go far below 1e-13.
_FINEST = 1e-12
#: atol is at least this many roundings of max |q|.
_ROUNDINGS = 16
#: Implicit methods do not tell how often they evaluate the equations in a step. The last three
#: evaluations in a step are those of its last iterations.
_IMPLICIT_STAGES = 3


class StepControl:
    """Chooses lengths and tolerances of steps, and makes the steps.

    Implicit methods use the Jacobian of the equations if it is `exact`.
    """

    def __init__(
        self, equations: StateEquations, times: Array, settings: Settings, *, exact: bool
    ) -> None:
        from scipy import integrate

        self._settings = settings
        self._method: Callable[..., OdeSolver] = getattr(integrate, settings.method)
        self._uses_jacobian = exact and settings.method in IMPLICIT
        self._watch = InputWatch(equations, times, settings)
        inputs = [equations.torque, equations.load]
        self._input_times = [x.times for x in inputs if x is not None and x.times is not None]
        self._duration = float(times[-1] - times[0])
        #: Length of the first step of the next solver, [s]. It is infinite until a step was made;
        #: the solver then chooses the length.
        self._first_length = np.inf

    @property
    def missed(self) -> str:
        """Where no step was short enough for a torque or load; empty if there is no such place."""
        t = self._watch.missed_at
        if np.isnan(t):
            return ""
        return (
            f"a torque or load function changes too fast at t = {t:.9g} s: the motion has missed a "
            "part of it"
        )

    @property
    def stuck(self) -> bool:
        """Whether steps have become too short for the motion to go on."""
        return self._first_length < _STUCK * self._duration

    def solver(self, equations: StateEquations, state: MotionState, until: float) -> OdeSolver:
        """An integrator from a state to a time."""
        first_step = None
        if np.isfinite(self._first_length):
            first_step = min(self._first_length, until - state.t)
        # The dependent joints have the errors of the coordinates times the condition number. This
        # number may grow before the coordinates change: `MARGIN` is a reserve for that.
        factor = MARGIN * state.space.condition_number(state.q)
        # Rounding of q makes noise in the rates. With a finer atol the integrator would shorten its
        # steps because of this noise.
        rounding = _ROUNDINGS * float(np.spacing(np.abs(state.q).max()))
        method = self._method
        if self._uses_jacobian:
            method = partial(method, jac=equations.jacobian)
        return method(
            equations.rate,
            state.t,
            state.y,
            until,
            first_step=first_step,
            max_step=self._longest(state.t),
            rtol=_tightened(self._settings.rtol, factor),
            atol=max(_tightened(self._settings.atol, factor), rounding),
        )

    def step(self, solver: OdeSolver, equations: StateEquations) -> IntegratorStep:
        """Make the next step of an integrator.

        Raises:
            SimulationError: If the integrator fails.
        """
        solver.max_step = self._longest(solver.t)
        message = solver.step()
        if solver.status == "failed":
            why = equations.failure or message
            raise SimulationError(f"the integrator stopped ({why})", float(solver.t))
        # `equations.evaluations` has torques and loads of the last calls. Rejected trials come
        # before the accepted one, so the last `count` of them are the stages of the step.
        count = getattr(solver, "n_stages", _IMPLICIT_STAGES)
        return IntegratorStep(
            start=float(solver.t_old),
            end=float(solver.t),
            y=solver.y,
            equations=equations,
            stages=list(equations.evaluations)[-count:],
            solver=solver,
        )

    def shorten_if_input_missed(self, step: IntegratorStep) -> bool:
        """Make the next steps shorter if a step misses a change of a torque or load.

        Returns:
            Whether it misses one, so that it must be repeated.
        """
        if not self._watch.shorten_if_missed(step):
            return False
        self._first_length = min(self._first_length, self._watch.longest_step(step.start))
        return True

    def remember_length(self, step: IntegratorStep, *, torques_change_at_end: bool) -> None:
        """Remember the length of a step, for the first step of the next solver.

        A step that ends where torques change may have been cut short there. It does not make the
        next one shorter.
        """
        length = step.length
        if torques_change_at_end and np.isfinite(self._first_length):
            length = max(length, self._first_length)
        self._first_length = length

    def shorten(self, fraction: float) -> None:
        """Make the next step shorter than the remembered one.

        It gets the length of the regular part, which is a `fraction` of the remembered step.
        """
        self._first_length *= max(fraction, _SHORTER)

    def _longest(self, t: float) -> float:
        """The longest step from a time that misses no change of a torque or load.

        A step may pass one of the times of an input, but not two of them. It is also at most as
        long as the interval of these times in which it starts. So a step from the end of a short
        interval is short, even if a long interval follows.

        The times of an input begin at or before the first output time, and end at or after the last
        one. So t, where a step starts, is earlier than the last of them.
        """
        longest = min(self._settings.max_step or np.inf, self._watch.longest_step(t))
        for times in self._input_times:
            last = len(times) - 1
            k = min(int(times.searchsorted(t, "right")), last)  # times[k - 1] <= t < times[k]
            until_the_second_next = times[min(k + 1, last)] - t
            longest = min(longest, times[k] - times[k - 1], until_the_second_next)
        return float(longest)


def _tightened(tolerance: float, factor: float) -> float:
    """A tolerance divided by a factor, but no finer than `_FINEST` or the tolerance itself."""
    return max(tolerance / factor, min(tolerance, _FINEST))
