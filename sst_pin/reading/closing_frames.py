# SPDX-License-Identifier: BSD-2-Clause
"""Points that coincide, as onshape-to-robot marks them in a URDF.

The points are links without mass, `closing_NAME_1` and `closing_NAME_2`. PlaCo, too, closes loops
by them.
"""

import re
from collections.abc import Iterator

import pinocchio as pin

from ..errors import DescriptionError
from ..model.closures import Closure


def is_closing(frame: pin.Frame) -> bool:
    """Whether a frame marks one of two points that coincide."""
    match = re.fullmatch("closing_.+_[12]", frame.name)
    return frame.type == pin.FrameType.BODY and match is not None


def closures_of_frames(model: pin.Model) -> Iterator[Closure]:
    """A closure for each pair of frames `closing_NAME_1`, `closing_NAME_2`."""
    for name in [frame.name for frame in model.frames if is_closing(frame)]:
        first = f"{name[:-1]}1"
        second = f"{name[:-1]}2"
        if not (model.existFrame(first) and model.existFrame(second)):
            raise DescriptionError(name, [f"{first} and {second} close a loop; one is missing"])
        if name == first:
            yield Closure(first, second, "3d")
