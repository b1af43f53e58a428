# SPDX-License-Identifier: BSD-2-Clause
"""What a robot's axes and frames are called, and where they are drawn."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..chain.closed_chain import ClosedChain
from ..chain.closures import frames_of
from ..chain.tree import frame_id
from ..description.colours import LEG_COLOURS
from ..sst.robot import SST
from .joints import Axis
from .parts import AXES, Label, Shape, along, homogeneous
from .shapes import arrow

Array = NDArray[np.float64]

_INK = "#6B747D"
#: Of the gallery's robots.
_PLATFORM = "platform"


class _Triad(NamedTuple):
    name: str
    mover: int
    at: pin.SE3
    colour: str = _INK


def names_of(
    robot: ClosedChain, axes: Sequence[Axis], size: float
) -> tuple[list[Shape], list[Label]]:
    """Axes and frames of a robot: the paper's of an SST, joints and ends of loops of any other.

    Args:
        robot: Any closed chain.
        axes: Of its joints, for each rate.
        size: A length of the robot, [m].
    """
    shapes: list[Shape] = []
    labels: list[Label] = []
    of_star = isinstance(robot, SST)
    length = (1.25 if of_star else 0.5) * size
    line = arrow(np.outer((0, 0.95, 1), (0, 0, length)), 0.007 * size)
    for i, axis in enumerate(axes):
        name, colour, mover = robot.model.names[axis.joint], _INK, str(axis.mover)
        if of_star:  # gamma_k, mu_k, beta_k turn about e_k, e_{k+3}, e_{k+6}
            name, colour = f"e_{i // 3 + 3 * (i % 3) + 1}", LEG_COLOURS[i // 3]
        at, tip = homogeneous(along(axis.direction), axis.origin), 1.06 * length * axis.direction
        shapes.append(Shape(mover, "axes", f"{name}_{i}", line, colour, at=at))
        labels.append(_label(name, colour, "axes", mover, axis.origin + tip))
    triad = [arrow(np.outer((0, 0.75, 1), 0.17 * size * x), 0.006 * size) for x in np.eye(3)]
    for name, joint, place, colour in _star(robot) if isinstance(robot, SST) else _ends(robot):
        for letter, mesh, shade in zip("xyz", triad, AXES, strict=True):
            at = place.homogeneous
            shapes.append(Shape(str(joint), "frames", f"{name}_{letter}", mesh, shade, at=at))
        tip = place.act(np.array((0, 0, 0.2 * size)))
        labels.append(_label(name, colour, "frames", str(joint), tip))
    if isinstance(robot, SST):
        joint, E = point_of(robot) or (0, np.zeros(3))
        labels.append(_label("E", _INK, "trail", str(joint), 1.2 * E))
    return shapes, labels


def point_of(robot: ClosedChain) -> tuple[int, Array] | None:
    """The point whose path is drawn: the joint whose body it is on, and where; None for none."""
    if isinstance(robot, SST):
        return 3, robot.star_radius * robot.geometry.R_E[0][:, 0]
    if robot.model.existFrame(_PLATFORM):
        frame = robot.model.frames[frame_id(robot.model, _PLATFORM)]
        return frame.parentJoint, frame.placement.translation
    return None


def _label(text: str, colour: str, layer: str, mover: str, point: Array) -> Label:
    return Label(text, colour, layer, mover, tuple(point.tolist()))


def _ends(robot: ClosedChain) -> Iterator[_Triad]:
    """Frames where loops close, and the platform."""
    model = robot.model
    names = [name for closure in robot.closures for name in frames_of(closure)]
    for name in dict.fromkeys([*names, *filter(model.existFrame, [_PLATFORM])]):
        frame = model.frames[frame_id(model, name)]
        yield _Triad(name, frame.parentJoint, frame.placement)


def _star(robot: SST) -> Iterator[_Triad]:
    """{0k}..{3k} and {E}: all have their origin in O and are drawn on the parts they belong to."""
    r, R_E = robot.star_radius, robot.geometry.R_E[0]
    apart = ((1, 0, 0), (0.72, 0, 0), (1.16, 0, 0), (1.06 * np.cos(0.7), -1.06 * np.sin(0.7), 0))
    for k in range(3):
        for i, where in enumerate(apart):
            joint, at = 3 * k + i, pin.SE3(np.eye(3), r * np.array(where, dtype=float))
            if i == 0:
                joint, at = 0, pin.SE3(robot.geometry.R_0[k], np.zeros(3)) * at
            yield _Triad(f"{{{i}{k + 1}}}", joint, at, LEG_COLOURS[k])
    yield _Triad("{E}", 3, pin.SE3(R_E, 1.12 * r * R_E[:, 0]))
