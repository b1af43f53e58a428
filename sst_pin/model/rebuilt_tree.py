# SPDX-License-Identifier: BSD-2-Clause
"""A tree built again joint by joint, with some joints fixed or replaced by several in series.

In this module "place" is a placement, `pin.SE3`.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

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
    all_series: list[Series] = []
    for i, joint in enumerate(old.joints):
        all_series.append(changes[i] if i in changes else Series.whole(joint))

    # Joints and bodies.
    carriers = [_Carrier(0, pin.SE3.Identity(), [])]
    for i in range(1, old.njoints):
        parent = carriers[old.parents[i]]
        joint = parent.joint
        place = parent.place * old.jointPlacements[i]
        series_joints = []
        for part in all_series[i].parts:
            name = old.names[i] + part.suffix
            joint = model.addJoint(joint, part.joint, place * part.place, name)
            series_joints.append(joint)
            place = pin.SE3.Identity()
        carrier = _Carrier(joint, place * all_series[i].place, series_joints)
        carriers.append(carrier)
        model.appendBodyToJoint(carrier.joint, old.inertias[i], carrier.place)
    _copy_frames(old, model, carriers)

    # Numbers of the joints, and their positions in the stored poses.
    poses = {pair.key(): np.array(pair.data()) for pair in old.referenceConfigurations}
    new_poses = {name: pin.neutral(model) for name in poses}
    model_joints = list(model.joints)
    for i in range(1, old.njoints):
        old_joint = old.joints[i]
        new_joints = [model_joints[number] for number in carriers[i].series]
        for part, new_joint in zip(all_series[i].parts, new_joints, strict=True):
            _copy_numbers(old, old_joint, model, new_joint, part)
        for name, pose in poses.items():
            q = pose[old_joint.idx_q : old_joint.idx_q + old_joint.nq]
            for new_joint, positions in zip(new_joints, all_series[i].positions(q), strict=True):
                entries = slice(new_joint.idx_q, new_joint.idx_q + positions.size)
                new_poses[name][entries] = positions
    for name, pose in new_poses.items():
        model.referenceConfigurations[name] = pose
    return model


class _Carrier(NamedTuple):
    """What moves the body of an old joint in the new tree.

    Attributes:
        joint: Number of the new joint that moves the body.
        place: Placement of the body on this joint.
        series: Numbers of the new joints that replace the old one, the last of which is `joint`;
            empty if the old joint is fixed.
    """

    joint: int
    place: pin.SE3
    series: Sequence[int]


def _copy_frames(old: pin.Model, model: pin.Model, carriers: Sequence[_Carrier]) -> None:
    """Copy the frames.

    The frame of a joint becomes a frame for each of the new joints that replace it, or the frame of
    a fixed joint if there is none.
    """
    new_index = {0: 0}  # of each old frame, by its index
    for i, frame in enumerate(list(old.frames)[1:], 1):
        joint = frame.parentJoint
        carrier = carriers[joint]
        parent_frame = new_index.get(frame.parentFrame, 0)
        kind = frame.type
        if kind == pin.FrameType.JOINT and frame.name == old.names[joint]:
            for k in carrier.series:
                new = pin.Frame(model.names[k], k, parent_frame, pin.SE3.Identity(), kind)
                parent_frame = model.addFrame(new, False)
                new_index[i] = parent_frame
            kind = pin.FrameType.FIXED_JOINT
            if carrier.series or old.existFrame(frame.name, kind):
                continue
        place = carrier.place * frame.placement
        new = pin.Frame(frame.name, carrier.joint, parent_frame, place, kind)
        new_index[i] = model.addFrame(new, False)


def _copy_numbers(
    old: pin.Model, old_joint: Any, model: pin.Model, new_joint: Any, part: Part
) -> None:
    """Copy limits, friction and rotors of the rates and positions that a part has."""
    for name in RATE_ARRAYS:
        for k, rate in enumerate(part.rates):
            value = getattr(old, name)[old_joint.idx_v + rate]
            getattr(model, name)[new_joint.idx_v + k] = value
    for name in POSITION_ARRAYS:
        for k, entry in enumerate(part.entries):
            value = getattr(old, name)[old_joint.idx_q + entry]
            getattr(model, name)[new_joint.idx_q + k] = value
