# SPDX-License-Identifier: BSD-2-Clause
"""Dynamics of closed chains as one writes them on Pinocchio, and Pinocchio's own."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.linalg import qr

from sst_pin import ClosedChain

Array = NDArray[np.float64]
AXES = pin.LOCAL_WORLD_ALIGNED


class Kkt:
    """Inverse dynamics by hand: independent rows of points and welds, multipliers, one inverse."""

    def __init__(self, chain: ClosedChain, q: Array) -> None:
        self.model, self.data = chain.model, chain.model.createData()
        self.frames = [
            (self.model.getFrameId(c.frame_a), self.model.getFrameId(c.frame_b))
            for c in chain.closures
        ]
        self.sizes = [6 if closure.kind == "6d" else 3 for closure in chain.closures]
        self.coordinates = chain._current.mechanism.coordinates
        self.rest = np.setdiff1d(np.arange(self.model.nv), self.coordinates)
        self.rows = np.arange(sum(self.sizes))
        self.rows = np.sort(qr(self._Phi(q)[:, self.rest].T, pivoting=True)[2][: len(self.rest)])

    def _Phi(self, q: Array) -> Array:
        model, data = self.model, self.data
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        parts = [
            (
                pin.getFrameJacobian(model, data, b, AXES)
                - pin.getFrameJacobian(model, data, a, AXES)
            )[:size]
            for (a, b), size in zip(self.frames, self.sizes, strict=True)
        ]
        return np.vstack(parts)[self.rows]

    def forces(self, q: Array, va: Array, aa: Array) -> Array:
        """Forces of a motion along the coordinates."""
        model, data = self.model, self.data
        Phi = self._Phi(q)
        inverse, free = np.linalg.inv(Phi[:, self.rest]), Phi[:, self.coordinates]
        v, a = np.zeros((2, model.nv))
        v[self.coordinates], v[self.rest] = va, -inverse @ (free @ va)
        pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
        drift = [
            (
                pin.getFrameClassicalAcceleration(model, data, j, AXES).vector
                - pin.getFrameClassicalAcceleration(model, data, i, AXES).vector
            )[:size]
            for (i, j), size in zip(self.frames, self.sizes, strict=True)
        ]
        drift = np.concatenate(drift)[self.rows]
        a[self.coordinates], a[self.rest] = aa, -inverse @ (free @ aa + drift)
        tau = pin.rnea(model, data, q, v, a)
        return tau[self.coordinates] - free.T @ (inverse.T @ tau[self.rest])


class Constrained:
    """`pin.constraintDynamics` of a tree, added depth-first, with its points and welds closed.

    With `mu` = 0 redundant rows give NaN without an error; several iterations make up for it.
    """

    def __init__(self, chain: ClosedChain, mu: float = 1e-6, iterations: int = 10) -> None:
        self.model, self.data = chain.model, chain.model.createData()
        frames = self.model.frames
        self.constraints = []
        for closure in chain.closures:
            ends = [frames[self.model.getFrameId(f)] for f in (closure.frame_a, closure.frame_b)]
            places = [part for f in ends for part in (f.parentJoint, f.placement)]
            kind = {"6d": pin.ContactType.CONTACT_6D, "3d": pin.ContactType.CONTACT_3D}
            constraint = pin.RigidConstraintModel(
                kind[closure.kind], self.model, *places, pin.LOCAL
            )
            self.constraints.append(constraint)
        self.workspaces = [constraint.createData() for constraint in self.constraints]
        pin.initConstraintDynamics(self.model, self.data, self.constraints, self.workspaces)
        self.settings = pin.ProximalSettings(1e-14, mu, iterations)

    def accelerations(self, q: Array, v: Array, tau: Array) -> Array:
        """Accelerations of the tree."""
        return pin.constraintDynamics(
            self.model, self.data, q, v, tau, self.constraints, self.workspaces, self.settings
        )

    def derivatives(self) -> tuple[Array, Array]:
        """Derivatives of the last accelerations by q and v."""
        found = pin.computeConstraintDynamicsDerivatives(
            self.model, self.data, self.constraints, self.workspaces, self.settings
        )
        return np.array(found[0]), np.array(found[1])
