# SPDX-License-Identifier: BSD-2-Clause
"""Joints and frames of a tree by name."""

from contextlib import suppress

import pinocchio as pin

from ..errors import DescriptionError, UnknownNameError


def frame_id(model: pin.Model, name: str | None) -> int:
    """Index of a frame; frames of one name (a joint and its link) must coincide."""
    if not (isinstance(name, str) and model.existFrame(name)):
        raise UnknownNameError("frame", str(name), [f.name for f in model.frames])
    with suppress(ValueError):  # several frames of the name
        return int(model.getFrameId(name))
    same = [i for i, frame in enumerate(model.frames) if frame.name == name]
    first = model.frames[same[0]]
    for i in same[1:]:
        other = model.frames[i]
        if other.parentJoint != first.parentJoint or other.placement != first.placement:
            raise DescriptionError(
                f"frame {name}", ["several frames have this name, at different places; rename one"]
            )
    return same[0]


def body_of(model: pin.Model, frame: str) -> int | None:
    """Index of the body with a frame, from 0; None if it is missing or fixed to the ground."""
    joint = model.frames[frame_id(model, frame)].parentJoint if model.existFrame(frame) else 0
    return joint - 1 if joint else None


def frame_named(model: pin.Model, name: str) -> pin.Frame:
    """A frame by its name; errors as `frame_id`."""
    return model.frames[frame_id(model, name)]


def joint_id(model: pin.Model, name: str) -> int:
    """Index of a joint of the tree."""
    names = list(model.names)[1:]
    if name not in names:
        raise UnknownNameError("joint", name, names)
    return names.index(name) + 1
