# SPDX-License-Identifier: BSD-2-Clause
"""A tree built again joint by joint, with some joints fixed or replaced by several in series.

`rebuilt` adds the joints with their bodies, then the frames. Last, it copies the parameters of
the joints (limits, friction, rotors) and the stored poses. A "place" in this module is a placement,
`pin.SE3`. The "number" of a joint is its index in the tree.

A joint is replaced by a `Series` of joints, and each of these is a `Part`. `Part.place` is its
placement at q = 0, relative to the joint before it. `Series.place` is that of the old joint's body,
relative to the last part.
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


class Carrier(NamedTuple):
    """What moves the body of an old joint in the new tree.

    Attributes:
        joint: Number of the new joint that moves the body.
        place: Placement, relative to this joint, of the axes that the body had at the old joint.
        series: The joints that replace the old one; none if it is fixed.
        numbers: Numbers of these joints in the new tree; the last one is `joint`.
    """

    joint: int
    place: pin.SE3
    series: Series
    numbers: Sequence[int]


class RebuiltTree(NamedTuple):
    """A new tree.

    Attributes:
        model: The tree.
        carriers: What moves the body of each old joint, by the number of the old joint.
    """

    model: pin.Model
    carriers: Sequence[Carrier]


def rebuilt(old: pin.Model, changes: Mapping[int, Series]) -> RebuiltTree:
    """The tree with some joints, by number, replaced by series.

    A parent has a smaller number than its children, as in each `pin.Model`; the joints need not be
    numbered depth-first. `pin.buildReducedModel` is not used: for a tree whose joints were not
    added depth-first, or have no frames, it ends the process.
    """
    model = pin.Model()
    model.name = old.name
    model.gravity = old.gravity
    model.inertias[0] = old.inertias[0]
    carriers = [Carrier(0, pin.SE3.Identity(), Series([]), [])]  # the base
    for i in range(1, old.njoints):
        series = changes[i] if i in changes else Series.whole(old.joints[i])
        carrier = _add_series(old, i, model, carriers[old.parents[i]], series)
        model.appendBodyToJoint(carrier.joint, old.inertias[i], carrier.place)
        carriers.append(carrier)
    _copy_frames(old, model, carriers)
    _copy_parameters(old, model, carriers)
    _copy_poses(old, model, carriers)
    return RebuiltTree(model, carriers)


def _add_series(
    old: pin.Model, i: int, model: pin.Model, parent: Carrier, series: Series
) -> Carrier:
    """Add the series that replaces the old joint i; `parent` carries the body before it."""
    joint = parent.joint
    place = parent.place * old.jointPlacements[i]  # of the next joint, on `joint`
    numbers = []
    for part in series.parts:
        name = old.names[i] + part.suffix
        joint = model.addJoint(joint, part.joint, place * part.place, name)
        numbers.append(joint)
        place = pin.SE3.Identity()
    return Carrier(joint, place * series.place, series, numbers)


def _copy_frames(old: pin.Model, model: pin.Model, carriers: Sequence[Carrier]) -> None:
    """Copy the frames.

    The frame of a joint becomes a frame for each of the new joints that replace it, or the frame of
    a fixed joint if there is none.
    """
    new_index = {0: 0}  # of each old frame, by its index
    for i, frame in enumerate(list(old.frames)[1:], 1):
        joint = frame.parentJoint
        carrier = carriers[joint]
        # A frame that was added without a parent frame, or before it, gets frame 0.
        parent_frame = new_index.get(frame.parentFrame, 0)
        kind = frame.type
        if kind == pin.FrameType.JOINT and frame.name == old.names[joint]:
            for k in carrier.numbers:
                new = pin.Frame(model.names[k], k, parent_frame, pin.SE3.Identity(), kind)
                parent_frame = model.addFrame(new, False)
                new_index[i] = parent_frame  # after the loop: the frame of the last joint
            if carrier.numbers:
                continue
            # The joint is fixed. Its frame is left out if a fixed frame already has this name:
            # Pinocchio keeps only one frame of a kind with the same name. Then frames on it come
            # onto the frame before it.
            kind = pin.FrameType.FIXED_JOINT
            if old.existFrame(frame.name, kind):
                new_index[i] = parent_frame
                continue
        place = carrier.place * frame.placement
        new = pin.Frame(frame.name, carrier.joint, parent_frame, place, kind)
        new_index[i] = model.addFrame(new, False)


def _copy_parameters(old: pin.Model, model: pin.Model, carriers: Sequence[Carrier]) -> None:
    """Copy limits, friction and rotors of the rates and positions that stay."""
    for i in range(1, old.njoints):
        for part, number in zip(carriers[i].series.parts, carriers[i].numbers, strict=True):
            _copy_parameters_of_part(old, old.joints[i], model, model.joints[number], part)


def _copy_parameters_of_part(
    old: pin.Model, old_joint: Any, model: pin.Model, new_joint: Any, part: Part
) -> None:
    """Copy limits, friction and rotors of the rates and positions that a part has.

    `part.rates` and `part.entries` are their indices among the rates and positions of the old
    joint. They are in the order of the rates and positions of the new joint.
    """
    for name in RATE_ARRAYS:
        for k, rate in enumerate(part.rates):
            value = getattr(old, name)[old_joint.idx_v + rate]
            getattr(model, name)[new_joint.idx_v + k] = value
    for name in POSITION_ARRAYS:
        for k, entry in enumerate(part.entries):
            value = getattr(old, name)[old_joint.idx_q + entry]
            getattr(model, name)[new_joint.idx_q + k] = value


def _copy_poses(old: pin.Model, model: pin.Model, carriers: Sequence[Carrier]) -> None:
    """Copy the stored poses; parts that have no positions in the old q are neutral."""
    for pair in old.referenceConfigurations:
        pose = np.array(pair.data())
        new_pose = pin.neutral(model)
        for i in range(1, old.njoints):
            old_joint = old.joints[i]
            q = pose[old_joint.idx_q : old_joint.idx_q + old_joint.nq]
            positions_of_parts = carriers[i].series.positions(q)
            for number, positions in zip(carriers[i].numbers, positions_of_parts, strict=True):
                first = model.joints[number].idx_q
                new_pose[first : first + positions.size] = positions
        model.referenceConfigurations[pair.key()] = new_pose
