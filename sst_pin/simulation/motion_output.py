# SPDX-License-Identifier: BSD-2-Clause
"""The results of a simulated motion at the output times."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..errors import ClosureError, SingularConfigurationError
from .crossings import Branch
from .integrator_step import IntegratorStep
from .state_equations import MotionState, Samples, StateEquations


class MotionOutput:
    """Collects the samples of a motion while it passes the output times.

    If the motion goes back and passes an output time again, the sample that was added first stays.
    """

    def __init__(self, times: Array) -> None:
        self._times = times
        self._parts = list[Samples]()
        self._count = 0

    @property
    def samples(self) -> Samples:
        """All samples so far."""
        q, va, aa, tau = (np.concatenate(arrays) for arrays in zip(*self._parts, strict=True))
        return Samples(q, va, aa, tau)

    def add_start(self, equations: StateEquations, start: MotionState) -> None:
        """Add the sample at the first time."""
        self._add(equations.samples_along(self._times[:1], start.y[None]))

    def add_step(self, step: IntegratorStep, *, torques_change_at_end: bool) -> bool:
        """Add the samples within a step; False if loops cannot be closed within it.

        If torques change at the end of the step, the sample there has the new torques: the next
        step adds it.
        """
        until = step.end
        if torques_change_at_end and step.end < self._times[-1]:
            until = float(np.nextafter(step.end, -np.inf))  # without the end
        times = self._next_times(until)
        if not len(times):
            return True
        try:
            samples = step.equations.samples_along(times, step.dense_output(times).T)
        except (ClosureError, SingularConfigurationError):
            return False
        self._add(samples)
        return True

    def add_branch(self, equations: StateEquations, branch: Branch, until: float) -> None:
        """Add the samples of a motion through a singular configuration."""
        times = self._next_times(until)
        if not len(times):
            return
        coordinates = equations.robot_space.coordinates
        q = np.array([branch.q(t) for t in times])
        va = np.array([branch.v(t) for t in times])[:, coordinates]
        aa = np.array([branch.v_dot(t) for t in times])[:, coordinates]
        self._add(Samples(q, va, aa, equations.torque.along(times, q, va)))

    def _next_times(self, until: float) -> Array:
        """The output times without a sample up to a time."""
        times = self._times[self._count :]
        return times[times <= until]

    def _add(self, samples: Samples) -> None:
        self._parts.append(samples)
        self._count += len(samples.q)
