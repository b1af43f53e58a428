# SPDX-License-Identifier: BSD-2-Clause
"""Joints and principal axes of a tree in MuJoCo's conventions.

A body of MuJoCo has joints of four kinds: hinge, slide, ball, free. A joint of the robot becomes
one of these, or several in series.
"""

from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array, Indices
from ..errors import DescriptionError
from ..model.joint_space import JointSpace
from ..model.normal_tree import NormalTree

#: Kinds of joints of several rates.
_KINDS_OF_SEVERAL_RATES = {"JointModelFreeFlyer": "free", "JointModelSpherical": "ball"}
#: An inertia counts as diagonal if its off-diagonal entries are at most this part of its largest
#: moment, which is rounding. Without this limit, rounding would choose the axes of equal moments.
_ROUNDING = 1e-15


class MjcfJoint(NamedTuple):
    """A joint of MuJoCo, and how its coordinates follow from q and v of the robot."""

    name: str
    #: "hinge", "slide", "ball" or "free".
    kind: str
    #: A hinge rotates about `axis` through `point`, a slide translates along `axis`. Both arrays
    #: have the shape (3,) and are in the frame of the joint, or, after `seen_from`, in the frame of
    #: a later joint at q = 0.
    axis: Array
    point: Array
    #: Placement of the joint on its parent. The pose of a free joint in q is relative to this
    #: placement; its pose in MuJoCo's coordinates is relative to the world.
    at: pin.SE3
    #: With q and v of the robot's own tree, MuJoCo's coordinates are factor * q[entries] + offset,
    #: and its rates are factor * v[rates]. Factor and offset are 1 and 0 except for a mimic joint.
    entries: Indices
    rates: Indices
    factor: float
    offset: float
    #: Whether the joint mimics another joint, whose entries and rates it has.
    mimics: bool

    def seen_from(self, later: pin.SE3) -> "MjcfJoint":
        """The joint, with axis and point in the frame of a later joint.

        Args:
            later: The placement of the later joint in the frame that axis and point have now.
        """
        return self._replace(axis=later.rotation.T @ self.axis, point=later.actInv(self.point))

    def qpos(self, q: Array) -> Array:
        """MuJoCo's coordinates of the joint for a configuration, shape (nq,)."""
        x = self.factor * q[self.entries] + self.offset
        if self.kind == "free":
            x = pin.SE3ToXYZQUAT(self.at * pin.XYZQUATToSE3(x))
        if self.kind in ("free", "ball"):
            # MuJoCo has the scalar of a quaternion first, Pinocchio last.
            return np.append(x[:-4], np.roll(x[-4:], -3))
        if len(x) == 2:  # cosine and sine of a continuous joint
            return np.arctan2(x[1:], x[:1])
        return x


def joints_of(original: pin.Model, tree: NormalTree, index: int) -> list[MjcfJoint]:
    """MuJoCo's joints for a joint of a normal tree.

    The normal tree has the configuration factors * q[entries] + offsets and the rates S v, for q
    and v of the original tree; see `NormalTree`. Each row of S has one entry that is not zero.

    Args:
        original: The robot's own tree.
        tree: Its normal tree.
        index: The joint of the normal tree.

    Raises:
        DescriptionError: For a joint that MuJoCo does not have.
    """
    joint = tree.model.joints[index]
    type_name = joint.shortname()
    common = _draft(original, tree, index)
    rate_names = JointSpace(original).rate_names

    # Joints of several rates.
    kind = _KINDS_OF_SEVERAL_RATES.get(type_name)
    if kind == "free" and tree.model.parents[index]:
        problem = "MuJoCo has free joints on the world only; use three slides and a ball"
        raise DescriptionError(f"model {original.name}", [f"joint {common.name}: {problem}"])
    if kind:
        return [common._replace(kind=kind)]
    if type_name == "JointModelTranslation":
        slides = list[MjcfJoint]()
        for k, axis in enumerate(np.eye(3)):
            slide = common._replace(
                name=rate_names[common.rates[k]],
                kind="slide",
                axis=axis,
                entries=common.entries[k : k + 1],
                rates=common.rates[k : k + 1],
            )
            slides.append(slide)
        return slides

    # Joints of one rate, by their twist [linear; angular] for the rate 1.
    twist = _twist(tree.model, joint)
    is_helical = twist[:3].any() and twist[3:].any()
    if joint.nv != 1 or is_helical:
        cure = "; use two slides and a hinge" if type_name == "JointModelPlanar" else ""
        short_name = type_name.removeprefix("JointModel")
        problem = f"joint {common.name}: MuJoCo has no joint {short_name}{cure}"
        raise DescriptionError(f"model {original.name}", [problem])
    # A mimic joint has the rate of the joint that it follows, but needs another name.
    name = common.name if common.mimics else rate_names[common.rates[0]]
    if twist[3:].any():
        return [common._replace(name=name, kind="hinge", axis=twist[3:])]
    return [common._replace(name=name, kind="slide", axis=twist[:3])]


