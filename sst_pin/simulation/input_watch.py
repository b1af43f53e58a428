# SPDX-License-Identifier: BSD-2-Clause
"""Finds changes of torques and loads between the times at which an integrator evaluates them."""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Flags
from ..errors import ClosureError, SingularConfigurationError
from ..states import StateSpace
from .integrator_step import IntegratorStep
from .settings import Settings
from .state_equations import StateEquations

#: Torques and loads are evaluated this often between two output times.
_SAMPLES = 8
#: A step that misses a change is repeated by steps shorter by this factor.
_SHORTER = 0.25
#: Steps shorter than this part of the shortest time between two samples are not repeated.
_SHORTEST = 1e-4


class InputWatch:
    """Evaluates torque and load functions within each step of an integrator.

    An integrator evaluates these functions at few times, the stages of a step. A push between the
    stages would be missed. So the functions are also evaluated at samples, `_SAMPLES` between two
    output times. A step misses a change if two things are true at a sample within it:

    - a function leaves the range of its values in the stages by more than half of this range;
    - with the value in this range instead, the rates at the end of the step would be others, by
      more than the tolerances of the integrator.

    Attributes:
        missed_at: The first time at which no step was short enough, [s]; NaN if there is none.
    """

    def __init__(self, equations: StateEquations, times: Array, settings: Settings) -> None:
        self._settings = settings
        inputs = [equations.torque, equations.load]
        self._active = any(x.is_function for x in inputs if x is not None)
        spacings = np.diff(times)[:, None] / _SAMPLES
        # Samples are not at the output times, where many pushes begin and end.
        samples = times[:-1, None] + spacings * (np.arange(_SAMPLES) + 0.5)
        self._times = samples.ravel()
        self._shortest = _SHORTEST * float(spacings.min())
        #: Steps that start before `_short_until` are at most as long as `_short`, [s].
        self._short_until = -np.inf
        self._short = np.inf
        self.missed_at = np.nan

    def longest_step(self, t: float) -> float:
        """The longest step from a time, [s]; infinite without a limit."""
        return self._short if t < self._short_until else np.inf

    def shorten_if_missed(self, step: IntegratorStep) -> bool:
        """Make the longest step shorter, until the end of a step, if this step misses a change.

        Returns:
            Whether it misses one and must be repeated.
        """
        if not self._active:
            return False
        first, last = np.searchsorted(self._times, [step.start, step.end], "right")
        if first == last:
            return False
        times = np.append(step.start, self._times[first:last])
        try:
            misses = self._misses(times, step)
        except (ClosureError, SingularConfigurationError):
            return False  # the step is repeated for another reason
        if not misses:
            return False
        if step.length < self._shortest:
            if np.isnan(self.missed_at):
                self.missed_at = step.end
            return False
        # If a repeated, shorter step misses a change again, its end is earlier than `_short_until`
        # was. The steps behind it may be long again, because each of them is examined by itself.
        self._short_until = step.end
        self._short = _SHORTER * step.length
        return True

    def _misses(self, times: Array, step: IntegratorStep) -> bool:
        """Whether a step misses a change: both conditions of the class are true at a time.

        The first time is the start of the step; it counts as a stage.
        """
        equations = step.equations
        states = step.dense_output(times).T  # shape (times, nq + n)
        tau, load = equations.inputs_along(times, states)
        expected_tau = _within(tau, [stage_tau for stage_tau, _ in step.stages])
        differs = (tau != expected_tau).any(axis=1)
        expected_load = load
        if load is not None:
            # If there are loads, each stage has one; the condition is for the type checker.
            stage_loads = [stage_load for _, stage_load in step.stages if stage_load is not None]
            expected_load = _within(load, stage_loads)
            differs |= (load != expected_load).any(axis=(1, 2))
        if not differs.any():
            return False
        aa = _accelerations(equations.space, states, tau, load, differs)
        expected = _accelerations(equations.space, states, expected_tau, expected_load, differs)
        n = len(equations.space.coordinates)
        rates = states[:, -n:]
        settings = self._settings
        tolerance = settings.atol + settings.rtol * float(np.abs(rates).max())
        return bool(step.length * np.abs(aa - expected).max() > tolerance)


def _accelerations(
    space: StateSpace, states: Array, tau: Array, load: Array | None, chosen: Flags
) -> Array:
    """Accelerations of the coordinates at chosen states, shape (N, n)."""
    chosen_load = None if load is None else load[chosen]
    rates = space.rate(states[chosen], tau[chosen], chosen_load)
    return np.asarray(rates[:, -len(space.coordinates) :])


def _within(values: Array, stage_values: list[Array]) -> Array:
    """Values clipped to the range of those in the stages, widened by half of it at both ends.

    The first of the values counts as one in a stage.
    """
    all_stage_values = np.array([values[0], *stage_values])
    low = all_stage_values.min(axis=0)
    high = all_stage_values.max(axis=0)
    margin = (high - low) / 2
    return np.clip(values, low - margin, high + margin)
