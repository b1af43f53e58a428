# SPDX-License-Identifier: BSD-2-Clause
"""Trees of bars in a plane, drawn along x."""

import pinocchio as pin

from by_hand import at, mark

#: Crank, coupler, and a rocker whose end the coupler's meets: all turn round and round.
DRAG_LINK = [
    ("crank", "universe", 0.0, 0.5),
    ("coupler", "crank", 0.5, 0.45),
    ("rocker", "universe", 0.2, 0.55),
]


def planar(bars, joint=pin.JointModelRZ):
    """Bars as (name, the bar that bears it, where on it, x of its end); frames `name_end`."""
    model = pin.Model()
    for name, bearer, x, length in bars:
        k = model.addJoint(model.getJointId(bearer), joint(), at(x), name)
        model.appendBodyToJoint(k, pin.Inertia.FromSphere(1.0, 0.1), at(length / 2))
        mark(model, k, f"{name}_end", at(length))
    return model
