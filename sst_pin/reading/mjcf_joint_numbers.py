# SPDX-License-Identifier: BSD-2-Clause
"""Numbers of the joints of an MJCF: limits, friction, rotors, and springs."""

from typing import NamedTuple

import numpy as np

from ..arrays import Array
from .mjcf_compiled import BALL, HINGE, SLIDE, Compiled
from .mjcf_tree import MjcfTree


class JointSprings(NamedTuple):
    """Springs of the joints."""

    stiffness: Array  #: Shape (nv,).
    reference: Array  #: The configuration in which they are relaxed, shape (nq,).


def put_joint_numbers(compiled: Compiled, tree: MjcfTree) -> None:
    """Write limits of positions, friction and rotors into the model of a tree.

    A note names each ball whose limit is ignored.
    """
    mj = compiled.mj
    model = tree.model
    _put_position_limits(compiled, tree)
    # `compiled` has `tendon_armature`, because not every MuJoCo has this field.
    model.armature = tree.by_rate(
        mj.dof_armature + _armature_by_tendons(compiled, tree), compiled.tendon_armature
    )
    model.damping = np.zeros(model.nv)
    model.friction = np.zeros(model.nv)
    if not compiled.disabled("damper"):
        model.damping = tree.by_rate(mj.dof_damping, mj.tendon_damping)
    if not compiled.disabled("frictionloss"):
        model.friction = tree.by_rate(mj.dof_frictionloss, mj.tendon_frictionloss)


def springs_of(compiled: Compiled, tree: MjcfTree) -> JointSprings:
    """The springs of joints, also of the joints that the tree has for fixed tendons."""
    mj = compiled.mj
    stiffness = np.zeros(tree.model.nv)
    if not compiled.disabled("spring"):
        stiffness = tree.by_rate(mj.jnt_stiffness[mj.dof_jntid], mj.tendon_stiffness)
    reference = tree.configuration(mj.qpos_spring)
    # A tendon is relaxed at a length of its own. The joints of tendons are the last ones.
    first = len(reference) - len(tree.tendons)
    reference[first:] = mj.tendon_lengthspring[tree.tendons, 0]
    return JointSprings(stiffness, reference)


def _armature_by_tendons(compiled: Compiled, tree: MjcfTree) -> Array:
    """Inertia of joints by fixed tendons that have no joint in the tree, shape (mj.nv,).

    Such a tendon acts on one joint only; see `Compiled.needs_joint`. Its inertia m adds m c^2 to
    the joint, with the coefficient c.
    """
    mj = compiled.mj
    armature = np.zeros(mj.nv)
    for tendon in map(int, np.flatnonzero(compiled.tendon_armature)):
        if compiled.is_spatial(tendon) or tendon in tree.tendons:
            continue
        for joint, coefficient in compiled.coefficients(tendon).items():
            dof = mj.jnt_dofadr[joint]
            armature[dof] += compiled.tendon_armature[tendon] * coefficient**2
    return armature


def _put_position_limits(compiled: Compiled, tree: MjcfTree) -> None:
    """Write the ranges of hinges and slides into the model; a note names each ball with a range."""
    mj = compiled.mj
    model = tree.model
    model.lowerPositionLimit = np.full(model.nq, -np.inf)
    model.upperPositionLimit = np.full(model.nq, np.inf)
    if compiled.disabled("limit"):
        return
    balls = list[int]()
    # Index in q of the first position of a joint, by the index in v of its first rate.
    positions = {joint.idx_v: joint.idx_q for joint in list(model.joints)[1:]}
    for rate, dof in enumerate(tree.dofs):  # without the joints of tendons
        joint = int(mj.dof_jntid[dof])
        if not mj.jnt_limited[joint]:
            continue
        if mj.jnt_type[joint] == BALL:
            balls.append(joint)
        elif mj.jnt_type[joint] in (HINGE, SLIDE):
            lower, upper = mj.jnt_range[joint]
            model.lowerPositionLimit[positions[rate]] = lower
            model.upperPositionLimit[positions[rate]] = upper
    for joint in dict.fromkeys(balls):  # each once, not for each rate
        compiled.notes.append(f"joint {compiled.joint_name(joint)}: the limit of a ball is ignored")
