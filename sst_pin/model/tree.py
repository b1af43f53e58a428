# SPDX-License-Identifier: BSD-2-Clause
"""Joints and frames of a tree by name."""

from contextlib import suppress

import pinocchio as pin

from ..errors import DescriptionError, UnknownNameError

_OF_JOINTS = (pin.FrameType.JOINT, pin.FrameType.FIXED_JOINT)


def frame_id(model: pin.Model, name: str | None) -> int:
    """Index of a frame.

    If a joint has the same name as a link, a site or a point, the name does not mean the joint,
    which may be elsewhere. Other frames with the same name must coincide.
    """
    if not (isinstance(name, str) and model.existFrame(name)):
        raise UnknownNameError("frame", str(name), [f.name for f in model.frames])
    with suppress(ValueError):  # Pinocchio raises it for several frames with this name
        return int(model.getFrameId(name))
    same = [i for i, frame in enumerate(model.frames) if frame.name == name]
    points = [i for i in same if model.frames[i].type not in _OF_JOINTS]
    candidates = points or same
    first = candidates[0]
    frame = model.frames[first]
    for i in candidates[1:]:
        other = model.frames[i]
        if other.parentJoint != frame.parentJoint or other.placement != frame.placement:
            raise DescriptionError(
                f"frame {name}", ["several frames have this name, at different places; rename one"]
            )
    return first


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
