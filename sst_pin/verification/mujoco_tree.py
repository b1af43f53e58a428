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

    With `closed` it also has the closures, friction, springs and motors. `closed` is the stiffness
    of the equality constraints, [1/s^2]; they are critically damped.

    Attributes:
        mj: The `mujoco.MjModel`.
        data: Its `mujoco.MjData`; `move` sets it.

    Raises:
        MissingExtraError: Without MuJoCo.
        DescriptionError: For what MuJoCo does not have.
    """

    def __init__(self, mechanism: Mechanism, closed: float | None = None) -> None:
        self._model = model = mechanism.model
        try:
            import mujoco
        except ImportError:
            raise MissingExtraError("mujoco", "verify") from None
        self._mujoco = mujoco
        if closed is None:
            document = MjcfDocument(mechanism, with_numbers=False)
        else:
            document = closed_mjcf(mechanism)
        try:
            self.mj = mj = mujoco.MjModel.from_xml_string(document.text())
        except ValueError as error:
            raise DescriptionError(f"model {model.name}", [f"not for MuJoCo: {error}"]) from None
        if closed is not None:
            mj.eq_solref[:] = -closed, -2 * np.sqrt(closed)  # negative: stiffness and damping
        self.data = mujoco.MjData(mj)
        self._joints = document.joints
        names = (body.get("name") for body in document.bodies)
        self._bodies = [0 if name is None else mj.body(name).id for name in names]
        for body, inertia in zip(self._bodies[1:], list(model.inertias)[1:], strict=True):
            mj.body_mass[body] = inertia.mass  # also less than MuJoCo compiles
            mj.body_inertia[body] = principal_axes(inertia.inertia)[0]

    def move(self, q: Array, v: Array) -> None:
        """See `Tree.move`."""
        mj = self.mj
        data = self.data
        self._v = v
        # qvel = S v and qacc = S dv + S_dot v; of a free joint MuJoCo takes the velocity of its
        # origin in base axes.
        self._S = np.zeros((mj.nv, self._model.nv))
        self._S_dot_v = np.zeros(mj.nv)
        for joint in self._joints:
            there = mj.joint(joint.name)
            numbers = joint.qpos(q)
            rates = v[joint.rates]
            first = there.dofadr[0]
            position = there.qposadr[0]
            data.qpos[position : position + len(numbers)] = numbers
            rows = self._S[first : first + len(rates)]
            rows[:, joint.rates] = joint.factor * np.eye(len(rates))
            if joint.kind == "free":
                R = pin.Quaternion(*numbers[3:]).matrix()
                rows[:3, joint.rates[:3]] = R
                self._S_dot_v[first : first + 3] = R @ np.cross(rates[3:], rates[:3])
        data.qvel[:] = self._S @ v
        self._mujoco.mj_fwdPosition(mj, data)
        self._mujoco.mj_fwdVelocity(mj, data)

    def placement(self, name: str) -> pin.SE3:
        """A frame of the model in the base."""
        frame = self._model.frames[frame_id(self._model, name)]
        body = self._bodies[frame.parentJoint]
        at = pin.SE3(self.data.xmat[body].reshape(3, 3), self.data.xpos[body])
        return at * frame.placement

    def frame(self, name: str) -> FrameMotion:
        """See `Tree.frame`."""
        mujoco = self._mujoco
        mj = self.mj
        data = self.data
        at = self.placement(name)
        body = self._bodies[self._model.frames[frame_id(self._model, name)].parentJoint]
        J = np.zeros((6, mj.nv))
        J_dot = np.zeros((6, mj.nv))
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
