# SPDX-License-Identifier: BSD-2-Clause
"""Locks joints, or single rates of joints: the tree without them, and the shares of the weights."""

from collections.abc import Mapping, Sequence

import numpy as np
import pinocchio as pin

from ..arrays import Array, single_array
from ..arrays import names as names_of
from ..errors import DescriptionError, InputError
from .checks import copied
from .joint_series import PartlyLocked, Series
from .joint_space import JointSpace, is_continuous
from .rebuilt_tree import rebuilt
from .tree import frame_id, joint_id
from .weight_shares import Link, shares_of_links, weight_shares_of


def without_locked(model: pin.Model, locked: Sequence[str] | Mapping[str, float]) -> pin.Model:
    """The tree with some joints, or single rates of joints, fixed.

    `locked` are names of joints or rates, which are fixed at zero, or their positions by name.
    """
    model = copied(model)
    if list(model.mimicking_joints):
        raise InputError("locked", "the model has mimic joints; lock joints before you add these")
    _require_whole_poses(model)
    # Joints that are locked as a whole go; others become series of the joints that can move.
    neutral = pin.neutral(model)
    changes: dict[int, Series] = {}
    for joint_name, positions in _locked_positions(model, locked).items():
        number = joint_id(model, joint_name)
        joint = model.joints[number]
        if joint.nq == 1:
            changes[number] = Series.fixed(joint, np.array([positions[0]]))
        elif joint.nv == 1 or joint_name in locked:
            # A continuous joint, or one that is locked by its own name: `_locked_positions` has
            # refused positions other than zero.
            q = neutral[joint.idx_q : joint.idx_q + joint.nq]
            changes[number] = Series.fixed(joint, q)
        else:
            changes[number] = PartlyLocked(joint, positions)
    return rebuilt(model, changes)


def shares_without_locked(
    model: pin.Model, locked: Sequence[str] | Mapping[str, float], shares: Mapping[str, Array]
) -> dict[str, Array]:
    """The shares of the weights, by the names of joints, in the tree `without_locked`.

    The body of a locked joint becomes a part of another body.
    """
    before = weight_shares_of(model, shares)
    if before is None:
        return {}
    # A frame at each joint shows where its body is afterwards.
    marked = copied(model)
    frames = [f"body {i} before joints are locked" for i in range(model.njoints)]
    for i in range(1, model.njoints):
        here = pin.SE3.Identity()
        marked.addFrame(pin.Frame(frames[i], i, 0, here, pin.FrameType.OP_FRAME), False)
    after = without_locked(marked, locked)
    links = list[Link]()
    for i in range(1, model.njoints):
        frame = after.frames[frame_id(after, frames[i])]
        body = model.inertias[i]
        link = Link(
            joint=frame.parentJoint,
            mass=body.mass,
            center=frame.placement.act(body.lever),
            share=before.shares[i - 1],
            offset=frame.placement.rotation @ before.offsets[i - 1],
        )
        links.append(link)
    return shares_of_links(after, links)


def _locked_positions(
    model: pin.Model, locked: Sequence[str] | Mapping[str, float]
) -> dict[str, dict[int, float]]:
    """The position of each locked rate, by the name of its joint and its index in the joint.

    A position can only be given to one rate: a joint with several, or a continuous one, has no
    single position that its name could mean.
    """
    space = JointSpace(model)
    joint_of_rate: dict[int, str] = {}
    for joint_name, rates in space.rates.items():
        for rate in rates:
            joint_of_rate[rate] = joint_name
    positions: dict[str, dict[int, float]] = {}
    for name in names_of("locked", list(locked) if isinstance(locked, Mapping) else locked):
        indices = space.rates_of([name]).tolist()
        joint_name = joint_of_rate[indices[0]]
        joint = model.joints[joint_id(model, joint_name)]
        position = 0.0
        if isinstance(locked, Mapping):
            position = float(single_array("locked", locked[name], ()))
            if len(indices) > 1 or is_continuous(joint):
                problem = f"joint {name} has several coordinates"
                if joint.nv > 1:
                    problem += f"; name {', '.join(space.names_by_joint['rate'][name])}"
                raise InputError("locked", problem)
        for k in indices:
            positions.setdefault(joint_name, {})[k - joint.idx_v] = position
    return positions


def _require_whole_poses(model: pin.Model) -> None:
    """Refuse stored poses that do not have nq numbers: Pinocchio does not check them."""
    problems = []
    for pose in model.referenceConfigurations:
        length = len(pose.data())
        if length != model.nq:
            problems.append(f"pose {pose.key()}: {length} numbers, {model.nq} are needed")
    if problems:
        raise DescriptionError(f"model {model.name}", problems)
