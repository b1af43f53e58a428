# SPDX-License-Identifier: BSD-2-Clause
"""Trees of bars in a plane, drawn along x."""

import numpy as np
import pinocchio as pin

from tests.support.by_hand import add, at, mark

#: Crank, coupler, and a rocker whose end the coupler's meets: all turn round and round.
DRAG_LINK = [
    ("crank", "universe", 0.0, 0.5),
    ("coupler", "crank", 0.5, 0.45),
    ("rocker", "universe", 0.2, 0.55),
]


def planar(bars, joint=pin.JointModelRZ, model=None, moment=0.004):
    """Bars as (name, the bar that bears it, where on it, x of its end); frames `name_end`."""
    model = model or pin.Model()
    for name, bearer, x, length in bars:
        body = pin.Inertia(1.0, np.array([length / 2, 0, 0]), moment * np.eye(3))
        k = add(model, model.getJointId(bearer), joint(), name, at(x), body)
        mark(model, k, f"{name}_end", at(length))
    return model
