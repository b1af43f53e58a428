# SPDX-License-Identifier: BSD-2-Clause
"""Axes about which joints turn or along which they slide, one for each rate."""

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array

#: A unit twist with a smaller angular part belongs to a slide: the angular part is rounding.
_ROUNDING = 1e-9


class RateAxis(NamedTuple):
    """The axis of one rate of a joint."""

    joint: int  #: Number of the joint.
    mover: int  #: Number of the joint whose body carries the axis.
    turns: bool  #: Whether the joint turns about the axis; else it slides along the axis.
    direction: Array  #: Unit vector in the axes of `mover`, shape (3,).
    #: A point of the axis in the frame of `mover`, shape (3,), [m]. For a rotation it is the point
    #: closest to the joint's origin; for a slide it is the joint's origin at position 0.
    origin: Array


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
            # For a rate of 1: the angular velocity w, and the velocity v of the joint's origin. The
            # linear part of J is the velocity of the point of the body at the world's origin.
            w = J[3:, k]
            v = J[:3, k] + np.cross(w, joint_origin)
            turns = bool(np.linalg.norm(w) > _ROUNDING)
            if turns:
                # The points of the axis move along w only. The closest one to the joint's origin p
                # is p + w x v / |w|^2.
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
