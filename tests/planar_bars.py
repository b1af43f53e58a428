# SPDX-License-Identifier: BSD-2-Clause
"""Trees of bars in a plane, drawn along x."""

import numpy as np
import pinocchio as pin

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
        at, middle, end = (
            pin.SE3(np.eye(3), np.array([size, 0.0, 0.0])) for size in (x, length / 2, length)
        )
        k = model.addJoint(model.getJointId(bearer), joint(), at, name)
        model.appendBodyToJoint(k, pin.Inertia.FromSphere(1.0, 0.1), middle)
        model.addFrame(pin.Frame(f"{name}_end", k, end, pin.FrameType.OP_FRAME))
    return model
