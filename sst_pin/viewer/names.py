# SPDX-License-Identifier: BSD-2-Clause
"""Labels of axes and frames, and their shapes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import Array
from ..chain.appearance import PLATFORM, DrawnFrame
from ..chain.closed_chain import ClosedChain
from .joints import Axis
from .scene_parts import AXES, Label, Shape, along, homogeneous
from .triangles import arrow


def names_of(
    robot: ClosedChain, axes: Sequence[Axis], point: DrawnFrame | None, size: float
) -> tuple[list[Shape], list[Label]]:
    """Axes of the joints and frames, with their labels; the path of `point` is drawn."""
    shapes: list[Shape] = []
    labels: list[Label] = []
    shown = robot.appearance
    length = shown.axis_length * size
    line = arrow(np.outer((0, 0.95, 1), (0, 0, length)), 0.007 * size)
    for i, (axis, (name, colour)) in enumerate(zip(axes, shown.axes, strict=True)):
        mover = str(axis.mover)
        at, tip = homogeneous(along(axis.direction), axis.origin), 1.06 * length * axis.direction
        shapes.append(Shape(mover, "axes", f"{name}_{i}", line, colour, at=at))
        labels.append(_label(name, colour, "axes", mover, axis.origin + tip))
    triad = [arrow(np.outer((0, 0.75, 1), 0.17 * size * x), 0.006 * size) for x in np.eye(3)]
    for name, joint, place, colour in shown.frames:
        for letter, mesh, shade in zip("xyz", triad, AXES, strict=True):
            at = place.homogeneous
            shapes.append(Shape(str(joint), "frames", f"{name}_{letter}", mesh, shade, at=at))
        tip = place.act(np.array((0, 0, 0.2 * size)))
        labels.append(_label(name, colour, "frames", str(joint), tip))
    if point is not None and point.name != PLATFORM:  # which is seen without its name
        name, joint, place, colour = point
        labels.append(_label(name, colour, "trail", str(joint), 1.2 * place.translation))
    return shapes, labels


def _label(text: str, colour: str, layer: str, mover: str, point: Array) -> Label:
    return Label(text, colour, layer, mover, tuple(point.tolist()))
