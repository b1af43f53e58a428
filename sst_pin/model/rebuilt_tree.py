# SPDX-License-Identifier: BSD-2-Clause
"""A tree built again joint by joint, with some joints fixed or replaced by several in series."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin

from ..arrays import Array

#: Lists of a model with an entry for each joint, the world among them.
JOINT_LISTS = (
    "inertias",
    "jointPlacements",
    "joints",
    "parents",
    "names",
    "children",
    "subtrees",
    "supports",
    "idx_qs",
    "nqs",
    "idx_vs",
    "nvs",
)
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


def rebuilt(old: pin.Model, parts: Mapping[int, Mapping[str, Any]], q: Array) -> pin.Model:
    """The tree with some joints replaced; its joints may come in any order.

    `pin.buildReducedModel` needs joints added depth-first, each with a frame; without these it ends
    the process. `parts` has, for joints by number, the joints in series that replace them, by what
    is added to the name; a joint without parts is fixed where it is at q.
    """
    data, model = old.createData(), pin.Model()
    pin.forwardKinematics(old, data, q)
    model.name, model.gravity = old.name, old.gravity
    model.inertias[0] = old.inertias[0]
    bearers = [(0, pin.SE3.Identity())]  # of each old joint, the new one and its place there
    for i in range(1, old.njoints):
        bearer, place = bearers[old.parents[i]]
        own = parts.get(i, {"": old.joints[i]})
        place = place * (old.jointPlacements[i] if own else data.liMi[i])
        for suffix, joint in own.items():
            bearer = model.addJoint(bearer, joint, place, old.names[i] + suffix)
            model.addJointFrame(bearer)
            place = pin.SE3.Identity()
        model.appendBodyToJoint(bearer, old.inertias[i], place)
        bearers.append((bearer, place))
    for frame in list(old.frames)[1:]:
        kind, (bearer, place) = frame.type, bearers[frame.parentJoint]
        if kind == pin.FrameType.JOINT:
            if parts.get(frame.parentJoint, True):
                continue
            kind = pin.FrameType.FIXED_JOINT
        model.addFrame(pin.Frame(frame.name, bearer, place * frame.placement, kind), False)
    poses = {pair.key(): np.array(pair.data()) for pair in old.referenceConfigurations}
    moved = {name: pin.neutral(model) for name in poses}
    for i in range(1, old.njoints):
        if i not in parts:
            here, there = model.joints[bearers[i][0]], old.joints[i]
            rates, old_rates = (slice(j.idx_v, j.idx_v + j.nv) for j in (here, there))
            entries, old_entries = (slice(j.idx_q, j.idx_q + j.nq) for j in (here, there))
            for field in RATE_ARRAYS:
                getattr(model, field)[rates] = getattr(old, field)[old_rates]
            for field in POSITION_ARRAYS:
                getattr(model, field)[entries] = getattr(old, field)[old_entries]
            for name, pose in poses.items():
                moved[name][entries] = pose[old_entries]
    for name, pose in moved.items():
        model.referenceConfigurations[name] = pose
    return model
