# SPDX-License-Identifier: BSD-2-Clause
"""A step of the classical Runge-Kutta method, for NumPy and CasADi."""

from collections.abc import Callable
from typing import Any, TypeVar

#: Numbers, or symbols, of a state.
X = TypeVar("X", bound=Any)

#: For each of the four slopes: when it is taken (0: start, 1: middle, 2: end of the step), its
#: weight in the result, and the fraction of the step from the start to the next stage. There is no
#: stage after the last one.
_SLOPES = ((0, 1 / 6, 1 / 2), (1, 1 / 3, 1 / 2), (1, 1 / 3, 1), (2, 1 / 6, 0))


def runge_kutta_step(rate: Callable[[int, X], X], state: X, h: Any) -> X:
    """The state after a step h.

    `rate(when, state)` is the time derivative of a state. `when` says where in the step the state
    is: at the start (0), in the middle (1), or at the end (2).
    """
    stage = end = state
    for when, weight, ahead in _SLOPES:
        slope = rate(when, stage)
        end = end + weight * h * slope
        stage = state + ahead * h * slope
    return end
