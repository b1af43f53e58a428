# SPDX-License-Identifier: BSD-2-Clause
"""PyBullet, without its window."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from . import CLOSURES, Array, Tool, pose


class Pybullet(Tool):
    name = "PyBullet"
    module = "pybullet"
    distribution = "pybullet"
    closing = "`createConstraint`"
    step = 1e-4

    def __init__(self, folder: Path) -> None:
        import pybullet

        self._bullet = pybullet
        if not pybullet.isConnected():
            pybullet.connect(pybullet.DIRECT)
        pybullet.resetSimulation()
        path = str(folder / self.file)
        self._robot = robot = pybullet.loadURDF(path, flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
        pybullet.setGravity(0, 0, -9.81)
        joints = [pybullet.getJointInfo(robot, i) for i in range(pybullet.getNumJoints(robot))]
        self._links = {joint[12].decode(): joint[0] for joint in joints}
        self._moving = [joint[0] for joint in joints if joint[2] != pybullet.JOINT_FIXED]
        self.joints = [joints[i][1].decode() for i in self._moving]
        links = [-1, *self._links.values()]
        self.mass = sum(pybullet.getDynamicsInfo(robot, link)[0] for link in links)
        self.visuals = len(pybullet.getVisualShapeData(robot))

    def _put(self, q: Array) -> None:
        for joint, angle in zip(self._moving, q, strict=True):
            self._bullet.resetJointState(self._robot, joint, angle)

    def _link_pose(self, link: int) -> Array:
        state = self._bullet.getLinkState(self._robot, link, computeForwardKinematics=True)
        # Poses of the mass centre, and of the mass centre in the link; the pose of the link itself
        # (state[4:6]) is made of these two in single precision.
        principal, inertial = (Rotation.from_quat(state[i]).as_matrix() for i in (1, 3))
        rotation = principal @ inertial.T
        return pose(rotation, state[0] - rotation @ state[2])

    def frame_poses(self, q: Array) -> dict[str, Array]:
        self._put(q)
        return {name: self._link_pose(link) for name, link in self._links.items()}

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        arguments = (list(x) for x in (q, v, a))
        return np.array(self._bullet.calculateInverseDynamics(self._robot, *arguments))

    def fall(self, q0: Array, duration: float) -> Array:
        bullet, robot = self._bullet, self._robot
        self._put(q0)
        for link in [-1, *self._links.values()]:
            bullet.changeDynamics(robot, link, linearDamping=0, angularDamping=0, jointDamping=0)
        for joint in self._moving:  # every joint is born with a motor that holds it
            bullet.setJointMotorControl2(robot, joint, bullet.VELOCITY_CONTROL, force=0)
        for first, second in ([self._links[name] for name in pair] for pair in CLOSURES):
            at, o = (robot, first, robot, second), [0, 0, 0]
            bullet.createConstraint(*at, bullet.JOINT_FIXED, o, o, o)
        bullet.setTimeStep(self.step)
        for _ in range(round(duration / self.step)):
            bullet.stepSimulation()
        return np.array([state[0] for state in bullet.getJointStates(robot, self._moving)])
