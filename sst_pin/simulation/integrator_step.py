# SPDX-License-Identifier: BSD-2-Clause
"""One step of an integrator of SciPy."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from ..arrays import Array
from .state_equations import StateEquations

if TYPE_CHECKING:
    from scipy.integrate import DenseOutput, OdeSolver


@dataclass(frozen=True, eq=False)
class IntegratorStep:
    """One step of an integrator.

    Attributes:
        start: Time of its start, [s].
        end: Time of its end, [s].
        y: State at its end, shape (nq + n,).
        equations: The equations of y.
        stages: Torques and loads at the times at which the integrator has evaluated the equations.
        solver: The integrator, which has not yet made another step.
    """

    start: float
    end: float
    y: Array
    equations: StateEquations
    stages: list[tuple[Array, Array | None]]
    solver: OdeSolver

    @property
    def length(self) -> float:
        """Length, [s]."""
        return self.end - self.start

    @cached_property
    def dense_output(self) -> DenseOutput:
        """The states within the step, a function of time."""
        return self.solver.dense_output()
