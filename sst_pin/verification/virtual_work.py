# SPDX-License-Identifier: BSD-2-Clause
"""Virtual work: for each small motion that keeps the loops closed, the work of all forces is zero.

The wrenches of inertia and weight are those of each body by itself, at its mass centre.
"""

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..closed_chain import ClosedChain
from .tree_motion import MovingRobot, PinocchioTree, consistent, free_motions


class VirtualWork:
    """Dynamics of any closed chain without a recursion and without forces in the closures."""

    name = "virtual work"

    def __init__(self, chain: ClosedChain) -> None:
        self._mechanism = chain.mechanism
        self._tree = PinocchioTree(chain.mechanism)

    def torques(self, q: Array, va: Array, aa: Array) -> Array:
        """The smallest motor torques of a motion, shape (motors,)."""
        robot, motions = self._moving(q, va)
        needed, _ = self._forces(robot, q, robot.completed(aa, -robot.drift))
        return consistent(motions.T @ robot.B, motions.T @ needed)

    def generalized_forces(self, q: Array, va: Array, aa: Array) -> Array:
        """The forces along the coordinates that a motion needs, shape (n,)."""
        robot, motions = self._moving(q, va)
        needed, _ = self._forces(robot, q, robot.completed(aa, -robot.drift))
        return motions.T @ needed

    def accelerations(self, q: Array, va: Array, tau: Array) -> Array:
        """Direct dynamics: accelerations of the coordinates, shape (n,)."""
        robot, motions = self._moving(q, va)
        needed, M = self._forces(robot, q, robot.completed(0 * va, -robot.drift))
        left = motions.T @ (robot.B @ tau - needed)
        return np.asarray(np.linalg.solve(motions.T @ M @ motions, left))

    def _moving(self, q: Array, va: Array) -> tuple[MovingRobot, Array]:
        """The robot, and the rates of all joints for each coordinate's, shape (nv, n)."""
        robot = MovingRobot(self._mechanism, self._tree, q, va)
        free = free_motions(robot.Phi).T
        return robot, free @ np.linalg.inv(self._mechanism.selection @ free)

    def _forces(self, robot: MovingRobot, q: Array, dv: Array) -> tuple[Array, Array]:
        """Joint forces that the motion needs, shape (nv,), and the mass matrix of the joints."""
        model = self._mechanism.model
        kind = pin.LOCAL_WORLD_ALIGNED
        data = model.createData()
        pin.computeJointJacobians(model, data, q)
        pin.forwardKinematics(model, data, q, robot.v, dv)
        M = np.diag(model.armature) + robot.line_inertia
        forces = M @ dv - robot.applied
        for i in range(1, model.njoints):
            body = model.inertias[i]
            R = data.oMi[i].rotation
            lever = pin.skew(R @ body.lever)
            inertia = R @ body.inertia @ R.T
            # Pinocchio returns a vector where nv is 1.
            J_v, J_w = np.reshape(pin.getJointJacobian(model, data, i, kind), (2, 3, model.nv))
            J_v = J_v - lever @ J_w  # of the mass centre
            omega = J_w @ robot.v
            moved = pin.getClassicalAcceleration(model, data, i, kind)
            alpha = moved.angular
            a = moved.linear - lever @ alpha - np.cross(omega, lever @ omega)
            forces += J_v.T @ (body.mass * (a - model.gravity.linear))
            forces += J_w.T @ (inertia @ alpha + np.cross(omega, inertia @ omega))
            M += body.mass * J_v.T @ J_v + J_w.T @ inertia @ J_w
        return forces, M
