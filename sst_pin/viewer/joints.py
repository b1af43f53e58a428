# SPDX-License-Identifier: BSD-2-Clause
"""Axes of the joints, and arrows for the torques and forces of the motors."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..chain.closed_chain import ClosedChain
from ..chain.closures import Coupling, frames_of
from ..description.colours import HUES
from .scene_parts import Arrow, Pull, Shape, along, homogeneous
from .triangles import arc, arrow

_FORCE = "#263238"


class Axis(NamedTuple):
    """The axis of one rate of a joint.

    Attributes:
        joint: Number of the joint.
        mover: Number of the joint whose body bears the axis.
        turns: Whether the joint turns about it rather than sliding along it.
        direction: Unit vector in the axes of this body.
        origin: A point of the axis on this body, close to the joint's frame (of a sliding joint
            at position 0), [m].
    """

    joint: int
    mover: int
    turns: bool
    direction: Array
    origin: Array


def axes_of(model: pin.Model, data: pin.Data, q: Array) -> list[Axis]:
    """The axis of each rate, in the order of v.

    The axis of a joint with one rate is fixed to the body before the joint. Axes of other joints
    are drawn on the body behind the joint, for one configuration.
    """
    J = pin.computeJointJacobians(model, data, q).reshape(6, -1)
    owners = {
        joint.idx_v + i: (number, joint.nv)
        for number, joint in enumerate(model.joints)
        for i in range(joint.nv)
    }
    found = []
    for i in range(model.nv):
        number, count = owners[i]
        mover = int(model.parents[number]) if count == 1 else number
        at, origin = data.oMi[mover], data.oMi[number].translation
        v, w = J[:3, i] + np.cross(J[3:, i], origin), J[3:, i]
        turns = bool(np.linalg.norm(w) > 1e-9)
        direction = w if turns else v
        direction = at.rotation.T @ (direction / np.linalg.norm(direction))
        if turns:
            origin = at.actInv(origin + np.cross(w, v) / (w @ w))
        else:
            origin = model.jointPlacements[number].translation if count == 1 else np.zeros(3)
        found.append(Axis(number, mover, turns, direction, origin))
    return found


def arrows_of(
    model: pin.Model, data: pin.Data, axes: list[Axis], B: Array, size: float
) -> Iterator[Arrow]:
    """Torques of the motors, at the joints that they act on by B, shape (nv, motors).

    `data` is at the configuration of the axes; `size` is the length of the largest arrow, [m].
    """
    turn = np.linspace(0, np.radians(250), 40)
    torque = arrow(np.vstack([arc(1.0, turn), arc(1.0, turn[-1:] + 0.6)]), 0.055)
    force = arrow(np.outer((0, 0.7, 1), (0, 0, 2.0)), 0.055)
    driven = [axes[i] for i in np.flatnonzero(B.any(axis=1))]
    places = np.array([data.oMi[axis.mover].act(axis.origin) for axis in driven])
    for i, motor in np.argwhere(B):
        axis, share = axes[i], B[i, motor] / np.abs(B[:, motor]).max()
        R, origin = along(axis.direction), axis.origin
        apart = np.linalg.norm(places - data.oMi[axis.mover].act(origin), axis=1)
        if not axis.turns:  # beside what slides
            origin = origin + 0.35 * size * R[:, 0]
        elif np.count_nonzero(apart < 0.1 * size) > 1:  # motors that meet, as of spherical robots
            origin = origin - 0.93 * size * axis.direction
        matrix = homogeneous(size * R, origin)
        name = f"{motor + 1}_{model.names[axis.joint]}"
        mesh, mirror = (torque, (1.0, -1.0, 1.0)) if axis.turns else (force, (1.0, 1.0, -1.0))
        colour = HUES[motor % len(HUES)]
        shape = Shape(str(axis.mover), "torques", name, mesh, colour, at=matrix)
        yield Arrow(shape, int(motor), float(share), mirror)


def pulls_of(robot: ClosedChain, size: float) -> Iterator[Pull]:
    """Forces of parents on children in joints, of A on B in closures, as `reactions` has them.

    `size` is the length of the largest arrow, [m].
    """
    model, mesh = robot.mechanism.model, arrow(np.outer((0, 0.7, 1), (0, 0, 2.0)), 0.04)
    places = [(j, np.eye(4)) for j in range(1, model.njoints)]
    for closure in robot.closures:
        if isinstance(closure, Coupling):  # gears have no place
            places.append((0, np.zeros((4, 4))))
        else:
            frame = model.frames[model.getFrameId(frames_of(closure)[1])]
            places.append((frame.parentJoint, frame.placement.homogeneous))
    for k, (joint, at) in enumerate(places):
        largest = at @ np.diag([size, size, size, 1.0])
        shape = Shape(str(joint), "reactions", f"{k}", mesh, _FORCE, at=largest)
        if at.any():
            yield Pull(shape, len(robot.motor_names) + 3 * k)
