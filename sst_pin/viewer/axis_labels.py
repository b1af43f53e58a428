# SPDX-License-Identifier: BSD-2-Clause
"""Axes of joints and frames, with their labels."""

from collections.abc import Sequence

import numpy as np

from ..closed_chain import ClosedChain
from ..model.appearance import PLATFORM, DrawnFrame
from .rate_axes import RateAxis
from .scene_parts import Label, Shape, along, homogeneous
from .triangles import arrow

#: Colours of the axes x, y, z of a frame.
_XYZ = ("#C0392B", "#27AE60", "#2E5FA8")


def axes_with_labels(
    robot: ClosedChain, axes: Sequence[RateAxis], point: DrawnFrame | None, size: float
) -> tuple[list[Shape], list[Label]]:
    """Arrows along the axes of joints and frames, and the labels of these and of `point`.

    Args:
        robot: The robot.
        axes: The axis of each rate.
        point: The point whose path is drawn, or None.
        size: A length of the robot, [m].
    """
    shapes = list[Shape]()
    labels = list[Label]()
    appearance = robot.appearance

    # Axes of the joints.
    length = appearance.axis_length * size
    # Along z, with a head that is the last 5 % of the length.
    line = arrow(np.outer((0, 0.95, 1), (0, 0, length)), 0.007 * size)
    for i, (axis, (name, colour)) in enumerate(zip(axes, appearance.axes, strict=True)):
        mover = str(axis.mover)
        at = homogeneous(along(axis.direction), axis.origin)
        tip = 1.06 * length * axis.direction
        shapes.append(Shape(mover, "axes", f"{name}_{i}", line, colour, at=at))
        labels.append(Label(name, colour, "axes", mover, axis.origin + tip))

    # Frames, and the point.
    triad = [arrow(np.outer((0, 0.75, 1), 0.17 * size * x), 0.006 * size) for x in np.eye(3)]
    for frame in appearance.frames:
        mover = str(frame.joint)
        at = frame.placement.homogeneous
        for letter, mesh, colour in zip("xyz", triad, _XYZ, strict=True):
            shapes.append(Shape(mover, "frames", f"{frame.name}_{letter}", mesh, colour, at=at))
        tip = frame.placement.act(np.array((0, 0, 0.2 * size)))
        labels.append(Label(frame.name, frame.colour, "frames", mover, tip))
    if point is not None and point.name != PLATFORM:  # a platform needs no label
        position = 1.2 * point.placement.translation
        labels.append(Label(point.name, point.colour, "trail", str(point.joint), position))
    return shapes, labels
