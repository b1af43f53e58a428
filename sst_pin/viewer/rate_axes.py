# SPDX-License-Identifier: BSD-2-Clause
"""Axes about which joints turn or along which they slide, one for each rate."""

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array

#: The angular part of a slide's unit twist is rounding: below this.
_ROUNDING = 1e-9


class RateAxis(NamedTuple):
    """The axis of one rate of a joint."""

    joint: int
    mover: int  #: Number of the joint whose body carries the axis.
    turns: bool  #: Whether the joint turns about it rather than sliding along it.
    direction: Array  #: Unit vector in the axes of this body.
    origin: Array  #: A point of it on this body, close to the joint's frame (at position 0), [m].


def axes_of(model: pin.Model, q: Array) -> list[RateAxis]:
    """The axis of each rate, in the order of v.

    The axis of a joint with one rate is fixed to its parent's body. Axes of other joints are drawn
    on the body that the joint moves, for the configuration q.
    """
    data = model.createData()
    J = pin.computeJointJacobians(model, data, q).reshape(6, -1)
    axes = []
    for number in range(1, model.njoints):
        joint = model.joints[number]
        has_one_rate = joint.nv == 1
        mover = int(model.parents[number]) if has_one_rate else number
        mover_in_base = data.oMi[mover]
        joint_origin = data.oMi[number].translation
        for k in range(joint.idx_v, joint.idx_v + joint.nv):
            # The twist of a rate of 1: w, and the velocity v of the origin of the joint's frame.
            w = J[3:, k]
            v = J[:3, k] + np.cross(w, joint_origin)
            turns = bool(np.linalg.norm(w) > _ROUNDING)
            if turns:
                # The point of the axis that is closest to the joint's frame.
                direction = w
                origin = mover_in_base.actInv(joint_origin + np.cross(w, v) / (w @ w))
            else:
                direction = v
                origin = model.jointPlacements[number].translation if has_one_rate else np.zeros(3)
            direction = mover_in_base.rotation.T @ (direction / np.linalg.norm(direction))
            axis = RateAxis(
                joint=number, mover=mover, turns=turns, direction=direction, origin=origin
            )
            axes.append(axis)
    return axes
