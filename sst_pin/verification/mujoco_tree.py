# SPDX-License-Identifier: BSD-2-Clause
"""The tree of a chain in MuJoCo, whose Jacobians and inverse dynamics are its own."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..errors import DescriptionError, MissingExtraError
from ..model.closures import Closure
from ..model.mechanism import Mechanism
from ..model.tree import series_of
from .constraint_rows import FrameMotion
from .lagrange import LagrangeMultipliers

#: The least that MuJoCo compiles, [kg], [kg m^2]; bodies get their own after that.
_LEAST_MASS, _LEAST_INERTIA = 1e-12, 1e-14
#: Sizes in q and v, and in MuJoCo's qpos; of other joints 1.
_SIZES = {"free": (7, 6, 7), "ball": (4, 3, 4), "circle": (2, 1, 1)}


class _Part(NamedTuple):
    """A joint of MuJoCo: where its numbers stand in q and v, and in qpos and qvel."""

    kind: str
    joint: int  #: Its number in MuJoCo.
    at: pin.SE3  #: Placement on the parent.
    q: slice
    v: slice
    qpos: slice
    dofs: slice


class MujocoTree:
    """The tree of a mechanism in MuJoCo; `closed` also has the closures, and friction and springs.

    Attributes:
        mj: The `mujoco.MjModel`.
        data: Its `mujoco.MjData`; `move` sets it.

    Raises:
        MissingExtraError: Without MuJoCo.
        DescriptionError: For joints and closures that MuJoCo does not have.
    """

    def __init__(self, mechanism: Mechanism, closed: float | None = None) -> None:
        self._model = model = mechanism.model
        try:
            import mujoco
        except ImportError:
            raise MissingExtraError("mujoco", "verify") from None
        self._mujoco, spec = mujoco, mujoco.MjSpec()
        bodies = _add_bodies(mujoco, spec, model)
        if closed is not None:
            _close(mujoco, spec, bodies, mechanism, closed)
        try:
            self.mj = mj = spec.compile()
        except ValueError as error:
            raise DescriptionError(f"model {model.name}", [f"not for MuJoCo: {error}"]) from None
        self.data, self._parts = mujoco.MjData(mj), list(_parts(model, mj))
        self._bodies = [0, *(mj.body(name).id for name in list(model.names)[1:])]
        for body, inertia in zip(self._bodies[1:], list(model.inertias)[1:], strict=True):
            mj.body_mass[body] = inertia.mass
            mj.body_inertia[body] = np.linalg.eigvalsh(inertia.inertia)
        for part in self._parts if closed is not None else ():
            mj.dof_armature[part.dofs] = model.armature[part.v]
            mj.dof_damping[part.dofs] = mechanism.friction.viscous[part.v]
            mj.dof_frictionloss[part.dofs] = mechanism.friction.coulomb[part.v]
            if part.kind in ("hinge", "slide"):
                mj.jnt_stiffness[part.joint] = mechanism.springs.stiffness[part.v][0]
                mj.qpos_spring[part.qpos] = mechanism.springs.reference[part.q]

    def move(self, q: Array, v: Array) -> None:
        """See `Tree.move`."""
        mujoco, mj, data, self._v = self._mujoco, self.mj, self.data, v
        # qvel = S v and qacc = S dv + S_dot v; of a free joint MuJoCo takes the velocity of its
        # origin in base axes.
        self._S, self._S_dot_v = np.zeros((mj.nv, self._model.nv)), np.zeros(mj.nv)
        for part in self._parts:
            numbers, rates = q[part.q].copy(), v[part.v]
            if part.kind == "circle":
                numbers = np.arctan2(numbers[1:], numbers[:1])
            self._S[part.dofs, part.v] = np.eye(len(rates))
            if part.kind == "free":
                at = part.at * pin.XYZQUATToSE3(numbers)
                numbers, R = pin.SE3ToXYZQUAT(at), at.rotation
                first = slice(part.dofs.start, part.dofs.start + 3)
                self._S[first, part.v.start : part.v.start + 3] = R
                self._S_dot_v[first] = R @ np.cross(rates[3:], rates[:3])
            if part.kind in ("ball", "free"):
                numbers[-4:] = np.roll(numbers[-4:], 1)  # the scalar first
            data.qpos[part.qpos] = numbers
        data.qvel[:] = self._S @ v
        mujoco.mj_fwdPosition(mj, data)
        mujoco.mj_fwdVelocity(mj, data)

    def placement(self, name: str) -> pin.SE3:
        """A frame of the model in the base."""
        frame = self._model.frames[self._model.getFrameId(name)]
        body = self._bodies[frame.parentJoint]
        at = pin.SE3(self.data.xmat[body].reshape(3, 3), self.data.xpos[body])
        return at * frame.placement

    def frame(self, name: str) -> FrameMotion:
        """See `Tree.frame`."""
        mujoco, mj, data, at = self._mujoco, self.mj, self.data, self.placement(name)
        body = self._bodies[self._model.frames[self._model.getFrameId(name)].parentJoint]
        J, J_dot = np.zeros((6, mj.nv)), np.zeros((6, mj.nv))
        mujoco.mj_jac(mj, data, J[:3], J[3:], at.translation, body)
        mujoco.mj_jacDot(mj, data, J_dot[:3], J_dot[3:], at.translation, body)
        drift = J_dot @ data.qvel + J @ self._S_dot_v
        J = J @ self._S
        return FrameMotion(at, J, J @ self._v, drift)

    def forces(self, dv: Array) -> Array:
        """See `Tree.forces`."""
        self.data.qacc[:] = self._S @ dv + self._S_dot_v
        self._mujoco.mj_inverse(self.mj, self.data)
        force: Array = self._S.T @ self.data.qfrc_inverse
        return force + self._model.armature * dv  # along our axes, which may not be MuJoCo's


class MujocoInverse(LagrangeMultipliers):
    """MuJoCo's kinematics and `mj_inverse` of the tree, and multipliers for the closures."""

    name = "MuJoCo mj_inverse"
    _engine = MujocoTree


