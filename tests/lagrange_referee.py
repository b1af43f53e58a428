# SPDX-License-Identifier: BSD-2-Clause
"""Dynamics of a closed chain by Lagrange multipliers, sharing no code with `sst_pin.chain`.

The closures' Jacobian comes from Pinocchio's Jacobians and accelerations of frames, the inertia
matrix from RNEA's columns; rates, torques and accelerations from least squares on all rows,
redundant ones too. No orthogonal complement, no choice of independent rows.
"""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.linalg import null_space

from trees import Lagrange

#: Singular values below this part of the largest are zero.
RCOND = 1e-9


@dataclass
class State:
    """A motion that keeps the loops closed: q (nq,), v (nv,) and its rate dv (nv,)."""

    q: np.ndarray
    v: np.ndarray
    dv: np.ndarray


class LagrangeReferee:
    """Judge of a `ClosedChain`: takes its model, the names in its closures, and nothing else.

    Args:
        model: The tree.
        closures: With `frame_a`, `frame_b` and `kind` "6d", "3d" or "hinge".
        coordinates: Names of the independent joints.
        motors: Names of the motors' joints.
    """

    def __init__(self, model, closures, coordinates, motors):
        self.model, self.data = model, model.createData()
        self.frames = [
            (model.getFrameId(c.frame_a), model.getFrameId(c.frame_b), c.kind) for c in closures
        ]
        self.coordinates = self._rates_of(coordinates)
        self.motors = self._rates_of(motors)
        self.others = np.setdiff1d(np.arange(model.nv), self.coordinates)
        zero = np.zeros(model.nv)
        self._lagrange = Lagrange(
            model,
            np.eye(model.nv)[:, self.motors],
            lambda q: self.rows(q, zero)[1],
            lambda q, v: self.rows(q, v)[2],
        )

    def _rates_of(self, names):
        joints = [self.model.joints[self.model.getJointId(name)] for name in names]
        return np.concatenate([np.arange(j.idx_v, j.idx_v + j.nv) for j in joints])

    def rows(self, q, v):
        """Residual, Jacobian J and J_dot v of the closures."""
        model, data, axes = self.model, self.data, pin.LOCAL_WORLD_ALIGNED
        pin.computeJointJacobians(model, data, q)
        pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
        pin.updateFramePlacements(model, data)
        parts = []
        for a, b, kind in self.frames:
            A, B = data.oMf[a], data.oMf[b]
            J = pin.getFrameJacobian(model, data, b, axes)
            J = J - pin.getFrameJacobian(model, data, a, axes)
            drift = [pin.getFrameClassicalAcceleration(model, data, i, axes).vector for i in (a, b)]
            drift = drift[1] - drift[0]
            gap = B.translation - A.translation
            if kind == "3d":
                parts.append((gap, J[:3], drift[:3]))
            elif kind == "6d":
                turn = pin.log3(B.rotation @ A.rotation.T)
                parts.append((np.r_[gap, turn], J, drift))
            elif kind == "hinge":  # x and y of A see no relative turn
                xy = A.rotation[:, :2].T
                omega = pin.getFrameVelocity(model, data, a, axes).angular
                moved = np.cross(omega, xy) @ (J[3:] @ v)
                tilt = xy @ np.cross(A.rotation[:, 2], B.rotation[:, 2])
                parts.append(
                    (
                        np.r_[gap, tilt],
                        np.vstack([J[:3], xy @ J[3:]]),
                        np.r_[drift[:3], xy @ drift[3:] + moved],
                    )
                )
        return tuple(np.concatenate(part) for part in zip(*parts, strict=True))

    def state(self, q, va, aa):
        """The motion of all joints that belongs to one of the coordinates."""
        _, J, _ = self.rows(q, np.zeros(self.model.nv))
        v = self._completed(J, va, 0.0)
        _, J, drift = self.rows(q, v)
        return State(q, v, self._completed(J, aa, drift))

    def _completed(self, J, of_coordinates, drift):
        rates = np.zeros(self.model.nv)
        rates[self.coordinates] = of_coordinates
        rates[self.others] = np.linalg.lstsq(J[:, self.others], -drift - J @ rates, RCOND)[0]
        return rates

    def assembled_near(self, q, step):
        """A closed configuration: from q along a random motion, then Newton's method."""
        zero = np.zeros(self.model.nv)
        q = pin.integrate(self.model, q, step)
        for _ in range(20):
            gap, J, _ = self.rows(q, zero)
            q = pin.integrate(self.model, q, -np.linalg.lstsq(J, gap, RCOND)[0])
        return q

    def torques(self, state):
        """Motor torques, the smallest ones where there are more motors than freedoms."""
        needed = pin.rnea(self.model, self.data, state.q, state.v, state.dv)
        _, J, _ = self.rows(state.q, state.v)
        motors = np.eye(self.model.nv)[:, self.motors]
        shares = np.hstack([motors, J.T])
        tau = np.linalg.lstsq(shares, needed, RCOND)[0][: len(self.motors)]
        idle, sizes, _ = np.linalg.svd(null_space(shares, rcond=RCOND)[: len(self.motors)])
        preload = idle[:, : (sizes > 1e-6).sum()]  # what the motors can do against one another
        return tau - preload @ (preload.T @ tau)

    def accelerations(self, q, v, tau):
        """Accelerations of the coordinates under motor torques."""
        return self._lagrange.accelerations(q, v, tau)[self.coordinates]

    def energy(self, state):
        """Kinetic and potential energy."""
        pin.forwardKinematics(self.model, self.data, state.q)
        joints = list(zip(self.model.inertias, self.data.oMi, strict=True))[1:]
        weight = sum(body.mass * at.act(body.lever) for body, at in joints)
        kinetic = state.v @ self._lagrange.mass_matrix(state.q) @ state.v / 2
        return kinetic, -weight @ self.model.gravity.linear
