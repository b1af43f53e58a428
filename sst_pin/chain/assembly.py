# SPDX-License-Identifier: BSD-2-Clause
"""Putting a closed chain together: Newton's method on the closures."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..errors import ClosureError
from .closures import LoopKinematics

Array = NDArray[np.float64]

#: Residual that an assembled configuration stays below, [m] or [rad].
ASSEMBLED = 1e-11
_STEPS = 100
#: Longest stride, [rad] or [m]: the closures are far from linear beyond it.
_STRIDE = 0.5


def assemble(kinematics: LoopKinematics, q: Array, free: NDArray[np.intp]) -> Array:
    """The configuration next to q with closed loops.

    Args:
        kinematics: Workspace of the chain.
        q: A guess, shape (m,).
        free: Indices of the coordinates that may move.

    Raises:
        ClosureError: When there is none within reach, with the residual that was left.
    """

    def residual_at(q: Array) -> Array:
        kinematics.set_position(q)
        return kinematics.residual()

    residual = residual_at(q)
    for _ in range(_STEPS):
        if np.linalg.norm(residual) < 1e-3 * ASSEMBLED:
            break
        step = np.zeros_like(q)
        step[free] = np.linalg.lstsq(kinematics.Phi()[:, free], -residual, rcond=1e-10)[0]
        step *= _STRIDE / max(_STRIDE, float(np.abs(step).max()))
        trial = residual_at(q + step)
        while np.linalg.norm(trial) >= np.linalg.norm(residual):
            step /= 2
            if np.abs(step).max() < 1e-16 or np.abs(residual).max() < ASSEMBLED:
                break  # rounding, or a dead end
            trial = residual_at(q + step)
        else:
            q, residual = q + step, trial
            continue
        break
    largest = float(np.abs(residual).max())
    if not largest < ASSEMBLED:
        raise ClosureError(
            f"the loops cannot be closed from this guess: {largest:.3g} (m or rad) stays open; "
            "start nearer, hold fewer joints, or check the geometry",
            largest,
        )
    return q


def generic_configuration(kinematics: LoopKinematics) -> Array:
    """Some assembled configuration away from the symmetric ones, the same at each call.

    Raises:
        ClosureError: When twenty guesses lead to none.
    """
    model = kinematics.model
    random = np.random.default_rng(0)
    spread = np.linspace(0.1, 2.0, 20)
    failures = []
    for width in spread:
        guess = pin.neutral(model) + width * random.normal(size=model.nv)
        try:
            return assemble(kinematics, guess, np.arange(model.nv))
        except ClosureError as error:
            failures.append(error)
    raise min(failures, key=lambda error: error.residual)
