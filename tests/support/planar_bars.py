# SPDX-License-Identifier: BSD-2-Clause
"""Trees of bars in a plane, drawn along x."""

import numpy as np
import pinocchio as pin

from sst_pin import Closure
from tests.support.by_hand import add, at, mark

#: Crank, coupler, and a rocker whose end the coupler's meets: all turn round and round.
DRAG_LINK = [
    ("crank", "universe", 0.0, 0.5),
    ("coupler", "crank", 0.5, 0.45),
    ("rocker", "universe", 0.2, 0.55),
]


def planar(bars, joint=pin.JointModelRZ, model=None, moment=0.004):
    """Bars as (name, the bar that carries it, where on it, x of its end); frames `name_end`."""
    model = model or pin.Model()
    for name, carrier, x, length in bars:
        body = pin.Inertia(1.0, np.array([length / 2, 0, 0]), moment * np.eye(3))
        k = add(model, model.getJointId(carrier), joint(), name, at(x), body)
        mark(model, k, f"{name}_end", at(length))
    return model


def rhombus():
    """Four equal bars; folded, crank and coupler turn together and the rocker rests."""
    bars = [("crank", "universe", 0.0, 0.3), ("coupler", "crank", 0.3, 0.3)]
    model = planar([*bars, ("rocker", "universe", 0.3, 0.3)], pin.JointModelRY)
    model.name = "rhombus"
    return model, [Closure("coupler_end", "rocker_end", "3d")], np.array([0.7, np.pi, np.pi])