def _add_bodies(mujoco: Any, spec: Any, model: pin.Model) -> list[Any]:
    """The body of each joint, the world first."""
    spec.option.gravity = model.gravity.linear
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE  # sparse ones are wrong in MuJoCo 4.0.0
    bodies = [spec.worldbody]
    for i in range(1, model.njoints):
        at, inertia = model.jointPlacements[i], model.inertias[i]
        body = bodies[model.parents[i]].add_body(name=model.names[i])
        body.pos, body.quat = at.translation, _scalar_first(at.rotation)
        body.mass, body.ipos = max(inertia.mass, _LEAST_MASS), inertia.lever
        moments, axes = np.linalg.eigh(inertia.inertia)  # MuJoCo's own have ten digits
        body.inertia = np.maximum(moments, _LEAST_INERTIA)
        body.iquat = _scalar_first(axes * np.linalg.det(axes))
        body.explicitinertial = True
        for k, (kind, axis) in enumerate(_joints(model, i)):
            name = {"circle": "HINGE"}.get(kind, kind.upper())
            joint = body.add_joint(name=f"{model.names[i]} {k}", axis=axis)
            joint.type = getattr(mujoco.mjtJoint, f"mjJNT_{name}")
        bodies.append(body)
    return bodies


def _close(
    mujoco: Any, spec: Any, bodies: list[Any], mechanism: Mechanism, stiffness: float
) -> None:
    """Points that MuJoCo connects and frames that it welds, critically damped, [1/s^2]."""
    model = mechanism.model
    kinds = {"3d": mujoco.mjtEq.mjEQ_CONNECT, "6d": mujoco.mjtEq.mjEQ_WELD}
    for k, closure in enumerate(mechanism.closures):
        if not isinstance(closure, Closure) or closure.kind not in kinds:
            problem = f"closure {closure}: only points and frames are closed in MuJoCo here"
            raise DescriptionError(f"model {model.name}", [problem])
        names = []
        for name in (closure.frame_a, closure.frame_b):
            frame = model.frames[model.getFrameId(name)]
            site = bodies[frame.parentJoint].add_site(name=f"{k} {name}")
            site.pos = frame.placement.translation
            site.quat = _scalar_first(frame.placement.rotation)
            names.append(site.name)
        row = spec.add_equality(type=kinds[closure.kind], name1=names[0], name2=names[1])
        row.objtype = mujoco.mjtObj.mjOBJ_SITE
        row.solref[:] = -stiffness, -2 * np.sqrt(stiffness)  # negative: the numbers themselves
        row.solimp[:2] = 0.9999, 0.9999  # MuJoCo has no more; the stiffness closes the rest


def _scalar_first(R: Array) -> Array:
    return np.roll(pin.Quaternion(R).coeffs(), 1)


def _joints(model: pin.Model, i: int) -> Iterator[tuple[str, Array]]:
    """Kinds and axes of MuJoCo's joints, in the place of one of ours."""
    joint = model.joints[i]
    known = {"JointModelFreeFlyer": "free", "JointModelSpherical": "ball"}
    if joint.shortname() in known:
        yield known[joint.shortname()], np.array([0.0, 0, 1])
    elif joint.shortname() == "JointModelTranslation":
        yield from (("slide", axis) for axis in np.eye(3))
    else:
        for one, at in series_of(joint):
            data = one.createData()
            one.calc(data, np.array([1.0, 0.0][: one.nq]))
            S = np.reshape(data.S, (6, -1))[:, 0]
            turns = bool(S[3:].any())
            if one.nv != 1 or (turns and S[:3].any()) or not at.isIdentity():
                problem = f"joint {model.names[i]}: MuJoCo has no joint {joint.shortname()[10:]}"
                raise DescriptionError(f"model {model.name}", [problem])
            kind = "circle" if one.nq == 2 else "hinge" if turns else "slide"
            yield kind, S[3:] if turns else S[:3]


def _parts(model: pin.Model, mj: Any) -> Iterator[_Part]:
    for i in range(1, model.njoints):
        q, v = model.joints[i].idx_q, model.joints[i].idx_v
        for k, (kind, _) in enumerate(_joints(model, i)):
            nq, nv, size = _SIZES.get(kind, (1, 1, 1))
            joint = mj.joint(f"{model.names[i]} {k}")
            there = (slice(x[0], x[0] + n) for x, n in ((joint.qposadr, size), (joint.dofadr, nv)))
            at, ours = model.jointPlacements[i], (slice(q, q + nq), slice(v, v + nv))
            yield _Part(kind, joint.id, at, *ours, *there)
            q, v = q + nq, v + nv
