# SPDX-License-Identifier: BSD-2-Clause
"""Dynamics of closed chains as one writes them on Pinocchio, and Pinocchio's own."""

from collections.abc import Callable

import numpy as np
import pinocchio as pin
from scipy.linalg import qr

from sst_pin import ClosedChain
from sst_pin.arrays import Array

AXES = pin.LOCAL_WORLD_ALIGNED


class Kkt:
    """Inverse dynamics by hand: independent rows of points and welds, multipliers, one inverse."""

    def __init__(self, chain: ClosedChain, q: Array) -> None:
        self.model, self.data = model, _ = chain.model, chain.model.createData()
        self.closures = [
            (model.getFrameId(c.frame_a), model.getFrameId(c.frame_b), 6 if c.kind == "6d" else 3)
            for c in chain.closures
        ]
        self.coordinates = chain.mechanism.coordinates
        self.rest = np.setdiff1d(np.arange(model.nv), self.coordinates)
        self.rows = np.arange(sum(size for *_, size in self.closures))
        self.rows = np.sort(qr(self._Phi(q)[:, self.rest].T, pivoting=True)[2][: len(self.rest)])

    def _Phi(self, q: Array) -> Array:
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)
        return self._differences(
            lambda frame: pin.getFrameJacobian(self.model, self.data, frame, AXES)
        )

    def _differences(self, of: Callable[[int], Array]) -> Array:
        """What the second frame of each closure has more than the first, in independent rows."""
        parts = [(of(b) - of(a))[:size] for a, b, size in self.closures]
        return np.concatenate(parts)[self.rows]

    def forces(self, q: Array, va: Array, aa: Array) -> Array:
        """Forces of a motion along the coordinates."""
        model = self.model
        data = self.data
        Phi = self._Phi(q)
        inverse = np.linalg.inv(Phi[:, self.rest])
        free = Phi[:, self.coordinates]
        v, a = np.zeros((2, model.nv))
        v[self.coordinates], v[self.rest] = va, -inverse @ (free @ va)
        pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
        drift = self._differences(
            lambda frame: pin.getFrameClassicalAcceleration(model, data, frame, AXES).vector
        )
        a[self.coordinates], a[self.rest] = aa, -inverse @ (free @ aa + drift)
        tau = pin.rnea(model, data, q, v, a)
        return tau[self.coordinates] - free.T @ (inverse.T @ tau[self.rest])


class Constrained:
    """`pin.constraintDynamics` of a tree, added depth-first, with its points and welds closed.

    With `mu` = 0 redundant rows give NaN without an error; several iterations make up for it.
    """

    def __init__(
        self, chain: ClosedChain, mu: float = 1e-6, iterations: int = 10, accuracy: float = 1e-14
    ) -> None:
        model = chain.model
        constraints = []
        for closure in chain.closures:
            ends = [model.frames[model.getFrameId(f)] for f in (closure.frame_a, closure.frame_b)]
            places = [part for f in ends for part in (f.parentJoint, f.placement)]
            kind = {"6d": pin.ContactType.CONTACT_6D, "3d": pin.ContactType.CONTACT_3D}
            constraints.append(
                pin.RigidConstraintModel(kind[closure.kind], model, *places, pin.LOCAL)
            )
        self.tree = model, model.createData()
        self.closures = constraints, [constraint.createData() for constraint in constraints]
        pin.initConstraintDynamics(*self.tree, *self.closures)
        self.settings = pin.ProximalSettings(accuracy, mu, iterations)

    def accelerations(self, q: Array, v: Array, tau: Array) -> Array:
        """Accelerations of the tree."""
        return pin.constraintDynamics(*self.tree, q, v, tau, *self.closures, self.settings)
