# SPDX-License-Identifier: BSD-2-Clause
"""The motion of a closed chain, for referees, from its `Mechanism` alone."""

from typing import NamedTuple, Protocol

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..model.lines import LineForce
from ..model.mechanism import Mechanism
from ..model.tree import frame_id
from ..model.weight_shares import WeightShares
from .constraint_rows import FrameMotion, closure_rows

#: Singular values below this part of the largest one belong to redundant closures. In exact
#: arithmetic they are zero; they are at most 1e-11, the error of assembled loops.
REDUNDANT = 1e-10


# --- the open tree ------------------------------------------------------------------------------


class TreeMotion(Protocol):
    """The open tree of a mechanism in motion, at one configuration q with rates v."""

    def frame(self, name: str) -> FrameMotion:
        """Placement and motion of a frame of the model."""
        ...

    def forces(self, dv: Array) -> Array:
        """Joint forces for accelerations dv, from inertia and weight, shape (nv,)."""
        ...


class Tree(Protocol):
    """The open tree of a mechanism in a program for multibody dynamics."""

    def __init__(self, mechanism: Mechanism) -> None: ...

    def move(self, q: Array, v: Array) -> TreeMotion:
        """Put the tree at q with the rates v; returns its motion, valid until the next call."""
        ...


class PinocchioTree:
    """The tree in Pinocchio."""

    def __init__(self, mechanism: Mechanism) -> None:
        self._mechanism = mechanism

    def move(self, q: Array, v: Array) -> "_PinocchioMotion":
        """See `Tree.move`."""
        return _PinocchioMotion(self._mechanism, q, v)


class _PinocchioMotion:
    """See `TreeMotion`."""

    def __init__(self, mechanism: Mechanism, q: Array, v: Array) -> None:
        model = mechanism.model
        self._model = model
        self._weight_shares = mechanism.weight_shares
        self._q = q
        self._v = v
        self._data = model.createData()
        pin.computeJointJacobians(model, self._data, q)
        # With zero joint accelerations, the acceleration of a frame is J_dot v.
        pin.forwardKinematics(model, self._data, q, v, np.zeros(model.nv))
        pin.updateFramePlacements(model, self._data)

    def frame(self, name: str) -> FrameMotion:
        """See `TreeMotion.frame`."""
        frame = frame_id(self._model, name)
        kind = pin.LOCAL_WORLD_ALIGNED
        J = np.reshape(pin.getFrameJacobian(self._model, self._data, frame, kind), (6, -1))
        drift = pin.getFrameClassicalAcceleration(self._model, self._data, frame, kind).vector
        return FrameMotion(self._data.oMf[frame], J, J @ self._v, drift.copy())

    def forces(self, dv: Array) -> Array:
        """See `TreeMotion.forces`."""
        data = self._model.createData()  # RNEA would overwrite the motion
        force: Array = pin.rnea(self._model, data, self._q, self._v, dv)
        if self._weight_shares is not None:
            force = force + self._weight_that_does_not_act(self._weight_shares)
        return force

    def _weight_that_does_not_act(self, weight_shares: WeightShares) -> Array:
        """What to add to the joint forces of RNEA, because not all of the weight acts, shape (nv,).

        RNEA has the forces that carry the whole weight of each body at its mass centre. In fact a
        share of the weight acts there, and with it the moment offset x weight. The offset, [m], is
        in the axes of the body.
        """
        forces = np.zeros(self._model.nv)
        shares = zip(weight_shares.shares, weight_shares.offsets, strict=True)
        for joint, (share, offset) in enumerate(shares, start=1):
            body = self._model.inertias[joint]
            weight = body.mass * self._model.gravity.linear
            J = np.reshape(
                pin.getJointJacobian(self._model, self._data, joint, pin.LOCAL_WORLD_ALIGNED),
                (6, -1),
            )
            R = self._data.oMi[joint].rotation
            J_of_center = J[:3] - pin.skew(R @ body.lever) @ J[3:]  # of the mass centre's velocity
            forces += J_of_center.T @ ((1 - share) * weight)
            forces -= J[3:].T @ np.cross(R @ offset, weight)
        return forces


# --- the closed chain ---------------------------------------------------------------------------