def _draft(original: pin.Model, tree: NormalTree, index: int) -> MjcfJoint:
    """All that MuJoCo's joints for a joint have in common.

    Kind and axis have no meaning yet: `joints_of` replaces them.
    """
    joint = tree.model.joints[index]
    rows = tree.S[joint.idx_v : joint.idx_v + joint.nv]
    rates = np.abs(rows).argmax(axis=1)  # the column of the entry of each row that is not zero
    # A mimic joint has no rates in the original tree. `tree.bodies` has the joint of each original
    # body; it leaves out joints in series before it, which are no mimic joints.
    is_mimic = False
    if index in tree.bodies:
        is_mimic = not original.joints[tree.bodies.index(index)].nv
    return MjcfJoint(
        name=tree.model.names[index],
        kind="hinge",
        axis=np.zeros(3),
        point=np.zeros(3),
        at=tree.model.jointPlacements[index],
        entries=tree.entries[joint.idx_q : joint.idx_q + joint.nq],
        rates=rates,
        factor=float(rows[0, rates[0]]),  # a mimic joint, the only one with a factor, has one rate
        offset=float(tree.offsets[joint.idx_q]),
        mimics=is_mimic,
    )


def _twist(model: pin.Model, joint: Any) -> Array:
    """The first column of the motion subspace of a joint, shape (6,): [linear; angular]."""
    data = joint.createData()
    # The column is the same at all configurations of the normal tree's joints. The entry 1 makes
    # the configuration of a continuous joint valid: cosine 1 and sine 0.
    q = np.zeros(model.nq)
    q[joint.idx_q] = 1.0
    joint.calc(data, q)
    return np.reshape(data.S, (6, -1))[:, 0]


def principal_axes(inertia: Array) -> tuple[Array, Array]:
    """Principal moments, shape (3,), and axes in the columns of a rotation R, shape (3, 3).

    inertia = R diag(moments) R^T. Of the 24 such rotations, R is the one nearest to the identity.
    """
    from scipy.optimize import linear_sum_assignment

    moments, R = np.linalg.eigh(inertia)
    off_diagonal = inertia - np.diag(np.diag(inertia))
    if np.abs(off_diagonal).max() <= _ROUNDING * np.abs(moments).max():
        return np.diag(inertia).copy(), np.eye(3)
    # The rotation nearest to the identity has the largest trace. First the order of the axes (the
    # columns of R) is chosen, so that the sum of |R_ii| is largest. Then the signs of the axes are
    # chosen, so that all R_ii are positive and this sum is the trace.
    #
    # The result is a rotation and not a reflection, because a reflection has a trace of at most 1,
    # and this trace is larger than 1. Proof: the mean over all orders of the sum of |R_ii| is a
    # third of the sum of all |R_ij|. This is at least a third of the sum of all R_ij^2, which is
    # 3 / 3 = 1. If some entry is not 0 or +-1, its size exceeds its square, so the mean is larger
    # than 1, and the largest sum is too. If all entries are 0 or +-1, the largest sum is 3.
    #
    # No R_ii is 0, so each has a sign: if R_33 were 0, an exchange of axis 3 with axis 1 or axis 2
    # would make the sum larger.
    _, order = linear_sum_assignment(-np.abs(R))
    R = R[:, order] * np.sign(np.diag(R[:, order]))
    return moments[order], R
