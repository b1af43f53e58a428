# SPDX-License-Identifier: BSD-2-Clause
"""The motion of a closed chain, for referees, from its `Mechanism` alone."""

from typing import Protocol

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..model.mechanism import Mechanism
from ..model.tree import frame_id
from .constraint_rows import FrameMotion, closure_rows

#: Singular values below this count as redundant closures, relative to the largest.
REDUNDANT = 1e-10


class Tree(Protocol):
    """The open tree of a mechanism in an engine."""

    def __init__(self, mechanism: Mechanism) -> None: ...

    def move(self, q: Array, v: Array) -> None:
        """Put the tree at q with the rates v."""
        ...

    def frame(self, name: str) -> FrameMotion:
        """Placement and motion of a frame of the model."""
        ...

    def forces(self, dv: Array) -> Array:
        """Joint forces of the motion, from inertia and weight, shape (nv,)."""
        ...


class PinocchioTree:
    """The tree in Pinocchio."""

    def __init__(self, mechanism: Mechanism) -> None:
        self._model = mechanism.model
        self._data = mechanism.model.createData()

    def move(self, q: Array, v: Array) -> None:
        """See `Tree.move`."""
        self._q = q
        self._v = v
        pin.computeJointJacobians(self._model, self._data, q)
        pin.forwardKinematics(self._model, self._data, q, v, np.zeros(self._model.nv))
        pin.updateFramePlacements(self._model, self._data)

    def frame(self, name: str) -> FrameMotion:
        """See `Tree.frame`."""
        frame = frame_id(self._model, name)
        kind = pin.LOCAL_WORLD_ALIGNED
        J = np.reshape(pin.getFrameJacobian(self._model, self._data, frame, kind), (6, -1))
        drift = pin.getFrameClassicalAcceleration(self._model, self._data, frame, kind).vector
        return FrameMotion(self._data.oMf[frame], J, J @ self._v, drift.copy())

    def forces(self, dv: Array) -> Array:
        """See `Tree.forces`."""
        force: Array = pin.rnea(self._model, self._model.createData(), self._q, self._v, dv)
        return force


class MovingRobot:
    """A mechanism at q, closed, whose coordinates have the rates va.

    Attributes:
        v: Rates of all joints, shape (nv,).
        Phi: The closures' Jacobian, shape (rows, nv).
        drift: Phi_dot v, shape (rows,).
        B: Forces on the joints by motor torques of 1, shape (nv, motors).
        applied: Forces on the joints by friction, springs and lines, shape (nv,); also by the
            masses of lines, as if v were constant.
        line_inertia: Inertia of the masses of lines, shape (nv, nv).
    """

    def __init__(self, mechanism: Mechanism, tree: Tree, q: Array, va: Array) -> None:
        # The closures, first at rest: Phi gives the rates v, and v gives Phi_dot v.
        self.mechanism = mechanism
        zero = np.zeros(mechanism.model.nv)
        tree.move(q, zero)
        self.Phi, _ = closure_rows(mechanism, tree.frame, q, zero)
        self.v = self.joint_rates(va, np.zeros(len(self.Phi)))
        tree.move(q, self.v)
        _, self.drift = closure_rows(mechanism, tree.frame, q, self.v)

        # Forces of friction and springs of joints.
        friction = mechanism.friction
        springs = mechanism.springs
        self.B = mechanism.actuation
        force = -friction.viscous * self.v - friction.coulomb * np.sign(self.v)
        force -= springs.stiffness * pin.difference(mechanism.model, springs.reference, q)

        # Forces along lines.
        self.line_inertia = np.zeros((mechanism.model.nv, mechanism.model.nv))
        for line, shares in zip(mechanism.lines.forces, mechanism.lines.actuation, strict=True):
            a = tree.frame(line.frame_a)
            b = tree.frame(line.frame_b)
            d = b.placement.translation - a.placement.translation
            length = float(np.linalg.norm(d))
            row = d @ (b.J - a.J)[:3] / length  # the rate of the length is row v
            stretched = line.stiffness * (length - line.rest_length)
            tension = line.preload + stretched + line.damping * row @ self.v
            tension += line.coulomb_friction * np.sign(row @ self.v)
            if not (line.pulls_only and tension < 0):
                force -= tension * row
            self.B = self.B + np.outer(row, shares)  # a motor pushes, unlike a tension
            # The mass of the line has the acceleration row v_dot + length_ddot.
            d_dot = (b.twist - a.twist)[:3]
            d_ddot = (b.drift - a.drift)[:3]  # as if v were constant
            length_ddot = (d_dot @ d_dot + d @ d_ddot) / length - (d @ d_dot) ** 2 / length**3
            force -= line.mass * length_ddot * row
            self.line_inertia += line.mass * np.outer(row, row)
        self.applied = force

    def joint_rates(self, rates: Array, Phi_v: Array) -> Array:
        """Rates v of all joints, shape (nv,), from rates of the coordinates and Phi v.

        For accelerations dv in place of rates, Phi dv = -Phi_dot v.
        """
        system = np.vstack([self.Phi, self.mechanism.selection])
        return solution_of(system, np.concatenate([Phi_v, rates]))


def solution_of(system: Array, right: Array) -> Array:
    """The solution of a consistent system with redundant rows or columns.

    A second solution, for the residual of the first, removes its rounding.
    """
    solution = np.linalg.lstsq(system, right, rcond=REDUNDANT)[0]
    residual = right - system @ solution
    solution = solution + np.linalg.lstsq(system, residual, rcond=REDUNDANT)[0]
    return np.asarray(solution, dtype=np.float64)


def free_motions(Phi: Array) -> Array:
    """Joint rates that keep the loops closed, an orthonormal basis in rows, shape (n, nv)."""
    _, sizes, V = np.linalg.svd(Phi)
    free: Array = V[np.count_nonzero(sizes > REDUNDANT * sizes.max(initial=0.0)) :]
    return free
