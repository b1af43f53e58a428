# SPDX-License-Identifier: BSD-2-Clause
"""Finds changes of torques and loads between the times at which an integrator evaluates them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array, Flags
from ..errors import ClosureError, SingularConfigurationError
from .inputs import Settings
from .state_equations import StateEquations

if TYPE_CHECKING:
    from scipy.integrate import DenseOutput, OdeSolver

#: Torques and loads are evaluated this often between two output times.
_SAMPLES = 8
#: A step that misses a change is repeated by steps shorter by this factor.
_SHORTER = 0.25
#: Steps shorter than this part of the shortest time between two samples are not repeated.
_SHORTEST = 1e-4
#: Times in a step at which an implicit method evaluates the equations.
_IMPLICIT_STAGES = 3


class InputWatch:
    """Evaluates torque and load functions within each step of an integrator.

    An integrator evaluates these functions at few times, the stages of a step. A push between them
    would be missed. A step misses a change if, at a sample, a function leaves the range of its
    values in the stages by more than half of this range, and if this would change the rates by more
    than the tolerances of the integrator.

    Attributes:
        missed: The first time at which no step was short enough; NaN if there is none.
    """

    def __init__(self, equations: StateEquations, times: Array, settings: Settings) -> None:
        self._equations = equations
        self._settings = settings
        self._active = any(x.callable for x in (equations.torque, equations.load) if x)
        spacings = np.diff(times)[:, None] / _SAMPLES
        # Samples are not at the output times, where many pushes begin and end.
        inner = times[:-1, None] + spacings * (np.arange(_SAMPLES) + 0.5)
        self._times = inner.ravel()
        self._shortest = _SHORTEST * float(spacings.min())
        #: Until the first time steps are at most as long as the second number.
        self._until, self._longest = -np.inf, np.inf
        self.missed = np.nan

    def longest(self, t: float) -> float:
        """The longest step from a time."""
        return self._longest if t < self._until else np.inf

    def misses(self, solver: OdeSolver, dense: Callable[[], DenseOutput]) -> bool:
        """Whether the last step of a solver misses a change; if so, `longest` becomes shorter.

        `dense` returns the states within the step.
        """
        if not self._active:
            return False
        first, last = np.searchsorted(self._times, [solver.t_old, solver.t], "right")
        if first == last:
            return False
        stages = self._equations.evaluations[-getattr(solver, "n_stages", _IMPLICIT_STAGES) :]
        self._equations.evaluations.clear()
        times = np.append(solver.t_old, self._times[first:last])
        step = float(solver.t - solver.t_old)
        try:
            missed = self._misses(times, dense()(times).T, stages, step)
        except (ClosureError, SingularConfigurationError):
            return False  # the step is repeated for another reason
        if missed and step < self._shortest:
            if np.isnan(self.missed):
                self.missed = float(solver.t)
            return False
        if missed:
            self._until = float(solver.t)
            self._longest = _SHORTER * step
        return missed

    def _misses(
        self, times: Array, states: Array, stages: list[tuple[Array, Array | None]], step: float
    ) -> bool:
        """Whether an input at times and states differs from its values in the stages.

        The first time is the start of the step; it counts as a stage.
        """
        equations = self._equations
        tau, load = equations.inputs_along(times, states)
        expected_tau = _within(tau, [each[0] for each in stages])
        differs = (tau != expected_tau).any(axis=1)
        expected_load = load
        if load is not None:
            expected_load = _within(load, [x[1] for x in stages if x[1] is not None])
            differs |= (load != expected_load).any(axis=(1, 2))
        if not differs.any():
            return False
        aa = self._accelerations(states, tau, load, differs)
        expected = self._accelerations(states, expected_tau, expected_load, differs)
        settings = self._settings
        rates = states[:, -aa.shape[1] :]
        tolerance = settings.atol + settings.rtol * float(np.abs(rates).max())
        return bool(step * np.abs(aa - expected).max() > tolerance)

    def _accelerations(self, states: Array, tau: Array, load: Array | None, chosen: Flags) -> Array:
        """Accelerations of the coordinates at chosen states, shape (N, n)."""
        space = self._equations.states
        load = None if load is None else load[chosen]
        rates: Array = space.rate(states[chosen], tau[chosen], load)
        return rates[:, -len(space.coordinates) :]


def _within(values: Array, stages: list[Array]) -> Array:
    """Values moved into the range of the first of them and of the stages, and half of it more."""
    seen = np.array([values[0], *stages])
    low = seen.min(axis=0)
    high = seen.max(axis=0)
    room = (high - low) / 2
    return np.clip(values, low - room, high + room)