class MovingRobot:
    """A mechanism at q, closed, whose coordinates have the rates va.

    Attributes:
        motion: The motion of its open tree; valid until the tree moves again.
        Phi: The closures' Jacobian, shape (rows, nv).
        drift: Phi_dot v, shape (rows,).
        B: Forces on the joints by motor torques of 1, shape (nv, motors).
        applied: Forces on the joints by friction, springs and lines, shape (nv,); also by the
            masses of lines, as if v were constant.
        line_inertia: Inertia of the masses of lines, shape (nv, nv).
    """

    def __init__(self, mechanism: Mechanism, tree: Tree, q: Array, va: Array) -> None:
        # The closures, first at rest: Phi gives the rates v, and v gives Phi_dot v.
        self._selection = mechanism.selection
        zero = np.zeros(mechanism.model.nv)
        self.Phi, _ = closure_rows(mechanism, tree.move(q, zero).frame, q, zero)
        v = self.joint_rates(va, np.zeros(len(self.Phi)))
        self.motion = tree.move(q, v)
        _, self.drift = closure_rows(mechanism, self.motion.frame, q, v)

        # Forces of friction and springs of joints.
        friction = mechanism.friction
        springs = mechanism.springs
        self.applied = -friction.viscous * v - friction.coulomb * np.sign(v)
        self.applied -= springs.stiffness * pin.difference(mechanism.model, springs.reference, q)

        # Forces along lines, and forces of motors on joints and lines.
        self.B = mechanism.actuation
        self.line_inertia = np.zeros((mechanism.model.nv, mechanism.model.nv))
        for line, shares in zip(mechanism.lines.forces, mechanism.lines.actuation, strict=True):
            moving_line = _moving_line(line, self.motion, v)
            row = moving_line.row
            self.applied -= _tension(line, moving_line) * row
            self.B = self.B + np.outer(row, shares)  # a motor pushes, unlike a tension
            # The mass of the line has the acceleration row v_dot + drift, also if it is slack.
            self.applied -= line.mass * moving_line.drift * row
            self.line_inertia += line.mass * np.outer(row, row)

    def joint_rates(self, rates: Array, Phi_v: Array) -> Array:
        """Rates v of all joints, shape (nv,), from rates of the coordinates and Phi v.

        For accelerations dv in place of rates, Phi dv = -Phi_dot v.
        """
        system = np.vstack([self.Phi, self._selection])
        return solution_of(system, np.concatenate([Phi_v, rates]))


class _MovingLine(NamedTuple):
    """A line between two frames, whose length is l."""

    length: float  #: l.
    rate: float  #: l_dot = row v.
    row: Array  #: Shape (nv,).
    drift: float  #: row_dot v, the part of l_ddot that does not depend on the accelerations.


def _moving_line(line: LineForce, motion: TreeMotion, v: Array) -> _MovingLine:
    """The motion of a line. With d from frame A to frame B: l = |d|, l_dot = d . d_dot / l."""
    a = motion.frame(line.frame_a)
    b = motion.frame(line.frame_b)
    d = b.placement.translation - a.placement.translation
    length = float(np.linalg.norm(d))
    row = d @ (b.J - a.J)[:3] / length
    d_dot = (b.twist - a.twist)[:3]
    d_ddot = (b.drift - a.drift)[:3]  # without accelerations
    drift = (d_dot @ d_dot + d @ d_ddot) / length - (d @ d_dot) ** 2 / length**3
    return _MovingLine(length, rate=float(row @ v), row=row, drift=drift)


def _tension(line: LineForce, moving_line: _MovingLine) -> float:
    """The tension of a line, without its motors and the force of its mass, [N]."""
    stretched = line.stiffness * (moving_line.length - line.rest_length)
    tension = line.preload + stretched + line.damping * moving_line.rate
    tension += line.coulomb_friction * np.sign(moving_line.rate)
    if line.pulls_only and tension < 0:
        return 0.0
    return float(tension)


# --- linear algebra -----------------------------------------------------------------------------


def solution_of(system: Array, right: Array) -> Array:
    """The solution of a consistent system with redundant rows or columns.

    A second solution, for the residual of the first, removes its rounding.
    """
    solution = np.linalg.lstsq(system, right, rcond=REDUNDANT)[0]
    residual = right - system @ solution
    solution = solution + np.linalg.lstsq(system, residual, rcond=REDUNDANT)[0]
    return np.asarray(solution, dtype=np.float64)


def closed_motions(Phi: Array) -> Array:
    """Joint rates that keep the loops closed, an orthonormal basis in rows, shape (n, nv)."""
    _, sizes, V = np.linalg.svd(Phi)
    rank = np.count_nonzero(sizes > REDUNDANT * sizes.max(initial=0.0))
    motions: Array = V[rank:]
    return motions
