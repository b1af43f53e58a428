# SPDX-License-Identifier: BSD-2-Clause
"""Locks joints, or single rates of joints: a tree without them, and its shares of the weights."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array, single_array
from ..arrays import names as names_of
from ..errors import DescriptionError, InputError
from .checks import copied
from .joint_series import PartlyLocked, Series
from .joint_space import JointSpace, is_continuous
from .rebuilt_tree import RebuiltTree, rebuilt
from .tree import joint_id
from .weight_shares import Link, shares_of_links, weight_shares_of


class LockedTree(NamedTuple):
    """A tree some of whose joints or rates are locked.

    Attributes:
        model: The tree without the locked joints.
        weight_shares: For each body of which not the whole weight acts, by the name of its joint:
            [s, d_x, d_y, d_z], the share s of its weight and its offset d, [m], as in
            `weight_shares`.
    """

    model: pin.Model
    weight_shares: dict[str, Array]


def without_locked(
    model: pin.Model,
    locked: Sequence[str] | Mapping[str, float],
    weight_shares: Mapping[str, Array] = MappingProxyType({}),
) -> LockedTree:
    """The tree with some joints, or single rates of joints, fixed.

    The body of a fixed joint becomes a part of the body before it.

    Args:
        model: The tree.
        locked: Names of joints or rates, which are fixed at zero, or their positions by name.
        weight_shares: As in `LockedTree`, for the bodies of `model`.
    """
    model = copied(model)
    if list(model.mimicking_joints):
        raise InputError("locked", "the model has mimic joints; lock joints before you add these")
    _require_whole_poses(model)
    tree = rebuilt(model, _series_of_locked(model, locked))
    return LockedTree(tree.model, _shares_in(tree, model, weight_shares))


def _series_of_locked(
    model: pin.Model, locked: Sequence[str] | Mapping[str, float]
) -> dict[int, Series]:
    """What replaces each joint that is locked, by its number.

    Nothing replaces a joint that is locked as a whole. Other joints become series of joints for the
    rates that stay free.
    """
    changes: dict[int, Series] = {}
    neutral = pin.neutral(model)
    for joint_name, positions in _locked_positions(model, locked).items():
        number = joint_id(model, joint_name)
        joint = model.joints[number]
        if joint.nq == 1:
            changes[number] = Series.fixed(joint, np.array([positions[0]]))
        elif joint.nv == 1 or joint_name in locked:
            # A continuous joint, or a joint of several rates that is locked by its own name. Both
            # can only be locked at zero, see `_locked_positions`.
            q = neutral[joint.idx_q : joint.idx_q + joint.nq]
            changes[number] = Series.fixed(joint, q)
        else:
            changes[number] = PartlyLocked(joint, positions)
    return changes


def _shares_in(tree: RebuiltTree, old: pin.Model, shares: Mapping[str, Array]) -> dict[str, Array]:
    """The shares of the weights of the old tree, for the bodies of the rebuilt tree."""
    of_old_bodies = weight_shares_of(old, shares)
    if of_old_bodies is None:
        return {}
    links = list[Link]()
    for i in range(1, old.njoints):
        carrier = tree.carriers[i]
        body = old.inertias[i]
        link = Link(
            joint=carrier.joint,
            mass=body.mass,
            center=carrier.place.act(body.lever),
            share=of_old_bodies.shares[i - 1],
            offset=carrier.place.rotation @ of_old_bodies.offsets[i - 1],
        )
        links.append(link)
    return shares_of_links(tree.model, links)


def _locked_positions(
    model: pin.Model, locked: Sequence[str] | Mapping[str, float]
) -> dict[str, dict[int, float]]:
    """The position of each locked rate, by the name of its joint and its index in the joint.

    A given position belongs to one rate: a joint with several rates has to be named by its rates.
    A continuous joint takes no position: q has its cosine and its sine. It is locked at zero.
    """
    space = JointSpace(model)
    positions: dict[str, dict[int, float]] = {}
    for name in names_of("locked", list(locked) if isinstance(locked, Mapping) else locked):
        indices = space.rates_of([name]).tolist()
        joint_name = space.joint_of_rate[indices[0]]
        joint = model.joints[joint_id(model, joint_name)]
        position = 0.0
        if isinstance(locked, Mapping):
            position = float(single_array("locked", locked[name], ()))
            if is_continuous(joint):
                problem = f"joint {name} is continuous: a list of names locks it, at zero"
                raise InputError("locked", problem)
            if len(indices) > 1:
                rates = ", ".join(space.names_by_joint["rate"][name])
                raise InputError("locked", f"joint {name} has several coordinates; name {rates}")
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
