# SPDX-License-Identifier: BSD-2-Clause
"""The joints and principal axes of a tree as MuJoCo has them."""

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..errors import DescriptionError
from ..model.joint_space import JointSpace
from ..model.normal_tree import series_of

_WHOLE = {"JointModelFreeFlyer": "free", "JointModelSpherical": "ball"}
_CURES = {
    "JointModelPlanar": "; use two slides and a hinge",
    "JointModelMimic": "; use a Coupling",
}


class MjcfJoint(NamedTuple):
    """A joint of MuJoCo, in the place of one of ours or of one of several in series.

    Its name; "hinge", "slide", "ball" or "free"; its axis and a point of it in axes of its body;
    its entries of q and v. `at` is where a free joint starts.
    """

    name: str
    kind: str
    axis: Array
    point: Array
    q: slice
    v: slice
    at: pin.SE3

    def seen_from(self, at: pin.SE3) -> "MjcfJoint":
        """The same joint in the axes of a body that lies there in its own."""
        return self._replace(axis=at.rotation.T @ self.axis, point=at.actInv(self.point))

    def qpos(self, q: Array) -> Array:
        """MuJoCo's coordinates of the joint for a configuration, shape (nq,)."""
        numbers = q[self.q]
        if self.kind == "free":
            numbers = pin.SE3ToXYZQUAT(self.at * pin.XYZQUATToSE3(numbers))
        if self.kind in ("free", "ball"):
            return np.append(numbers[:-4], np.roll(numbers[-4:], 1))  # the scalar first
        return np.arctan2(numbers[1:], numbers[:1]) if len(numbers) == 2 else numbers


def joints_of(model: pin.Model, index: int) -> tuple[list[MjcfJoint], pin.SE3]:
    """MuJoCo's joints for a joint, and their body's placement on the parent with all at zero.

    Raises:
        DescriptionError: For a joint that MuJoCo does not have.
    """
    joint, name, at = model.joints[index], model.names[index], model.jointPlacements[index]
    q, v, short = joint.idx_q, joint.idx_v, joint.shortname()
    whole = slice(q, q + joint.nq), slice(v, v + joint.nv)
    if short in _WHOLE and not (_WHOLE[short] == "free" and model.parents[index]):
        return [MjcfJoint(name, _WHOLE[short], np.eye(3)[2], np.zeros(3), *whole, at)], at
    if short == "JointModelTranslation":
        slides = (pin.JointModelPX(), pin.JointModelPY(), pin.JointModelPZ())
        series = [(slide, pin.SE3.Identity()) for slide in slides]
    else:
        series = series_of(joint)
    names, end, parts = JointSpace(model).rate_names, pin.SE3.Identity(), []
    for one, step in series:
        end = end * step
        data = one.createData()
        one.calc(data, np.eye(one.nq)[0])
        S = np.reshape(data.S, (6, -1))[:, 0]
        if one.nv != 1 or (S[:3].any() and S[3:].any()) or short in _CURES:
            problem = f"joint {name}: MuJoCo has no joint {short[10:]}{_CURES.get(short, '')}"
            raise DescriptionError(f"model {model.name}", [problem])
        parts.append((S, end, slice(q, q + one.nq), slice(v, v + 1)))
        q, v = q + one.nq, v + 1
    joints = []
    for S, here, of_q, of_v in parts:
        there, kind = end.actInv(here), "hinge" if S[3:].any() else "slide"
        axis = there.rotation @ (S[3:] if kind == "hinge" else S[:3])
        word = name if len(parts) == 1 else names[of_v.start]
        joints.append(MjcfJoint(word, kind, axis, there.translation, of_q, of_v, at))
    return joints, at * end


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
