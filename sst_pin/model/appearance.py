# SPDX-License-Identifier: BSD-2-Clause
"""What pictures show besides the bodies of a robot."""

from collections.abc import Sequence
from typing import NamedTuple

import pinocchio as pin

from ..arrays import Array
from .closures import Constraint, frames_of
from .tree import frame_named

#: Name of the frame whose path is drawn, if the robot has such a frame.
PLATFORM = "platform"
_INK = "#6B747D"


class DrawnFrame(NamedTuple):
    """A frame in a picture."""

    #: Its label.
    name: str
    #: Number of the joint whose body it is fixed to.
    joint: int
    #: Placement in the frame of this joint.
    placement: pin.SE3
    #: Colour of the label, as "#rrggbb".
    colour: str = _INK


class Appearance(NamedTuple):
    """The parts of a robot's pictures."""

    #: Label and colour of the axis of each rate, in the order of v.
    axes: tuple[tuple[str, str], ...]
    #: Frames with axes and a label.
    frames: tuple[DrawnFrame, ...]
    #: The frame whose path is drawn, by its origin; None for none.
    point: DrawnFrame | None
    #: A length of the robot, [m]; None to measure its shapes.
    size: float | None = None
    #: Length of the drawn axes, as a share of `size`.
    axis_length: float = 0.5
    #: Lower and upper ends of the arcs on which joints move, shape (2, nq), [rad]; None for none.
    arcs: Array | None = None
    #: Whether the path is drawn on the sphere of an SST.
    spherical: bool = False


def drawn_frame(model: pin.Model, name: str) -> DrawnFrame:
    """A frame of the model, to be drawn."""
    frame = frame_named(model, name)
    return DrawnFrame(name, frame.parentJoint, frame.placement)


def appearance_of(model: pin.Model, closures: Sequence[Constraint]) -> Appearance:
    """Names of the joints at their axes, frames where loops close, and the platform."""
    axes = []
    for number in range(1, model.njoints):
        for _ in range(model.joints[number].nv):
            axes.append((model.names[number], _INK))
    names = list[str]()
    for closure in closures:
        names += frames_of(closure)
    point = None
    if model.existFrame(PLATFORM):
        names.append(PLATFORM)
        point = drawn_frame(model, PLATFORM)
    frames = tuple(drawn_frame(model, name) for name in dict.fromkeys(names))
    return Appearance(tuple(axes), frames, point)
