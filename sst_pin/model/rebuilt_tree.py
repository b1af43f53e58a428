# SPDX-License-Identifier: BSD-2-Clause
"""A tree built again joint by joint, with some joints fixed or replaced by several in series."""

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
import pinocchio as pin

from .joint_series import Part, Series

#: Arrays of a model with a number for each rate, and for each position.
RATE_ARRAYS = (
    "armature",
    "damping",
    "friction",
    "rotorInertia",
    "rotorGearRatio",
    "effortLimit",
    "velocityLimit",
)
POSITION_ARRAYS = ("lowerPositionLimit", "upperPositionLimit")


def rebuilt(old: pin.Model, changes: Mapping[int, Series]) -> pin.Model:
    """The tree with some joints, by number, replaced by series; its joints may come in any order.

    `pin.buildReducedModel` needs joints added depth-first, each with a frame; without these it ends
    the process.
    """
    model = pin.Model()
    model.name = old.name
    model.gravity = old.gravity
    model.inertias[0] = old.inertias[0]
    carriers = [(0, pin.SE3.Identity())]  # of each old joint, the new one and its place there
    each = [changes.get(i) or Series.whole(joint) for i, joint in enumerate(old.joints)]
    for i in range(1, old.njoints):
        carrier, place = carriers[old.parents[i]]
        place = place * old.jointPlacements[i]
        for part in each[i].parts:
            name = old.names[i] + part.suffix
            carrier = model.addJoint(carrier, part.joint, place * part.place, name)
            place = pin.SE3.Identity()
        carriers.append((carrier, place * each[i].place))
        model.appendBodyToJoint(carrier, old.inertias[i], carriers[i][1])
    _copy_frames(old, model, carriers, [len(series.parts) for series in each])
    poses = {pair.key(): np.array(pair.data()) for pair in old.referenceConfigurations}
    new_poses = {name: pin.neutral(model) for name in poses}
    for i, whole in enumerate(list(old.joints)[1:], 1):
        first = carriers[i][0] - len(each[i].parts) + 1
        for k, part in enumerate(each[i].parts):
            joint = model.joints[first + k]
            _copy_numbers(old, whole, model, joint, part)
            for name, pose in poses.items():
                positions = each[i].positions(pose[whole.idx_q : whole.idx_q + whole.nq])[k]
                new_poses[name][joint.idx_q : joint.idx_q + positions.size] = positions
    for name, pose in new_poses.items():
        model.referenceConfigurations[name] = pose
    return model


def _copy_frames(
    old: pin.Model, model: pin.Model, carriers: Sequence[tuple[int, pin.SE3]], sizes: Sequence[int]
) -> None:
    """Copy the frames; a joint's frame becomes one for each new joint, or a fixed-joint frame."""
    numbers = {0: 0}  # indices of the new frames, by the indices of the old ones
    for i, frame in enumerate(list(old.frames)[1:], 1):
        joint = frame.parentJoint
        kind = frame.type
        carrier, place = carriers[joint]
        bearing = numbers.get(frame.parentFrame, 0)
        place = place * frame.placement
        if kind == pin.FrameType.JOINT and frame.name == old.names[joint]:
            for k in range(carrier - sizes[joint] + 1, carrier + 1):
                new = pin.Frame(model.names[k], k, bearing, pin.SE3.Identity(), kind)
                numbers[i] = bearing = model.addFrame(new, False)
            kind = pin.FrameType.FIXED_JOINT
            if sizes[joint] or old.existFrame(frame.name, kind):
                continue
        new = pin.Frame(frame.name, carrier, bearing, place, kind)
        numbers[i] = model.addFrame(new, False)


def _copy_numbers(old: pin.Model, whole: Any, model: pin.Model, joint: Any, part: Part) -> None:
    for fields, to, at, which in (
        (RATE_ARRAYS, joint.idx_v, whole.idx_v, part.rates),
        (POSITION_ARRAYS, joint.idx_q, whole.idx_q, part.entries),
    ):
        for field, (k, entry) in product(fields, enumerate(which)):
            getattr(model, field)[to + k] = getattr(old, field)[at + entry]
