# SPDX-License-Identifier: BSD-2-Clause
"""Joints and principal axes of a tree in MuJoCo's conventions."""

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array, Indices
from ..errors import DescriptionError
from ..model.joint_space import JointSpace
from ..model.normal_tree import NormalTree

_WHOLE = {"JointModelFreeFlyer": "free", "JointModelSpherical": "ball"}


class MjcfJoint(NamedTuple):
    """A joint of MuJoCo: "hinge", "slide", "ball" or "free".

    A hinge turns about `axis` through `point`, a slide moves along `axis`, both in axes of its
    body. A free joint moves from the placement `at`. The coordinates are factor * q[entries] +
    offset and the rates factor * v[rates], with q and v of the chain. If it `mimics` another
    joint, it has no rates of its own.
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
            return np.append(x[:-4], np.roll(x[-4:], -3))  # the scalar first
        return np.arctan2(x[1:], x[:1]) if len(x) == 2 else x


def joints_of(original: pin.Model, tree: NormalTree, index: int) -> list[MjcfJoint]:
    """MuJoCo's joints for a joint of a normal tree.

    Raises:
        DescriptionError: For a joint that MuJoCo does not have.
    """
    model = tree.model
    joint, name, at = model.joints[index], model.names[index], model.jointPlacements[index]
    short, k, rows = joint.shortname(), joint.idx_q, tree.S[joint.idx_v : joint.idx_v + joint.nv]
    entries, rates = tree.entries[k : k + joint.nq], np.abs(rows).argmax(axis=1)
    factor, offset = float(rows[0, rates[0]]), float(tree.offsets[k])
    mimics = index in tree.bodies and not original.joints[tree.bodies.index(index)].nv
    more, zero = (factor, offset, mimics), np.zeros(3)
    if short in _WHOLE and not (_WHOLE[short] == "free" and model.parents[index]):
        return [MjcfJoint(name, _WHOLE[short], np.eye(3)[2], zero, at, entries, rates, *more)]
    words = JointSpace(original).rate_names
    if short == "JointModelTranslation":
        each = zip(np.eye(3), entries[:, None], rates[:, None], strict=True)
        return [MjcfJoint(words[v[0]], "slide", e, zero, at, q, v, *more) for e, q, v in each]
    data = joint.createData()
    joint.calc(data, np.eye(model.nq)[k])
    S = np.reshape(data.S, (6, -1))[:, 0]
    if joint.nv != 1 or (S[:3].any() and S[3:].any()):
        cure = "; use two slides and a hinge" if short == "JointModelPlanar" else ""
        problem = f"joint {name}: MuJoCo has no joint {short[10:]}{cure}"
        raise DescriptionError(f"model {original.name}", [problem])
    kind, axis = ("hinge", S[3:]) if S[3:].any() else ("slide", S[:3])
    word = name if mimics else words[rates[0]]
    return [MjcfJoint(word, kind, axis, zero, at, entries, rates, *more)]


def principal_axes(inertia: Array) -> tuple[Array, Array]:
    """Principal moments and axes, in the order nearest to the given axes; a rotation, (3, 3)."""
    from scipy.optimize import linear_sum_assignment

    moments, R = np.linalg.eigh(inertia)
    if np.abs(inertia - np.diag(np.diag(inertia))).max() <= 1e-15 * np.abs(moments).max():
        return np.diag(inertia).copy(), np.eye(3)
    _, order = linear_sum_assignment(-np.abs(R))
    R = R[:, order] * np.sign(np.diag(R[:, order]))
    R[:, np.diag(R).argmin()] *= np.linalg.det(R)
    return moments[order], R
