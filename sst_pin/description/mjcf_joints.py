# SPDX-License-Identifier: BSD-2-Clause
"""Joints and principal axes of a tree in MuJoCo's conventions."""

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array, Indices
from ..errors import DescriptionError
from ..model.joint_space import JointSpace
from ..model.normal_tree import NormalTree

#: Kinds of joints of several rates.
_KINDS_OF_SEVERAL_RATES = {"JointModelFreeFlyer": "free", "JointModelSpherical": "ball"}
#: Largest relative size of the off-diagonal entries of an inertia that counts as diagonal.
_ROUNDING = 1e-15


class MjcfJoint(NamedTuple):
    """A joint of MuJoCo: "hinge", "slide", "ball" or "free".

    A hinge rotates about `axis` through `point`, a slide translates along `axis`, both in axes of
    its body. The pose of a free joint is relative to the placement `at`. The coordinates are
    factor * q[entries] + offset and the rates are factor * v[rates], with q and v of the chain. A
    joint that `mimics` another joint has the entries and rates of this joint.
    """

    name: str
    kind: str
    axis: Array
    point: Array
    at: pin.SE3
    entries: Indices
    rates: Indices
    factor: float
    offset: float
    mimics: bool

    def seen_from(self, at: pin.SE3) -> "MjcfJoint":
        """The joint expressed in the frame of a body with placement `at`."""
        return self._replace(axis=at.rotation.T @ self.axis, point=at.actInv(self.point))

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

    Raises:
        DescriptionError: For a joint that MuJoCo does not have.
    """
    model = tree.model
    joint = model.joints[index]
    name = model.names[index]
    at = model.jointPlacements[index]
    type_name = joint.shortname()
    entries = tree.entries[joint.idx_q : joint.idx_q + joint.nq]
    # Each rate of the normal tree is a factor times one rate of the chain.
    rows = tree.S[joint.idx_v : joint.idx_v + joint.nv]
    rates = np.abs(rows).argmax(axis=1)
    factor = float(rows[0, rates[0]])
    offset = float(tree.offsets[joint.idx_q])
    # A mimic joint has no rates in the original tree.
    mimics = index in tree.bodies and not original.joints[tree.bodies.index(index)].nv
    scale = (factor, offset, mimics)
    origin = np.zeros(3)
    kind = _KINDS_OF_SEVERAL_RATES.get(type_name)
    # MuJoCo's free joints are relative to the world only.
    is_free_on_body = kind == "free" and model.parents[index]
    if kind and not is_free_on_body:
        return [MjcfJoint(name, kind, np.eye(3)[2], origin, at, entries, rates, *scale)]
    rate_names = JointSpace(original).rate_names
    if type_name == "JointModelTranslation":
        joints = []
        for direction, entry, rate in zip(np.eye(3), entries[:, None], rates[:, None], strict=True):
            slide = rate_names[rate[0]]
            joints.append(
                MjcfJoint(slide, "slide", direction, origin, at, entry, rate, *scale),
            )
        return joints
    data = joint.createData()
    joint.calc(data, np.eye(model.nq)[joint.idx_q])  # S is constant; 1 is a cosine
    S = np.reshape(data.S, (6, -1))[:, 0]
    is_helical = S[:3].any() and S[3:].any()
    if joint.nv != 1 or is_helical:
        cure = "; use two slides and a hinge" if type_name == "JointModelPlanar" else ""
        short_name = type_name.removeprefix("JointModel")
        problem = f"joint {name}: MuJoCo has no joint {short_name}{cure}"
        raise DescriptionError(f"model {original.name}", [problem])
    joint_name = name if mimics else rate_names[rates[0]]
    if S[3:].any():
        return [MjcfJoint(joint_name, "hinge", S[3:], origin, at, entries, rates, *scale)]
    return [MjcfJoint(joint_name, "slide", S[:3], origin, at, entries, rates, *scale)]


def principal_axes(inertia: Array) -> tuple[Array, Array]:
    """Principal moments and axes, in the order nearest to the given axes; a rotation, (3, 3)."""
    from scipy.optimize import linear_sum_assignment

    moments, R = np.linalg.eigh(inertia)
    off_diagonal = inertia - np.diag(np.diag(inertia))
    if np.abs(off_diagonal).max() <= _ROUNDING * np.abs(moments).max():
        return np.diag(inertia).copy(), np.eye(3)
    # Of the 24 rotations to principal axes, the one near the identity: order, then signs.
    _, order = linear_sum_assignment(-np.abs(R))
    R = R[:, order] * np.sign(np.diag(R[:, order]))
    R[:, np.diag(R).argmin()] *= np.linalg.det(R)
    return moments[order], R
