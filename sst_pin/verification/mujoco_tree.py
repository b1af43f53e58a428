# SPDX-License-Identifier: BSD-2-Clause
"""The tree of a chain in MuJoCo, which computes its Jacobians and inverse dynamics."""

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..description.mjcf_document import MjcfDocument
from ..description.mjcf_joints import principal_axes
from ..description.mjcf_writer import closed_mjcf
from ..errors import DescriptionError, MissingExtraError
from ..model.mechanism import Mechanism
from ..model.tree import frame_id
from .constraint_rows import FrameMotion
from .lagrange import LagrangeMultipliers


class MujocoTree:
    """The tree of a mechanism in MuJoCo.

    Attributes:
        mj: The `mujoco.MjModel`.
        data: Its `mujoco.MjData`; `move` sets it.

    Raises:
        MissingExtraError: Without MuJoCo.
        DescriptionError: For what MuJoCo does not have.
    """

    def __init__(self, mechanism: Mechanism, closure_stiffness: float | None = None) -> None:
        """Put the tree into MuJoCo.

        Args:
            mechanism: The robot.
            closure_stiffness: None for the tree alone, or the stiffness of the closures, [1/s^2].
                With a stiffness, MuJoCo's model also has the closures, as equality constraints with
                critical damping, and friction, springs and motors.
        """
        self._model = mechanism.model
        try:
            import mujoco
        except ImportError:
            raise MissingExtraError("mujoco", "verify") from None
        self._mujoco = mujoco
        if closure_stiffness is None:
            # Without friction, rotors, springs and limits of joints.
            document = MjcfDocument(mechanism, with_numbers=False)
        else:
            document = closed_mjcf(mechanism)
        try:
            self.mj = mujoco.MjModel.from_xml_string(document.text())
        except ValueError as error:
            source = f"model {self._model.name}"
            raise DescriptionError(source, [f"not for MuJoCo: {error}"]) from None
        if closure_stiffness is not None:
            # MuJoCo takes a pair of negative numbers for stiffness and damping.
            damping = 2 * np.sqrt(closure_stiffness)
            self.mj.eq_solref[:] = -closure_stiffness, -damping
        self.data = mujoco.MjData(self.mj)
        self._joints = document.joints
        #: Index in MuJoCo of the body of each joint of the robot; 0 is the world, without a name.
        self._bodies = list[int]()
        for element in document.bodies:
            name = element.get("name")
            self._bodies.append(0 if name is None else self.mj.body(name).id)
        # MuJoCo's compiler refuses masses and inertias below a minimum, so the document has this
        # minimum in their place. The compiled model may have smaller values: the robot's own.
        for body, inertia in zip(self._bodies[1:], list(self._model.inertias)[1:], strict=True):
            self.mj.body_mass[body] = inertia.mass
            self.mj.body_inertia[body] = principal_axes(inertia.inertia)[0]

    def move(self, q: Array, v: Array) -> "_MujocoMotion":
        """Put the tree at q with the rates v; returns its motion, valid until the next call."""
        # MuJoCo's rates are qvel = S v, its accelerations qacc = S dv + S_dot v.
        S = np.zeros((self.mj.nv, self._model.nv))
        S_dot_v = np.zeros(self.mj.nv)
        for joint in self._joints:
            mujoco_joint = self.mj.joint(joint.name)
            # The entries of the joint in MuJoCo's qpos.
            qpos = joint.qpos(q)
            position = mujoco_joint.qposadr[0]
            self.data.qpos[position : position + len(qpos)] = qpos

            # The rates of the joint in MuJoCo's qvel are factor * v[joint.rates], where the factor
            # is that of a mimic joint, or 1.
            count = len(joint.rates)
            dof = mujoco_joint.dofadr[0]
            S[dof : dof + count, joint.rates] = joint.factor * np.eye(count)
            if joint.kind == "free":
                # Of the velocity of the origin, MuJoCo has the components in base axes, Pinocchio
                # those in body axes, u. So MuJoCo's are R u, and their derivative for constant
                # rates is R (omega x u), with omega in body axes.
                R = pin.Quaternion(*qpos[3:]).matrix()
                u = v[joint.rates[:3]]
                omega = v[joint.rates[3:]]
                S[dof : dof + 3, joint.rates[:3]] = R
                S_dot_v[dof : dof + 3] = R @ np.cross(omega, u)
        self.data.qvel[:] = S @ v
        self._mujoco.mj_fwdPosition(self.mj, self.data)
        self._mujoco.mj_fwdVelocity(self.mj, self.data)
        return _MujocoMotion(self, v, S, S_dot_v, self._model.armature)

    def placement(self, name: str) -> pin.SE3:
        """A frame of the model in the base, for the last `move`."""
        frame = self._model.frames[frame_id(self._model, name)]
        body = self.body(name)
        at = pin.SE3(self.data.xmat[body].reshape(3, 3), self.data.xpos[body])
        return at * frame.placement

    def body(self, frame: str) -> int:
        """Index in MuJoCo of the body that has a frame."""
        return self._bodies[self._model.frames[frame_id(self._model, frame)].parentJoint]

    def jacobian(self, frame: str) -> tuple[Array, Array]:
        """J of a frame and J_dot for MuJoCo's rates, each (6, mj.nv), for the last `move`."""
        point = self.placement(frame).translation
        body = self.body(frame)
        J = np.zeros((6, self.mj.nv))
        J_dot = np.zeros((6, self.mj.nv))
        self._mujoco.mj_jac(self.mj, self.data, J[:3], J[3:], point, body)
        self._mujoco.mj_jacDot(self.mj, self.data, J_dot[:3], J_dot[3:], point, body)
        return J, J_dot

    def inverse(self, qacc: Array) -> Array:
        """MuJoCo's joint forces for its accelerations, shape (mj.nv,), for the last `move`."""
        self.data.qacc[:] = qacc
        self._mujoco.mj_inverse(self.mj, self.data)
        return np.array(self.data.qfrc_inverse)


class _MujocoMotion:
    """The tree in motion, as in `TreeMotion`, after a `move` of MuJoCo's data.

    MuJoCo's rates are qvel = S v. The armature of the robot belongs to the rates v.
    """

    def __init__(
        self, tree: MujocoTree, v: Array, S: Array, S_dot_v: Array, armature: Array
    ) -> None:
        self._tree = tree
        self._v = v
        self._S = S
        self._S_dot_v = S_dot_v
        self._armature = armature

    def frame(self, name: str) -> FrameMotion:
        """Placement and motion of a frame of the model, for the rates v."""
        J_mujoco, J_dot_mujoco = self._tree.jacobian(name)
        J = J_mujoco @ self._S
        # J_dot v is d/dt (J_mujoco S) v.
        drift = J_dot_mujoco @ self._tree.data.qvel + J_mujoco @ self._S_dot_v
        return FrameMotion(self._tree.placement(name), J, J @ self._v, drift)

    def forces(self, dv: Array) -> Array:
        """Joint forces for accelerations dv, from inertia and weight, shape (nv,)."""
        # S^T takes MuJoCo's forces to forces along the rates v, which do the same work.
        force: Array = self._S.T @ self._tree.inverse(self._S @ dv + self._S_dot_v)
        # MuJoCo's model has no armature, because its joints may have other rates.
        return force + self._armature * dv


class MujocoInverse(LagrangeMultipliers):
    """MuJoCo's kinematics and `mj_inverse` of the tree, and multipliers for the closures."""

    name = "MuJoCo mj_inverse"
    _tree_kind = MujocoTree
